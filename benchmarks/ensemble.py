"""Ensembles on one thread and on two, and a rigid chain's beside exudyn's ParameterVariation and MuJoCo's rollout.

    ./run python benchmarks/ensemble.py [--variants 1000] [--quick]

First, in turns, an ensemble on one thread and on two: the chain of ten links of `scenes.py` for 1 s, its tip sampled at
the end and, for comparison, asked of trajectories; and a slider-crank whose rod is a reduced beam, for 0.5 s.  What the
machine has to give is measured beside it: two runs so long that they are compiled stepping alone, one after the other
and on two threads.  Of the processor time of a variant, the share that is not stepping is told, too: threads cannot
share out what of it is Python's.

Then the same variants of the chain by exudyn, whose function of parameters builds the system anew for each, on one
process and on two; its solver of the chain with error control, DOPRI5, with a tolerance for the tip to come out as near
as here.  And by MuJoCo's `rollout` of models made beforehand, by the longest steps of its RK4 that bring the tip as
near; `pip install "mujoco<4"`, without which it is left out.  What two threads gain needs a quiet machine with two
processors; processor times do not.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import beam_record
import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm
from flexmbd.ensemble import Sampled

MINUTES = 6.0
_SCENE, _TASK = "chain of ten, 1 s", "a variant of an ensemble"
PEERS: tuple[str, ...] = ("exudyn", "mujoco")
FOLDER = Path("out_simulation")
RTOL = 1e-6
TURNS = 5
MASSES = (0.6, 0.65)  # kg, of the fifth link
Frame = Any
Timed = tuple[float, float]
_PAIR = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def chain_machine() -> tuple[fm.CompiledMachine, Frame]:
    """Ten links, of which the fifth has a mass that varies."""
    scene, tip = scenes.rigid_chain(10)
    link = scene.compile().bodies[4]
    return scene.compile(parameters={"mass": fm.parameter.Mass(link)}), tip  # type: ignore[arg-type]


def chain_tip(mass: float) -> np.ndarray:
    """(3,) m, where the tip is after 1 s, to far more digits than are compared."""
    machine, tip = chain_machine()
    run = machine.simulate(1.0, rtol=1e-12, integrator=_PAIR, mass=mass)
    found: np.ndarray = run.position(tip)[-1]
    return found


def crank_machine(folder: Path) -> tuple[fm.CompiledMachine, Frame]:
    """A slider-crank with a rod of 20 modes; the torque's size varies."""
    record = fm.ReducedBody.load(beam_record.beam("5k", 20, folder=folder).stiffened)
    scene, slider = scenes.slider_crank(record)
    torque = next(iter(scene.compile().scene.index.forces))
    return scene.compile(parameters={"torque": fm.parameter.OfForce(torque, "value")}), slider  # type: ignore[arg-type]


def wall(call: Callable[[], object]) -> float:
    return timed(call)[0]


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Seconds of the wall's clock, and of all processors, those of processes that end in it included."""
    began, busy = time.perf_counter(), os.times()
    call()
    now = os.times()
    return time.perf_counter() - began, sum(now[:4]) - sum(busy[:4])


def in_turns(
    machine: fm.CompiledMachine, samples: dict[str, np.ndarray], output: Any, t_end: float, method: Any
) -> tuple[list[Timed], list[Timed]]:
    """An ensemble on one thread and on two, in turns."""

    def study(workers: int) -> None:
        outputs = {"end": output}
        with ThreadPoolExecutor(workers) as pool:
            machine.ensemble(
                samples, outputs, t_end=t_end, rtol=RTOL, integrator=method, executor=pool, workers=workers
            ).close()

    study(1)  # kernels are loaded
    return turns(study, TURNS)


def turns(study: Callable[[int], object], count: int) -> tuple[list[Timed], list[Timed]]:
    """A study with one worker and with two, in turns."""
    times = [(timed(lambda: study(1)), timed(lambda: study(2))) for _ in range(count)]
    one, two = zip(*times, strict=True)
    return list(one), list(two)


def ceiling(report: Report, machine: fm.CompiledMachine) -> None:
    """How much faster two runs of compiled stepping alone are on two threads than one after the other."""

    def two(workers: int) -> None:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda _: machine.simulate(100.0, rtol=RTOL, integrator=_PAIR), range(2)))

    two(1)
    ratios = np.array([wall(lambda: two(1)) / wall(lambda: two(2)) for _ in range(TURNS)])
    span = f"{np.median(ratios):.2f} times as fast ({ratios.min():.2f} to {ratios.max():.2f})"
    report.say(f"Stepping alone is {span} on two threads.")


def tell_share(report: Report, machine: fm.CompiledMachine, one: list[Timed], count: int) -> None:
    """The share of a variant's processor time that is not stepping, of the runs that were disturbed least."""
    runs = [machine.simulate(1.0, rtol=RTOL, integrator=_PAIR, mass=mass) for mass in np.linspace(*MASSES, count)]
    stepping = 1e3 * float(np.percentile([run.stats.seconds for run in runs], 5.0))
    whole = 1e3 * min(busy for _, busy in one) / count
    beside = whole - stepping
    report.say(f"A variant: {stepping:.3f} ms stepping and {beside:.3f} ms beside it, {whole / stepping:.2f} times.")


def tell(report: Report, name: str, one: list[Timed], two: list[Timed], count: int) -> float:
    """A line; the median processor time of a variant on one worker (s)."""
    (walls, busy), (others, _) = np.array(one).T, np.array(two).T
    ratios = walls / others
    low, middle, high = 1e3 * np.percentile(busy, [0.0, 50.0, 100.0]) / count
    report.say(
        f"{name}: {1e3 * min(walls) / count:.2f} ms a variant on one, {1e3 * min(others) / count:.2f} on two; "
        f"{np.median(ratios):.2f} times as fast ({ratios.min():.2f} to {ratios.max():.2f}); processor time on one "
        f"{middle:.2f} ms ({low:.2f} to {high:.2f})"
    )
    return 1e-3 * float(middle)


def exudyn_chain(given: dict[str, Any]) -> list[float]:
    """The tip (3,) m of one variant; what exudyn's ParameterVariation calls."""
    import scenes_exudyn
    from exudyn import JointType, SystemContainer
    from exudyn.itemInterface import SensorKinematicTree
    from exudyn.rigidBodyUtilities import HTtranslate, RigidBodyInertia, TreeLink

    system = SystemContainer().AddSystem()
    tree = []
    for i in range(10):
        inertia = RigidBodyInertia(
            mass=given["mass"] if i == 4 else scenes.LINK_MASS, com=[0.5 * scenes.LINK, 0.0, 0.0],
            inertiaTensor=np.diag(scenes.link_inertia()), inertiaTensorAtCOM=True,
        )  # fmt: skip
        place = HTtranslate([scenes.LINK if i else 0.0, 0, 0])
        hinge = JointType.RevoluteZ
        tree.append(TreeLink(inertia, jointType=hinge, jointHT=place, graphicsDataList=[]))
    body = system.CreateKinematicTree(listOfTreeLinks=tree, gravity=[0.0, -scenes.G, 0.0], baseGraphicsDataList=[])
    sensor = system.AddSensor(
        SensorKinematicTree(
            objectNumber=body, linkNumber=9, localPosition=[scenes.LINK, 0, 0],
            outputVariableType=scenes_exudyn.POSITION,
            writeToFile=False,
        )
    )
    model = system, lambda: np.array(system.GetSensorValues(sensor))
    _, found = scenes_exudyn.solve(model, scenes_exudyn.DOPRI5, 1.0, h=1e-2, rtol=given["functionData"]["rtol"])
    return [float(part) for part in found]


def beside_exudyn(report: Report, count: int, exact: np.ndarray, error: float, variant: float) -> None:
    """ParameterVariation on one process and on two, with a tip (3,) m as near the exact one, for the first mass."""
    from exudyn.processing import ParameterVariation

    for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        told = exudyn_chain({"mass": MASSES[0], "functionData": {"rtol": rtol}})
        off = float(np.linalg.norm(np.array(told) - exact))
        if off <= error:
            break
    report.say(f"Errors of the tip: {error:.1e} m here with rtol = {RTOL:g}, {off:.1e} m in exudyn with {rtol:g}.")

    def study(workers: int) -> None:
        ParameterVariation(
            exudyn_chain, {"mass": (*MASSES, count)}, useMultiProcessing=workers > 1, numberOfThreads=workers,
            showProgress=False, parameterFunctionData={"rtol": rtol},
        )  # fmt: skip

    theirs = tell(report, "exudyn, chain of ten", *turns(study, 2), count)
    report.beside(_SCENE, task=_TASK, peer="exudyn, ParameterVariation", theirs=theirs, ours=variant)


def beside_mujoco(report: Report, count: int, exact: np.ndarray, error: float, variant: float) -> None:
    """MuJoCo's rollout on one thread and on two, with a tip (3,) m as near the exact one, for the first mass."""
    try:
        from ensemble_mujoco import Batch
    except ImportError:
        print('MuJoCo is not installed: pip install "mujoco<4"')
        return
    for steps in (round(250 * 2.0 ** (k / 4)) for k in range(24)):  # its error falls with the fourth power
        off = float(np.linalg.norm(Batch([MASSES[0]], 1.0 / steps).tips(1)[0] - exact))
        if off <= error:
            break
    there = f"{off:.1e} m in MuJoCo with {steps} steps"
    report.say(f"Errors of the tip: {error:.1e} m here with rtol = {RTOL:g}, {there}.")
    batch = Batch(np.linspace(*MASSES, count), 1.0 / steps)
    batch.tips(2)
    theirs = tell(report, "MuJoCo, chain of ten", *turns(batch.tips, TURNS), count)
    report.beside(_SCENE, task=_TASK, peer="MuJoCo, rollout", theirs=theirs, ours=variant)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variants", type=int, default=1000)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of the records")
    parser.add_argument("--quick", action="store_true", help="the chain alone, without other programs")
    given = parser.parse_args()
    report = Report(given.folder)
    variant = chain(report, given.variants)
    if not given.quick:
        others(report, given.variants, given.folder, variant)


def quick(report: Report) -> None:
    """Fifty variants of the chain."""
    chain(report, 50)


def full(report: Report) -> None:
    """A thousand variants of the chain, the slider-crank, and other programs."""
    variant = chain(report, 1000)
    others(report, 1000, FOLDER, variant)


def chain(report: Report, count: int) -> float:
    """The chain's variants, its tip sampled and asked of trajectories; what a sampled one takes (s)."""
    machine, tip = chain_machine()
    masses = {"mass": np.linspace(*MASSES, count)}
    sampled = Sampled(fm.output.Position(tip), t=1.0)
    one, two = in_turns(machine, masses, sampled, 1.0, _PAIR)
    variant = tell(report, "chain of ten, 1 s, its tip sampled", one, two, count)
    tell_share(report, machine, one, count)
    by_run = in_turns(machine, masses, lambda run: run.position(tip)[-1], 1.0, _PAIR)
    tell(report, "chain of ten, 1 s, by trajectories", *by_run, count)
    return variant


def others(report: Report, count: int, folder: Path, variant: float) -> None:
    """What two threads could give, a slider-crank, and the chain in other programs."""
    machine, tip = chain_machine()
    ceiling(report, machine)
    exact = chain_tip(MASSES[0])
    run = machine.simulate(1.0, rtol=RTOL, integrator=_PAIR, mass=MASSES[0])
    error = float(np.linalg.norm(run.position(tip)[-1] - exact))
    beside_mujoco(report, max(4, count // 5), exact, error, variant)
    machine, slider = crank_machine(folder)
    few = max(4, count // 50)
    torques = {"torque": np.linspace(15.0, 25.0, few)}
    end = Sampled(fm.output.Position(slider), t=0.5)
    tell(report, "slider-crank of 20 modes, 0.5 s", *in_turns(machine, torques, end, 0.5, fm.RadauIIA()), few)
    if importlib.util.find_spec("exudyn") is not None:
        beside_exudyn(report, few, exact, error, variant)


if __name__ == "__main__":
    main()
