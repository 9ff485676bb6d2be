"""What a run of a compiled machine costs beside its stepping alone, and beside a scene set up anew.

    ./run python benchmarks/compiled_scene.py [--quick]

A chain of ten links for 1 s, and a pendulum of 20 modes (21 coordinates) for 0.5 s: each run has other values of three
parameters.  Whole runs over the stepping alone, ratio by ratio in one process, their median with the quartiles.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import beam_record
import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm

MINUTES = 1.0
PEERS: tuple[str, ...] = ()


@dataclass(frozen=True)
class Case:
    """A machine whose runs are measured.

    Attributes:
        name: in the table.
        t_end: s.
        machine: compiled.
        values: of its parameters, by the number of the run.
        anew: a scene with these values.
    """

    name: str
    t_end: float
    machine: fm.CompiledMachine
    values: Callable[[int], dict[str, Any]]
    anew: Callable[[dict[str, Any]], fm.System]


def chain() -> Case:
    """Ten links; the mass and the length of one, and the first hinge's rate vary."""

    def build(mass: float = scenes.LINK_MASS, length: float = scenes.LINK, rate: float = 0.0) -> Any:
        scene = fm.System(gravity=(0.0, -scenes.G, 0.0))
        end = scene.ground.frame()
        links, pins, joints = [], [], []
        for i in range(10):
            own = mass if i == 4 else scenes.LINK_MASS
            body = fm.RigidBody(own, scenes.link_inertia(), (0.5 * scenes.LINK, 0.0, 0.0))
            links.append(scene.add(body, name=f"link {i}"))
            joints.append(scene.connect(fm.joint.Revolute("z"), end, links[-1].frame()))
            end = links[-1].frame(p=(length if i == 4 else scenes.LINK, 0.0, 0.0))
            pins.append(end)
        joints[0].velocity = rate
        return scene, links[4], pins[4], joints[0]

    scene, link, pin, hinge = build()
    named = {
        "mass": fm.parameter.Mass(link), "length": fm.parameter.FrameOrigin(pin),
        "rate": fm.parameter.InitialVelocity(hinge),
    }  # fmt: skip

    def values(k: int) -> dict[str, Any]:
        return {"mass": 0.6 + 0.001 * k, "length": (0.2 + 1e-4 * k, 0.0, 0.0), "rate": 0.01 * k}

    def anew(v: dict[str, Any]) -> fm.System:
        found: fm.System = build(v["mass"], v["length"][0], v["rate"])[0]
        return found

    return Case("chain of ten, 1 s", 1.0, scene.compile(parameters=named), values, anew)


def pendulum() -> Case:
    """A beam of 20 modes on a hinge; a damper and the initial rate vary."""
    files = beam_record.beam("5k", 20, folder=Path("out_simulation"))
    record = fm.ReducedBody.load(files.stiffened)

    def build(damping: float = 0.1, rate: float = 0.0) -> Any:
        scene, _ = scenes.flexible_chain(record, 1)
        hinge = scene.compile().connections[0]
        hinge.velocity = rate
        return scene, scene.add_force(fm.force.JointDamper(hinge, damping)), hinge

    scene, damper, hinge = build()
    named = {"damping": fm.parameter.OfForce(damper, "damping"), "rate": fm.parameter.InitialVelocity(hinge)}

    def values(k: int) -> dict[str, Any]:
        return {"damping": 0.1 + 0.01 * k, "rate": 0.01 * k}

    def anew(v: dict[str, Any]) -> fm.System:
        found: fm.System = build(**v)[0]
        return found

    return Case("pendulum of 21 coordinates, 0.5 s", 0.5, scene.compile(parameters=named), values, anew)


def seconds(call: Callable[[], fm.Trajectory]) -> tuple[float, float]:
    """Of a whole run, and of its stepping alone."""
    began = time.perf_counter()
    run = call()
    return time.perf_counter() - began, run.stats.seconds


def built_anew(case: Case, k: int) -> fm.Trajectory:
    """Run k by a scene of its own."""
    return case.anew(case.values(k)).simulate(case.t_end)


def quartiles(values: list[float]) -> str:
    low, middle, high = np.percentile(values, [25.0, 50.0, 75.0])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def quick(report: Report) -> None:
    """Five runs of the chain."""
    measure(report, [chain()], 5)


def full(report: Report) -> None:
    """Two hundred runs of each machine."""
    measure(report, [chain(), pendulum()], 200)


def measure(report: Report, cases: list[Case], runs: int) -> None:
    """A row for each machine."""
    report.table("machine", "ms a run", "over its stepping alone", "a scene built anew over its stepping")
    for case in cases:
        case.machine.simulate(case.t_end)
        over, whole, before = [], [], []
        for k in range(runs):
            compiled, stepping = seconds(partial(case.machine.simulate, case.t_end, **case.values(k)))
            set_up, alone = seconds(partial(built_anew, case, k))
            over.append(compiled / stepping)
            before.append(set_up / alone)
            whole.append(1e3 * compiled)
        report.say(f"| {case.name} | {quartiles(whole)} | {quartiles(over)} | {quartiles(before)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="five runs of the chain alone")
    (quick if parser.parse_args().quick else full)(Report(Path("out_simulation")))


if __name__ == "__main__":
    main()
