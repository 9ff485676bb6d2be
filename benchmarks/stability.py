"""What each integrator survives, and by how much it drifts: stress tests as a table.

    ./run python benchmarks/stability.py --quick     # short versions, about a minute
    ./run python benchmarks/stability.py             # the whole, long runs included

Rows are cases, columns integrators. A cell says what was measured, or "stopped" where the simulation ended with an
error that names the place (the reason is printed), or "lost" where it went on to nonsense. Where a method refuses a
scene the cell is empty. Cases, by their names:

    turning S     a flexible bar on a hinge brought to S rad/s and turned on, by steps of 0.02 s: how much its
                  extension varies in that time
    drift NAME    relative drift of the energy over many steps of a fiftieth of the period
    free body     the same for a body that tumbles freely, and how far its rotation is from orthonormal
    redundant     largest residual of all rows, redundant ones included, in a row of four-bars
    singular      error at 10 s of four-bars that pass positions where the constraints lose rank, by h = 1e-3 s
    branching     a crank as long as its rod: distance from the branch it came on
    governor K    error of the slider after 1 s; springs and dampers of K times the usual stiffness
    light on top, heavy on top    a double pendulum with masses a million apart: error after 1 s
    steps to H    slider-crank by ever smaller steps: change of the multipliers over 20 steps of 1e-9 s, over their size
    spin-up       an arm spun up by steps of 0.01 s, longer than the period of its axial vibration: its least lag
                  over the converged one, less 1 (survives within 2e-3)
    long run      energy drift of a flexible double pendulum over 1e4 steps

Writes out_stability/table.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import scenes
from beam_record import arm, beam
from benchmark import Report
from scenes import METHODS, Method

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
import mechanisms

import flexmbd as fm

Case = Callable[[Method], float]
MINUTES = 12.0
TIMED = False  # errors alone
PEERS: tuple[str, ...] = ()

#: How often the flexible bar turns at each speed (rad/s), in the whole and in the short version.
TURNS = {False: {1.0: 50, 10.0: 500, 100.0: 1000}, True: {1.0: 20, 10.0: 20, 100.0: 20}}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="short versions")
    parser.add_argument("--case", help="only cases with this in their names")
    parser.add_argument("--output", type=Path, default=Path("out_stability"), metavar="FOLDER")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    cases = _cases(arguments.output, quick=arguments.quick)
    some = {name: case for name, case in cases.items() if arguments.case is None or arguments.case in name}
    report = Report(arguments.output)
    tell(report, some)
    (arguments.output / "table.md").write_text("\n".join(report.lines) + "\n")
    return 0


def quick(report: Report) -> None:
    """Four short cases."""
    cases = _cases(report.folder, quick=True)
    tell(report, {name: cases[name] for name in ("redundant", "branching", "heavy on top", "steps to 1e-09")})


def full(report: Report) -> None:
    """All, long runs included."""
    tell(report, _cases(report.folder, quick=False))


def tell(report: Report, cases: dict[str, Case]) -> None:
    """The table of some cases by all integrators."""
    report.table("case", *(method.label for method in METHODS))
    for name, case in cases.items():
        report.say(f"| {name} | {' | '.join(_cell(name, case, method) for method in METHODS)} |")


def _cell(name: str, case: Case, method: Method) -> str:
    try:
        figure = case(method)
    except fm.SimulationError as reason:
        print(f"{name}, {method.label}: {reason}", flush=True)
        return "stopped"
    except fm.errors.SceneError as reason:
        print(f"{name}, {method.label}: {reason}", flush=True)
        return ""
    return f"{figure:.1e}" if np.isfinite(figure) else "lost"


def _cases(folder: Path, *, quick: bool) -> dict[str, Case]:
    files = beam("5k", 20, folder=folder)
    record = fm.ReducedBody.load(files.stiffened)
    periods = 20 if quick else 1000
    governor = mechanisms.Governor()
    return {
        **{f"turning {speed:g}": partial(turning, record, speed, turns) for speed, turns in TURNS[quick].items()},
        "drift pendulum": partial(drift, mechanisms.pendulum, mechanisms.PERIOD_POINT, periods),
        "drift fast top": partial(drift, mechanisms.fast_top, mechanisms.NUTATION[0.05].period / 5.0, periods),
        "free body, energy": partial(tumbling, 50 * periods, orthonormality=False),
        "free body, rotation": partial(tumbling, 10**4 if quick else 10**5, orthonormality=True),
        "redundant": redundant,
        "singular": singular,
        "branching": branching,
        "governor": partial(stiff, governor),
        "governor 1000": partial(stiff, mechanisms.Governor(stiffness=8e8, damping=4e7)),
        "light on top": partial(far_apart, (1.0, 1e6)),
        "heavy on top": partial(far_apart, (1e6, 1.0)),
        **{f"steps to {h:.0e}": partial(tiny_steps, h) for h in (1e-5, 1e-7, 1e-9)},
        "spin-up": partial(spun_up, fm.ReducedBody.load(arm(40, folder=folder))),
        "long run": partial(long_run, record, 10**3 if quick else 10**4),
    }


def ramped(speed: float, ramp: float) -> fm.Motion:
    """Smoothly from rest to a speed (rad/s) within a time (s)."""
    turn = 2.0 * np.pi / ramp

    def angle(t: float) -> float:
        if t < ramp:
            return speed / ramp * (0.5 * t * t + (np.cos(turn * t) - 1.0) / turn**2)
        return speed * (t - 0.5 * ramp)

    def rate(t: float) -> float:
        return speed / ramp * (t - np.sin(turn * t) / turn) if t < ramp else speed

    def acceleration(t: float) -> float:
        return speed / ramp * (1.0 - np.cos(turn * t)) if t < ramp else 0.0

    return fm.Motion(*map(fm.compiled, (angle, rate, acceleration)))


def turning(record: fm.ReducedBody, speed: float, turns: int, method: Method) -> float:
    scene = fm.System()
    bar = scene.add(fm.FlexibleBody(record), name="bar")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bar.frame("start"))
    ramp = 10.0
    hinge.prescribe(ramped(speed, ramp))
    run = scene.simulate(ramp + 2.0 * np.pi * turns / speed, h=0.02, integrator=method.make())
    stretch = np.linalg.norm(run.position(bar.frame("end")), axis=1)[run.t > ramp] - 1.0
    return float(np.ptp(stretch) / stretch.mean())


def drift(build: Callable[[], mechanisms.Mechanism], period: float, periods: int, method: Method) -> float:
    run = build().scene.simulate(periods * period, h=period / 50.0, rtol=1e-10, integrator=method.make())
    return _energy_drift(run)


def _energy_drift(run: fm.Trajectory) -> float:
    energy = run.energy()
    return float(np.abs(energy.total - energy.total[0]).max() / np.ptp(energy.kinetic + 1e-300))


def tumbling(steps: int, method: Method, *, orthonormality: bool) -> float:
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 2.0, 2.5)), name="body")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.velocity = (0.0, 0.0, 0.0, 0.1, 10.0, 0.1)
    run = scene.simulate(0.01 * steps, h=0.01, rtol=1e-10, integrator=method.make())
    if orthonormality:
        R = run.rotation(body.frame())[-1]
        return float(np.abs(R @ R.T - np.eye(3)).max())
    energy = run.energy().kinetic
    return float(np.abs(energy / energy[0] - 1.0).max())


def redundant(method: Method) -> float:
    mechanism = mechanisms.four_bars(2)
    run = mechanism.scene.simulate(2.0, h=1e-3, rtol=1e-8, integrator=method.make())
    return float(run.stats.constraint_residual) if np.isfinite(run.multipliers).all() else np.nan


def singular(method: Method) -> float:
    mechanism = mechanisms.four_bars(2)
    run = mechanism.scene.simulate(10.0, h=1e-3, rtol=1e-8, integrator=method.make())
    return mechanism.error(run, 10.0)


def branching(method: Method) -> float:
    mechanism = mechanisms.slider_crank(0.2, 0.2, speed=10.0)
    run = mechanism.scene.simulate(2.5, h=1e-3, integrator=method.make())
    crank = run.bodies["crank"]
    x = run.position(crank.frame(p=(0.2, 0.0, 0.0)))[:, 0]  # type: ignore[attr-defined]
    return float(np.abs(run.position(mechanism.point)[:, 0] - 2.0 * x).max())


def stiff(governor: mechanisms.Governor, method: Method) -> float:
    mechanism = governor.mechanism()
    run = mechanism.scene.simulate(1.0, rtol=1e-6, integrator=method.make())
    return abs(float(run.beta(mechanism.joint)[-1]) - governor.solution(1.0)[0])


def far_apart(masses: tuple[float, float], method: Method) -> float:
    scene, tip = mechanisms.point_masses(masses)
    run = scene.simulate(1.0, rtol=1e-7, integrator=method.make())
    return float(np.linalg.norm(run.position(tip)[-1, [0, 2]] - mechanisms.point_masses_end(masses, 1.0)))


def tiny_steps(h: float, method: Method) -> float:
    mechanism = mechanisms.slider_crank(0.08, 0.3, speed=20.0, start=0.4)
    run = mechanism.scene.simulate(20.0 * h, h=h, rtol=1e-8, integrator=method.make())
    change = np.abs(run.multipliers - run.multipliers[0]).max()
    return float(change / np.abs(run.multipliers[0]).max())


def spun_up(record: fm.ReducedBody, method: Method) -> float:
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("x_min"))
    hub.prescribe(ramped(6.0, 15.0))
    run = scene.simulate(20.0, h=0.01, integrator=method.make())
    tip = np.einsum("tji,tj->ti", run.rotation(body.frame()), run.position(body.frame("x_max")))
    return float(tip[:, 1].min() / -0.573860 - 1.0)


def long_run(record: fm.ReducedBody, steps: int, method: Method) -> float:
    machine, _ = scenes.flexible_chain(record, 2)
    return _energy_drift(machine.simulate(1e-3 * steps, h=1e-3, rtol=1e-10, integrator=method.make()))


if __name__ == "__main__":
    sys.exit(main())
