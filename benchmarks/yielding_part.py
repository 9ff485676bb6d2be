"""A part of which only a waist may yield, against the same part as one body that may yield all over.

    ./run python benchmarks/yielding_part.py --small       # about 10 degrees, coarse bricks, about a minute
    ./run python benchmarks/yielding_part.py               # about 10, 30 and 60 degrees, some minutes
    ./run python benchmarks/yielding_part.py --bends 60    # one of them

A clamped square steel bar, 12 depths long, half as high at a waist 4 depths from the clamp, with a mass at its end that
a push of 5 ms sets moving: it bends in a plastic hinge at the waist until its energy is spent. Once all of the bar is a
body of finite plastic strain; once only four depths around the waist are, and both remainders are reduced bodies with
frames of their own, held by rigid or by averaged cuts. The same bricks of degree 2 in all of them, the same steps of
generalized-alpha. Errors are of the largest distance of the end's way, and of the plastic work; times are processor
time of one thread, without what compiles.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from benchmark import Report
from numpy.typing import NDArray

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, ImplicitContinuum, Interface, NonlinearModel, cut_mesh
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.multibody.bodies.body import Frame
from flexmbd.reduction import Keep, craig_bampton

SIDE, DEPTHS, WAIST, AROUND = 0.02, 12, 4.0, 2.0  # m, and in depths
TIP, PUSH = 4.0, 5e-3  # kg, s
MODULUS, RATIO, DENSITY, YIELD = 2.1e11, 0.3, 7850.0, 2.5e8
# bend, degrees, about which the bar keeps: speed of the end, m/s, and time, s, until it stands still
BENDS = {10: (3.9, 0.016), 30: (6.7, 0.028), 60: (10.8, 0.034)}
MODES, STEP = 8, 2.5e-4
MINUTES = 6.0
PEERS: tuple[str, ...] = ()

STEEL = forms.solid_linear.Parameters(E=MODULUS, nu=RATIO, rho=DENSITY)
YIELDING = forms.hencky_plasticity.Parameters(
    E=MODULUS, nu=RATIO, rho=DENSITY, yield_stress=YIELD, hardening=forms.j2_plasticity.LinearHardening(2e8)
)
ENDS = ("x_min", "x_max")


@dataclass(frozen=True, eq=False)
class Found:
    """The end's way (n, 3) m, its turn (n,) degrees, plastic work J, processor time s, and the run with its bodies."""

    way: NDArray[np.float64]
    turn: NDArray[np.float64]
    work: float
    seconds: float
    run: fm.Trajectory
    bodies: Mapping[str, fm.FlexibleBody | fm.ContinuumBody]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="the first of the bends alone, a coarse mesh")
    parser.add_argument("--bends", type=int, nargs="+", choices=BENDS, default=list(BENDS), help="degrees")
    arguments = parser.parse_args()
    report = Report(Path("out_yielding_part"))
    if arguments.small:
        quick(report)
    else:
        tell(report, arguments.bends, (24, 1, 2))
    return 0


def quick(report: Report) -> None:
    """The first of the bends, a coarse mesh."""
    tell(report, list(BENDS)[:1], (12, 1, 2))


def full(report: Report) -> None:
    """All bends."""
    tell(report, list(BENDS), (24, 1, 2))


def tell(report: Report, bends: list[int], divisions: tuple[int, int, int]) -> None:
    """Rows of the whole and of both couplings, bend by bend (degrees)."""
    report.table("bend", "cuts", "end's way", "plastic work", "remainders' utilisation", "time, s", "of the whole's")
    for bend in bends:
        speed, t_end = BENDS[bend]
        whole = run_whole(bar(divisions), speed, t_end)
        size = np.linalg.norm(whole.way - whole.way[0], axis=1).max()
        report.say(
            f"| {abs(whole.turn).max():.1f} | none | {size:.4f} m | {whole.work:.1f} J | | {whole.seconds:.1f} | 1 |"
        )
        for coupling in (fm.Coupling.RIGID, fm.Coupling.AVERAGED):
            cut = run_cut(bar(divisions), speed, t_end, coupling)
            off = np.linalg.norm(cut.way - whole.way, axis=1).max() / size
            used = [utilisation(cut, name) for name in ("rest 1", "rest 2")]
            report.say(
                f"| {abs(cut.turn).max():.1f} | {coupling.name.lower()} | {100 * off:.3f} % | "
                f"{100 * (cut.work / whole.work - 1.0):+.3f} % | {used[0]:.2f}, {used[1]:.2f} | {cut.seconds:.1f} | "
                f"{cut.seconds / whole.seconds:.2f} |"
            )


def bar(divisions: tuple[int, int, int]) -> TaggedMesh:
    """The bar with its waist, along x."""
    mesh = meshes.block(DEPTHS * SIDE, SIDE, SIDE, divisions=divisions, degree=2, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    away = np.minimum(abs(x[:, 0] / SIDE - WAIST), 1.0)
    x[:, 2] *= 1.0 - 0.25 * (1.0 + np.cos(np.pi * away))
    return mesh


def run_whole(mesh: TaggedMesh, speed: float, t_end: float) -> Found:
    """The bar as one body with history."""
    rod = yielding(mesh, [Interface(name) for name in ENDS], rigid_parts={"x_max": weight()})
    scene = fm.System()
    scene.add(rod, name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    return swing(scene, rod.frame("x_max"), rod, speed, t_end, bodies={"bar": rod})


def run_cut(mesh: TaggedMesh, speed: float, t_end: float, coupling: fm.Coupling) -> Found:
    """The bar in three pieces."""
    cut = cut_mesh(mesh, {"waist": fm.Slab((1, 0, 0), (WAIST - AROUND) * SIDE, (WAIST + AROUND) * SIDE)})
    scene = fm.System()
    waist: dict[str, fm.ContinuumBody] = {}
    rests: dict[str, fm.FlexibleBody] = {}
    for name, piece in cut.pieces.items():
        at_cuts = cut.interfaces(name, coupling=coupling)
        held = [Interface(end) for end in ENDS if end in piece.facet_groups]
        if name in cut.yielding:
            waist[name] = scene.add(yielding(piece, at_cuts), name=name)
            continue
        model = ContinuumModel(piece, forms.solid_linear, STEEL, degree=2, interfaces=[*held, *at_cuts])
        frame = "x_min" if "x_min" in piece.facet_groups else at_cuts[0].name
        record = craig_bampton(model, modes=MODES, frame=frame, keep=Keep(stress=True))
        rests[name] = scene.add(fm.FlexibleBody(record), name=name)
    bodies = {**waist, **rests}
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bodies["rest 1"].frame("x_min"))  # type: ignore[attr-defined]
    for one in cut.cuts:
        low, high = (bodies[name] for name in one.pieces)
        scene.connect(fm.joint.Fixed(), low.frame(one.name), high.frame(one.name))  # type: ignore[attr-defined]
    tip = bodies["rest 2"].frame("x_max")  # type: ignore[attr-defined]
    scene.connect(fm.joint.Fixed(), tip, scene.add(weight(), name="weight").frame())
    return swing(scene, tip, waist["waist"], speed, t_end, bodies=bodies)  # type: ignore[arg-type]


def yielding(mesh: TaggedMesh, interfaces: list[Interface], **parts: Any) -> fm.ContinuumBody:
    body = NonlinearModel(mesh, forms.hencky_plasticity, YIELDING, degree=2, interfaces=interfaces)
    return fm.ContinuumBody(ImplicitContinuum(body, **parts))


def weight() -> fm.RigidBody:
    """The mass at the end, a ball of 4 cm radius."""
    return fm.RigidBody(TIP, 0.4 * TIP * 0.04**2 * np.ones(3))


def swing(
    scene: fm.System,
    tip: Frame,
    body: fm.ContinuumBody,
    speed: float,
    t_end: float,
    *,
    bodies: Mapping[str, fm.FlexibleBody | fm.ContinuumBody],
) -> Found:
    """Push the end and follow it."""
    t = np.linspace(0.0, 2.0 * PUSH, 81)
    push = np.where(t < PUSH, 2.0 * TIP * speed / PUSH * np.sin(np.pi * t / PUSH) ** 2, 0.0)
    table = fm.Table(np.append(t, [0.05, 1.0]), np.append(push, [0.0, 0.0]))
    scene.add_force(fm.force.FrameForce(tip, force=(0.0, 0.0, table)))
    scene.simulate(2 * STEP, h=STEP, integrator=fm.GeneralizedAlpha(rho=0.8))  # compiles
    begun = time.thread_time()
    run = scene.simulate(t_end, h=STEP, integrator=fm.GeneralizedAlpha(rho=0.8))
    seconds = time.thread_time() - begun
    R = run.rotation(tip)
    turn = np.degrees(np.arctan2(-R[:, 2, 0], R[:, 0, 0]))
    return Found(run.position(tip), turn, float(run.energies(body)["plastic"][-1]), seconds, run, bodies)


def utilisation(found: Found, name: str) -> float:
    """Of a remainder."""
    body = found.bodies[name]
    assert isinstance(body, fm.FlexibleBody)
    return float(fm.YieldMonitor(body, yield_stress=YIELD).over(found.run).largest.utilisation)


if __name__ == "__main__":
    raise SystemExit(main())
