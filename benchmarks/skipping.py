"""What a scene does not need, measured: each thing that ``explain`` says is skipped, with and without, in turns.

    ./run python benchmarks/skipping.py [--quick]

On one scene each time, the same machine twice: once as it is compiled, once so that the general way is taken, whose
terms come out as zero or as the identity. What is timed is forward dynamics, as explicit methods ask for it, and the
residual of the equations of motion, as implicit ones do: calls by the hundred in compiled loops, processor time, the
least of each turn. Ratios are of the least times, their ranges those turn by turn. Both ways give the same numbers,
which is checked.
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
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.plan.compiled_scene import CompiledScene

LINKS, STRAINS = 10, 5
MINUTES = 1.5
PEERS: tuple[str, ...] = ()
FOLDER = Path("out_simulation")
FORWARD, RESIDUAL = "forward dynamics", "residual"


@entry_kernel
def repeat_forward(count, plan, work, aw, x, v, a, multipliers):  # type: ignore[no-untyped-def]
    """Call forward dynamics ``count`` times."""
    for _ in range(count):
        forward_dynamics(plan, work, aw, x, v, a, multipliers)


@entry_kernel
def repeat_residual(count, plan, work, x, v, a, multipliers, out):  # type: ignore[no-untyped-def]
    """Call the residual ``count`` times."""
    for _ in range(count):
        residual(plan, work, x, v, a, multipliers, out)


@dataclass(frozen=True)
class Case:
    """A scene, and its plan in which nothing of a kind is skipped.

    Attributes:
        what: is skipped.
        where: the scene.
        short: the scene as it is compiled.
        general: its plan, general.
        table: makes a table of forward dynamics general.
    """

    what: str
    where: str
    short: CompiledScene
    general: Plan
    table: Callable[[to.ArticulatedWork], None] = lambda aw: None


def chain(*, slide: bool = False, springs: int = 0) -> tuple[fm.System, list[Any]]:
    """Ten links on hinges about z, one of them on a slide if wanted; springs of zero stiffness from links to ground."""
    scene = fm.System(gravity=(0.0, -scenes.G, 0.0))
    frame, laid = scene.ground.frame(), []
    for k in range(LINKS):
        body = scene.add(fm.RigidBody(scenes.LINK_MASS, scenes.link_inertia(), (0.5 * scenes.LINK, 0.0, 0.0)))
        joint = fm.joint.Prismatic("z") if slide and k == 1 else fm.joint.Revolute("z")
        scene.connect(joint, frame, body.frame())
        frame = body.frame(p=(scenes.LINK, 0.0, 0.0))
        for j in range(springs // LINKS):
            place = scene.ground.frame(p=(0.1 * k, 1.0 + j, 0.0))
            laid.append(scene.add_force(fm.force.SpringDamper(place, body.frame(), 0.0, 0.1)))
    return scene, laid


def beam(folder: Path, *, slide: bool = False) -> CompiledScene:
    """A beam of 20 modes on a hinge, or on a slide on which its frame does not turn."""
    record = fm.ReducedBody.load(beam_record.beam("5k", 20, folder=folder).plain)
    scene = fm.System(gravity=(0.0, -scenes.G, 0.0))
    body = scene.add(fm.FlexibleBody(record))
    joint = fm.joint.Prismatic("z") if slide else fm.joint.Revolute("z")
    scene.connect(joint, scene.ground.frame(), body.frame("start"))
    return scene.compile().scene


def turning(plan: Plan) -> Plan:
    """The plan with Coriolis and centrifugal terms of all bodies."""
    tree = plan.tree.copy()
    tree[:, at.ROTATION] = kinds.ROTATING
    return plan.replace(tree=tree)


def damped(plan: Plan) -> Plan:
    """The plan with modal damping, of a matrix of zeros."""
    flex, n = plan.flex.copy(), int(plan.flex[0, at.N_MODES])
    flex[0, at.MODAL_DAMPING] = len(plan.modal)
    return plan.replace(flex=flex, modal=np.concatenate([plan.modal, np.zeros(n * n)]))


def stretched(plan: Plan) -> Plan:
    """The plan with membrane strains that are zero."""
    flex, n = plan.flex.copy(), int(plan.flex[0, at.N_MODES])
    flex[0, at.STRETCH], flex[0, at.N_STRETCH] = len(plan.modal), STRAINS
    return plan.replace(flex=flex, modal=np.concatenate([plan.modal, np.zeros(STRAINS * (n + n * (n + 1) // 2))]))


def out_of_plane(aw: to.ArticulatedWork) -> None:
    """Let the recursion run in space."""
    aw.planar[0] = 0


def turned(aw: to.ArticulatedWork) -> None:
    """Let every joint's axes be turned against its parent's, by the identity."""
    aw.planar[0] = 0
    aw.link[:, to.FORM] = np.where(aw.link[:, to.FORM] <= to.ALIGNED, to.TURNED, aw.link[:, to.FORM])


def cases(folder: Path) -> list[Case]:
    """All that is measured."""
    flat, spatial = chain()[0].compile().scene, chain(slide=True)[0].compile().scene
    idle, springs = chain(springs=2 * LINKS)
    parameters = {f"k{i}": fm.parameter.OfForce(spring, "stiffness") for i, spring in enumerate(springs)}
    kept = idle.compile(parameters=parameters).scene.plan
    hinged, sliding = beam(folder), beam(folder, slide=True)
    ten, beam_text = f"{LINKS} links", "beam, 20 modes"
    return [
        Case("terms out of the hinges' plane", f"{ten}, parallel hinges", flat, flat.plan, out_of_plane),
        Case("rotations by the identity", f"{ten}, one slide", spatial, spatial.plan, turned),
        Case("20 springs of zero stiffness", f"{ten}, parallel hinges", idle.compile().scene, kept),
        Case("modal damping (zero)", f"{beam_text}, hinge", hinged, damped(hinged.plan)),
        Case(f"{STRAINS} membrane strains (none)", f"{beam_text}, hinge", hinged, stretched(hinged.plan)),
        Case("Coriolis and centrifugal terms", f"{beam_text}, slide", sliding, turning(sliding.plan)),
    ]


def calls_of(case: Case) -> dict[str, tuple[Callable[[int], None], Callable[[int], None]]]:
    """By what is evaluated the repeated calls, short way and general one; both are checked to agree."""
    scene = case.short
    rng = np.random.default_rng(0)
    x, v = scene.start + 1e-2 * rng.standard_normal(scene.nx), rng.standard_normal(scene.nv)
    none, found = np.zeros(0), np.zeros((2, 2, scene.nv))
    calls: list[list[Callable[[int], None]]] = []
    for k, plan in enumerate((scene.plan, case.general)):
        work, aw = new_work(plan), to.new_articulated_work(plan)
        if k == 1:
            case.table(aw)
        a, force = found[k]

        def forward(count: int, own: Any = (plan, work, aw), a: np.ndarray = a) -> None:
            repeat_forward(count, own[0], own[1], own[2], x, v, a, none)

        def inverse(count: int, own: Any = (plan, work), out: np.ndarray = force) -> None:
            repeat_residual(count, own[0], own[1], x, v, np.zeros(len(v)), none, out)

        forward(1)
        inverse(1)
        calls.append([forward, inverse])
    for short, general in found.transpose(1, 0, 2):
        np.testing.assert_allclose(short, general, rtol=1e-9, atol=1e-9 * np.abs(general).max())
    (f0, r0), (f1, r1) = calls
    both = {FORWARD: (f0, f1), RESIDUAL: (r0, r1)}
    return {FORWARD: both[FORWARD]} if case.general is scene.plan else both  # its table is forward dynamics' alone


def least(call: Callable[[int], None], count: int, repeats: int) -> float:
    """The least processor time (us) of a call among ``count``."""
    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        call(count)
        best = min(best, time.process_time() - began)
    return 1e6 * best / count


@dataclass(frozen=True)
class Row:
    """Times (us) of a case's turns: the general way and the short one."""

    case: Case
    evaluated: str
    general: np.ndarray
    short: np.ndarray

    @property
    def ratios(self) -> np.ndarray:
        """(turns,) of the general way's time over the short one's."""
        return self.general / self.short

    def text(self) -> str:
        """A row of the table."""
        ratio = self.general.min() / self.short.min()
        span = f"{self.ratios.min():.2f} to {self.ratios.max():.2f}"
        times = f"{self.short.min():.2f} | {self.general.min():.2f}"
        return f"| {self.case.what} | {self.case.where} | {self.evaluated} | {times} | {ratio:.2f} | {span} |"


def measure(case: Case, *, turns: int, repeats: int) -> list[Row]:
    """Both ways in turns, for forward dynamics and for the residual."""
    rows = []
    for evaluated, (short, general) in calls_of(case).items():
        count = max(1, int(2000.0 / least(general, 100, 3)))  # some 2 ms, longer than the clock's grain
        taken = np.array([[least(way, count, repeats) for way in (general, short)] for _ in range(turns)])
        rows.append(Row(case, evaluated, *taken.T))
    return rows


def draw(rows: list[Row], path: Path) -> None:
    """Bars of the general way's time over the short one's, with their ranges; forward dynamics and residual."""
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys((row.case.what, row.case.where) for row in rows))
    figure, panel = plt.subplots(figsize=(8.0, 0.7 * len(names) + 1.2), layout="constrained")
    for k, evaluated in enumerate((FORWARD, RESIDUAL)):
        mine = [row for row in rows if row.evaluated == evaluated]
        places = np.array([names.index((row.case.what, row.case.where)) for row in mine]) + 0.38 * k - 0.19
        ratios = np.array([row.general.min() / row.short.min() for row in mine])
        spread = np.array([[r - row.ratios.min(), row.ratios.max() - r] for r, row in zip(ratios, mine, strict=True)])
        panel.barh(places, ratios, 0.36, xerr=np.maximum(spread, 0.0).T, label=evaluated, color=f"C{k}", capsize=2)
    panel.axvline(1.0, color="0.4", linewidth=0.8)
    panel.set_yticks(range(len(names)), [f"{what}\n{where}" for what, where in names], fontsize=8)
    panel.invert_yaxis()
    panel.set_xlabel("time where it is computed over time where it is skipped")
    panel.legend(fontsize=8)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def quick(report: Report) -> None:
    """Few turns."""
    tell(report, turns=2, repeats=3)


def full(report: Report) -> None:
    """Seven turns of fifteen."""
    tell(report, turns=7, repeats=15)


def tell(report: Report, *, turns: int, repeats: int, folder: Path = FOLDER) -> None:
    """Table and picture of all cases."""
    report.table("skipped", "scene", "evaluated", "skipped, us", "computed, us", "ratio", "turn by turn")
    rows = []
    for case in cases(folder):
        for row in measure(case, turns=turns, repeats=repeats):
            report.say(row.text())
            rows.append(row)
    report.picture("skipping.png", partial(draw, rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few turns")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of the beam's record")
    chosen = parser.parse_args()
    few = chosen.quick
    tell(Report(chosen.folder), turns=3 if few else 7, repeats=5 if few else 15, folder=chosen.folder)


if __name__ == "__main__":
    main()
