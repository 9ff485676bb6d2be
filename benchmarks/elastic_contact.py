"""Elastic bodies that touch by contact patches: time of a step, and a bar that bounces, beside penalties and exudyn.

    ./run python benchmarks/elastic_contact.py [--quick]

Steps: a plate of twenty modes and fifty patches flies over a half space: without contact, with one that is open, and
lying on it, all patches closed; processor time of a step, what is done once left out.

Bar (Doyen, Ern & Piperno 2011): 10 m, dropped by 5 m; a rigid wall gives it the impulse 800/3 N s in two passages of
its wave. By contact patches, with which the modes carry no mass at the boundary; by a Craig-Bampton body that carries
mass there and touches by a penalty, in multiples of the stiffness EA/L of the bar; and the same in exudyn, by the
coordinate of its end (ObjectContactCoordinate). Errors of the impulse, and processor times from a built scene to the
end. Programs are compared at the error of 1 per cent: the quickest run of each whose error is below.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg
from benchmark import Report

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface, SymmetryPlane
from flexmbd.forms import solid_linear
from flexmbd.reduction import Patch, craig_bampton

MINUTES = 4.0
PEERS: tuple[str, ...] = ("exudyn",)
FOLDER = Path("out_simulation")

LENGTH, SIDE, FALL, G, SOFT = 10.0, 0.1, 5.0, 10.0, 900.0  # m, m, m, m/s^2, N of EA, with 1 kg/m
END, IMPULSE = 2.6, 800.0 / 3.0  # s, between two impacts; N s
AFTER = (2.0, END)  # s, it flies
ERROR = 0.01
PENALTIES = (30.0, 300.0, 3000.0)  # of EA/L
PLATE = (0.4, 0.2, 0.02)  # m
MOST = {"open": 2.0, "closed": 5.0}  # times a step without contact


# The plate.


@cache
def plate() -> fm.ReducedBody:
    """Of steel, twenty modes, fifty patches below."""
    mesh = meshes.block(*PLATE, divisions=(20, 10, 1), comm=MPI.COMM_SELF)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2)
    below = Patch("below", size=0.04, facets="z_min")
    record = craig_bampton(model, modes=20, geometric_stiffness=False, contact=[below])
    assert record.contact is not None
    assert len(record.contact.area) == 50
    return record


def flying(state: str) -> tuple[fm.System, Any]:
    """The plate above a half space, without contact, near it or on it; and the contact, if there is one."""
    scene = fm.System(gravity=(0.0, 0.0, -1e3) if state == "closed" else (0.0, 0.0, 0.0))
    body = scene.add(fm.FlexibleBody(plate()), name="plate")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    patches = plate().contact
    assert patches is not None
    height = -float(patches.x[:, 2].min())
    free.position = (0.0, 0.0, height + (0.0 if state == "closed" else 1e-3), 1.0, 0.0, 0.0, 0.0)
    free.velocity = (0.0, 0.0, 0.0, 0.01, 0.02, 0.03) if state != "closed" else (0.0,) * 6
    if state == "none":
        return scene, None
    below = contact.ElasticSurface(body, "below")
    return scene, scene.touch(below, contact.HalfSpace(scene.ground.frame()), contact.Hard())[0]


def step_times(method: Any, h: float, *, steps: int, turns: int) -> dict[str, tuple[float, list[float], float]]:
    """By state: us a step, those of each turn over no contact's, and the share of patches that bear, over time."""
    scenes = {state: flying(state) for state in ("none", "open", "closed")}
    spent: dict[str, list[float]] = {state: [] for state in scenes}
    bears = {}
    for scene, _ in scenes.values():
        scene.simulate(2 * h, h=h, integrator=method)  # compiles
    for _ in range(turns):
        for state, (scene, pair) in scenes.items():
            times = []
            for count in (2, steps):
                began = time.process_time()
                run = scene.simulate(count * h, h=h, integrator=method)
                times.append(time.process_time() - began)
            spent[state].append(1e6 * (times[1] - times[0]) / (steps - 2))
            if pair is not None:
                bears[state] = float((run.contacts(pair)[0].normal_force > 0.0).mean())
    return {
        state: (
            float(np.median(times)),
            [a / b for a, b in zip(times, spent["none"], strict=True)],
            bears.get(state, 0.0),
        )
        for state, times in spent.items()
    }


# The bar.


@cache
def bar(modes: int, *, has_patches: bool) -> fm.ReducedBody:
    """It strains along x alone; body frame on its upper end."""
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(200, 1, 1), comm=MPI.COMM_SELF)
    sides = {"y_min": (0, 1, 0), "y_max": (0, 1, 0), "z_min": (0, 0, 1), "z_max": (0, 0, 1)}
    planes = [SymmetryPlane(name, along) for name, along in sides.items()]
    ends = [Interface("x_max")] if has_patches else [Interface("x_max"), Interface("x_min")]
    soft = solid_linear.Parameters(E=SOFT / SIDE**2, nu=0.0, rho=1.0 / SIDE**2)
    model = ContinuumModel(mesh, solid_linear, soft, degree=2, interfaces=ends, supports=planes)
    touched = [Patch("lower", size=SIDE, facets="x_min")] if has_patches else []
    return craig_bampton(model, modes=modes, frame="x_max", geometric_stiffness=False, contact=touched)


@dataclass(frozen=True)
class Bounce:
    """What a run of the bar gives: processor time (s), impulse (N s), deepest overlap (m)."""

    seconds: float
    impulse: float
    overlap: float
    steps: int

    @property
    def error(self) -> float:
        """Of the impulse, relative."""
        return self.impulse / IMPULSE - 1.0


def dropped(record: fm.ReducedBody, penalty: float | None, **how: Any) -> Bounce:
    """Here: by patches, or by a penalty in EA/L at an interface."""
    scene = fm.System(gravity=(-G, 0.0, 0.0))
    body = scene.add(fm.FlexibleBody(record), name="bar")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame("x_max"))
    slide.position = LENGTH
    wall = contact.HalfSpace(scene.ground.frame((-FALL, 0.0, 0.0)), normal="x")
    if penalty is None:
        (pair,) = scene.touch(contact.ElasticSurface(body, "lower"), wall, contact.Hard())
    else:
        law = contact.PowerLaw(k=penalty * SOFT / LENGTH)
        pair = scene.touch(wall, contact.Vertex(body.frame("x_min")), law)
    began = time.process_time()
    run = scene.simulate(END, **how)
    seconds = time.process_time() - began
    centre = run.position(body.frame(), t=AFTER)[:, 0] + run.q(body, t=AFTER) @ record.gram[0, 4::3] / record.mass
    deepest = max(0.0, -float(run.contacts(pair)[0].gap.min()))
    return Bounce(seconds, given(centre), deepest, len(run.t) - 1)


def given(centre: np.ndarray) -> float:
    """N s that the wall has given, from the places of the centre of mass (m) at the instants AFTER."""
    falls = centre + 0.5 * G * np.array(AFTER) ** 2
    return float(LENGTH * np.diff(falls)[0] / np.diff(AFTER)[0])


def bar_matrices(modes: int, elements: int = 1000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Craig-Bampton matrices of the bar along itself, by finite elements of its own: K, M, M times 1 m/s^2.

    Its coordinates are the lower end, the upper end, and modes.
    """
    h = LENGTH / elements
    K, M = np.zeros((elements + 1,) * 2), np.zeros((elements + 1,) * 2)
    for e in range(elements):
        K[e : e + 2, e : e + 2] += SOFT / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        M[e : e + 2, e : e + 2] += h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    _, inner = scipy.linalg.eigh(K[1:-1, 1:-1], M[1:-1, 1:-1], subset_by_index=(0, modes - 1))
    shapes = np.zeros((elements + 1, modes + 2))
    shapes[:, 0], shapes[:, 1] = np.linspace(1.0, 0.0, elements + 1), np.linspace(0.0, 1.0, elements + 1)
    shapes[1:-1, 2:] = inner
    return shapes.T @ K @ shapes, shapes.T @ M @ shapes, shapes.T @ M @ np.ones(elements + 1)


def dropped_in_exudyn(modes: int, penalty: float, h: float) -> Bounce:
    """The same body of generic coordinates, generalized-alpha."""
    import exudyn as exu
    import exudyn.itemInterface as item

    K, M, weight = bar_matrices(modes)
    system = exu.SystemContainer().AddSystem()
    count = len(weight)
    node = system.AddNode(
        item.NodeGenericODE2(
            referenceCoordinates=[0.0] * count, initialCoordinates=[0.0] * count,
            initialCoordinates_t=[0.0] * count, numberOfODE2Coordinates=count,
        )
    )  # fmt: skip
    system.AddObject(
        item.ObjectGenericODE2(
            nodeNumbers=[node], massMatrix=M, stiffnessMatrix=K, dampingMatrix=0.0 * K, forceVector=-G * weight
        )
    )
    ground = system.AddNode(item.NodePointGround(referenceCoordinates=[0.0, 0.0, 0.0]))
    fixed = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    lower = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    data = system.AddNode(item.NodeGenericData(initialCoordinates=[FALL], numberOfDataCoordinates=1))
    k = penalty * SOFT / LENGTH
    system.AddObject(
        item.ObjectContactCoordinate(
            markerNumbers=[fixed, lower], nodeNumber=data, contactStiffness=k, contactDamping=0.0, offset=-FALL
        )
    )
    sensor = system.AddSensor(
        item.SensorNode(nodeNumber=node, outputVariableType=exu.OutputVariableType.Coordinates, storeInternal=True)
    )
    system.Assemble()
    settings = exu.SimulationSettings()
    stepping = settings.timeIntegration
    stepping.endTime, stepping.numberOfSteps, stepping.verboseMode = END, round(END / h), 0
    stepping.generalizedAlpha.spectralRadius = 0.8
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = h
    began = time.process_time()
    system.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    seconds = time.process_time() - began
    kept = np.array(system.GetSensorStoredData(sensor))
    places = kept[:, 1:] @ weight / LENGTH
    centre = np.array([np.interp(t, kept[:, 0], places) for t in AFTER])
    return Bounce(seconds, given(centre), float(np.maximum(0.0, -FALL - kept[:, 1]).max()), round(END / h))


def bounces(report: Report, *, modes: Sequence[int], rtols: Sequence[float], steps: Sequence[float]) -> None:
    """Rows of the bar; and the comparison."""
    report.say()
    report.table("bar's contact", "modes", "tolerance or step", "impulse, %", "overlap, mm", "steps", "time (ms)")
    best: dict[str, tuple[float, str]] = {}

    def told(label: str, count: int, how: str, run: Callable[[], Bounce]) -> None:
        run()  # kernels are loaded
        found = run()
        report.say(
            f"| {label} | {count} | {how} | {100.0 * found.error:+.2f} | {1e3 * found.overlap:.1f} | {found.steps} | "
            f"{1e3 * found.seconds:.3g} |"
        )
        key = label.split(",")[0]
        if abs(found.error) <= ERROR and found.seconds < best.get(key, (np.inf, ""))[0]:
            best[key] = found.seconds, label

    for count in modes:
        for penalty in (None, *PENALTIES):
            name = "patches" if penalty is None else f"penalties, {penalty:g} EA/L"
            for rtol in rtols:
                record = bar(count, has_patches=penalty is None)
                told(name, count, f"rtol {rtol:.0e}", lambda r=record, k=penalty, e=rtol: dropped(r, k, rtol=e))
            if penalty is not None and importlib.util.find_spec("exudyn") is not None:
                for h in steps:
                    name = f"exudyn, {penalty:g} EA/L"
                    told(name, count, f"{h:.0e} s", lambda n=count, k=penalty, h=h: dropped_in_exudyn(n, k, h))
    if "exudyn" in best and "patches" in best:
        report.beside(
            "elastic contact, bar", task="an impact to 1 per cent of its impulse",
            peer=f"generalized-alpha and a penalty ({best['exudyn'][1]})",
            theirs=best["exudyn"][0], ours=best["patches"][0],
        )  # fmt: skip


def steps_of(report: Report, *, steps: int, turns: int) -> None:
    """Rows of the plate."""
    report.table("method", "contact", "patches that bear", "us a step", "times no contact's (range)", "promised")
    for name, method, h in (
        ("generalized-alpha", fm.GeneralizedAlpha(), 1e-5),
        ("Dormand-Prince 5(4)", fm.ExplicitRungeKutta(), 2e-6),
    ):
        for state, (us, times, share) in step_times(method, h, steps=steps, turns=turns).items():
            promised = f"{MOST[state]:g}" if state in MOST else ""
            ratio = f"{np.median(times):.2f} ({min(times):.2f} to {max(times):.2f})"
            report.say(f"| {name} | {state} | {100 * share:.0f} % | {us:.1f} | {ratio} | {promised} |")


def quick(report: Report) -> None:
    """A few steps, one number of modes."""
    steps_of(report, steps=300, turns=1)
    bounces(report, modes=(5,), rtols=(1e-3,), steps=(1e-3,))


def full(report: Report) -> None:
    """All."""
    steps_of(report, steps=2000, turns=5)
    bounces(report, modes=(5, 10, 20, 40), rtols=(1e-2, 1e-3, 1e-4, 1e-5), steps=(2e-3, 5e-4, 1e-4, 2e-5))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few steps and modes")
    given = parser.parse_args()
    report = Report(FOLDER)
    (quick if given.quick else full)(report)
    for one in report.comparisons:
        print(one)


if __name__ == "__main__":
    main()
