"""What stepping from outside costs over the steps themselves, and how many restores a second there are.

    ./run python benchmarks/stepper.py [--quick]

A pendulum of 20 modes (21 coordinates) with a torque from outside and three outputs: angle, rate, and the beam's frame.
The steps themselves are those of one long call of the same stepper; beside them stand calls of one step each, with the
input as it is and with one that changes each time, at which the method begins anew.  Processor time, in turns in
one process; the median with the quartiles.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import beam_record
import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm
from flexmbd.output import Output

MINUTES = 0.5
PEERS: tuple[str, ...] = ()

#: Methods and their fixed steps (s).
METHODS = {"5(4)": (fm.ExplicitRungeKutta(), 5e-5), "generalized-alpha": (fm.GeneralizedAlpha(), 1e-3)}


def pendulum(modes: int) -> tuple[fm.System, fm.Signal, list[Output]]:
    """The beam on a hinge; the torque on it, and what is told."""
    files = beam_record.beam("5k", modes, folder=Path("out_simulation"))
    return with_ports(scenes.flexible_chain(fm.ReducedBody.load(files.plain), 1)[0])


def with_ports(scene: fm.System) -> tuple[fm.System, fm.Signal, list[Output]]:
    """The scene with a torque on its first hinge, and what is told of it."""
    machine = scene.compile()
    hinge, body, torque = machine.connections[0], machine.bodies[-1], fm.Signal("torque")
    if not isinstance(body, fm.FlexibleBody | fm.RigidBody):
        raise TypeError(f"{body} has no frames to ask for")
    scene.add_force(fm.force.JointTorque(hinge, torque))
    return scene, torque, [fm.output.Position(hinge), fm.output.Velocity(hinge), fm.output.Position(body.frame())]


def microseconds(call: Callable[[], object], count: int) -> float:
    """Processor time of so many steps (us each)."""
    began = time.process_time()
    call()
    return 1e6 * (time.process_time() - began) / count


def measured(stepper: fm.SteppedMachine, h: float, steps: int, turns: int) -> dict[str, np.ndarray]:
    """Microseconds by what is done, a number for each turn."""

    def one_by_one() -> None:
        for _ in range(steps):
            stepper.step(h)

    def changing() -> None:
        for k in range(steps):
            stepper.step(h, 1e-3 * (k % 2 - 0.5))

    kept = stepper.snapshot()

    def restoring() -> None:
        for _ in range(steps):
            stepper.restore(kept)

    ways = {
        "steps": lambda: stepper.step(steps * h), "held": one_by_one, "changed": changing, "restore": restoring,
    }  # fmt: skip
    found: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(turns + 1):
        for name, way in ways.items():
            stepper.restore()
            spent = microseconds(way, steps)
            if turn:  # the first one warms up
                found[name].append(spent)
    return {name: np.array(times) for name, times in found.items()}


def quartiles(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [25.0, 50.0, 75.0])
    return f"{middle:.1f} ({low:.1f} to {high:.1f})"


def measure(
    report: Report, scene: fm.System, torque: fm.Signal, outputs: list[Output], *,
    steps: int, turns: int,
) -> None:  # fmt: skip
    """A row for each method."""
    over_it = "a call over it, us", "with a changed input, us"
    report.table("method", "a step itself, us", *over_it, "a restore, us", "restores a second")
    for name, (method, h) in METHODS.items():
        stepper = scene.stepper(h=h, integrator=method, inputs=[torque], outputs=outputs)
        found = measured(stepper, h, steps, turns)
        over = [quartiles(found[way] - found["steps"]) for way in ("held", "changed")]
        often = f"{1e6 / np.median(found['restore']):.0f}"
        row = [name, quartiles(found["steps"]), *over, quartiles(found["restore"]), often]
        report.say(f"| {' | '.join(row)} |")


def quick(report: Report) -> None:
    """Two rigid links, a few steps."""
    measure(report, *with_ports(scenes.rigid_chain(2)[0]), steps=100, turns=3)


def full(report: Report) -> None:
    """The pendulum of 20 modes, whose record knows no stiffening."""
    warnings.simplefilter("ignore", fm.RangeWarning)
    measure(report, *pendulum(20), steps=2000, turns=15)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two rigid links, a few steps")
    (quick if parser.parse_args().quick else full)(Report(Path("out_simulation")))


if __name__ == "__main__":
    main()
