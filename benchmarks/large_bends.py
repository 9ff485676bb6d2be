"""Beams that bend a lot: `fm.ExactBeam` beside exudyn's exact beam and ANCF cable, error over time.

A cantilever rolled up to a full circle, at rest and in motion; the flying beam and the right-angle cantilever of Simo
and Vu-Quoc; Bathe's and Bolourchi's elbow; a four-bar with a hinge askew and a rotating shaft after Bauchau et al.
2016; the Princeton beam's frequencies where it is bent.  Errors are the largest of a place at several instants, over
the beam's size, against closed forms, the rod's differential equations, or exudyn extrapolated; against finer elements
of the same kind where none of these is at hand.  Of each program those runs are told, of all methods, elements and
tolerances or steps, that no other beats both in error and in time.  The roll-up at rest is run in turns; its times are
medians of 25 rounds.

    ./run python -m benchmarks large_bends [--quick]
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import large_bends_scenes as scenes
import matplotlib.pyplot as plt
import numpy as np
from benchmark import Report
from picture_legend import legend_below, plain_ticks

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator

MINUTES = 8.0
PEERS = ("exudyn",)
MOST = 20_000  # steps, beyond which a method does not suit a scene
LONGEST = 1.0  # s, of a run, beyond which a method's tighter and finer ones are left out
_TURN = 2.0 * np.pi * scenes.ROLLED.EI / scenes.ROLLED_LENGTH  # N m
OURS, CHOSEN = "fm.ExactBeam, best method", "fm.ExactBeam, automatic choice"
EXACT, CABLE = "exudyn, geometrically exact", "exudyn, ANCF cable"
METHODS: dict[str, Integrator] = {
    "central differences": fm.CentralDifference(),
    "8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    "Radau IIA": fm.RadauIIA(),
    "generalized-alpha": fm.GeneralizedAlpha(),
}


@dataclass(frozen=True)
class Found:
    """A run: whose, by what, with how many elements a beam; places on its way (k, 3) m; its processor time (s)."""

    program: str
    way: str
    elements: int
    place: np.ndarray
    seconds: float

    def error(self, exact: np.ndarray, size: float) -> float:
        """Largest of the components of all places, over a size (m)."""
        return float(np.abs(self.place[..., : exact.shape[-1]] - exact).max()) / size


SceneOf = Callable[[int], tuple[fm.System, fm.Frame]]


def moved(
    scene_of: SceneOf, end: float, numbers: Iterable[int], tolerances: Sequence[float], name: str | None
) -> list[Found]:
    """A scene in motion by a method of METHODS, or by the automatic choice; the second of two runs each."""
    found = []
    for n in numbers:
        scene, frame = scene_of(n)
        machine = scene.compile()
        for rtol in tolerances:
            method: Integrator | str = METHODS[name] if name else "auto"
            try:
                runs = [machine.simulate(end, rtol=rtol, integrator=method, max_steps=MOST) for _ in range(2)]
            except fm.FlexmbdError:
                break
            seconds = min(run.stats.seconds for run in runs)
            way = f"{name or runs[0].stats.integrator.split(',')[0]}, rtol {rtol:g}"
            places = runs[-1].position(frame, t=scenes.instants(end))
            found.append(Found(OURS if name else CHOSEN, way, n, places, seconds))
            if seconds > LONGEST:
                break
    return found


def resolved(scene_of: SceneOf, end: float, n: int) -> np.ndarray:
    """m, (instants, 3): where a scene of many elements goes by Radau IIA to rtol = 1e-8."""
    scene, frame = scene_of(n)
    return scene.simulate(end, rtol=1e-8, integrator=fm.RadauIIA()).position(frame, t=scenes.instants(end))


def front(found: Sequence[Found], exact: np.ndarray) -> list[Found]:
    """Those that no other of the same program beats in error and in time, by their time."""
    best: dict[str, float] = {}
    kept = []
    for one in sorted(found, key=lambda one: one.seconds):
        error = one.error(exact, 1.0)
        if error < best.get(one.program, np.inf):
            best[one.program] = error
            kept.append(one)
    return kept


def rested(scene_of: Callable[[int, float], tuple[fm.System, fm.Frame]], n: int, steps: int) -> Found:
    """A scene at rest under its load, brought up in steps."""
    began = time.process_time()
    place = scenes.statics(lambda share: scene_of(n, share), steps)
    return Found(OURS, f"equilibrium, {steps} steps", n, place, time.process_time() - began)


def rested_at_once(n: int) -> Found:
    """The cantilever rolled up by its whole moment in one call; the time is without what builds the scene."""
    scene, frame = scenes.rolled(n, moment=_TURN)
    began = time.process_time()
    found = scene.equilibrium()
    return Found(OURS, "equilibrium, at once", n, found.position(frame), time.process_time() - began)


def in_turns(runs: Sequence[Callable[[], Found]], rounds: int) -> list[Found]:
    """What each run finds, its time the median of all rounds."""
    found = [[run() for run in runs] for _ in range(rounds)]
    medians = np.median([[one.seconds for one in row] for row in found], axis=0)
    return [replace(one, seconds=float(seconds)) for one, seconds in zip(found[-1], medians, strict=True)]


def tell(
    report: Report, name: str, size: float, exact: np.ndarray, against: str, found: Sequence[Found]
) -> list[list[Any]]:
    """Rows of a scene; the same as numbers."""
    rows: list[list[Any]] = []
    for one in found:
        error = one.error(exact, size)
        told = f"{one.way} | {one.elements} | {error:.1e} | {1e3 * one.seconds:.1f}"
        report.say(f"| {name} | {against} | {one.program} | {told} |")
        rows.append([name, one.program, error, 1e3 * one.seconds])
    for peer in (EXACT, CABLE):
        level = max(min((row[2] for row in rows if row[1] == program), default=np.nan) for program in (OURS, peer))
        ours, theirs = (
            min((row[3] for row in rows if row[1] == program and row[2] <= level), default=np.nan)
            for program in (OURS, peer)
        )
        report.beside(name, task=f"to {level:.0e}", peer=peer, theirs=theirs, ours=ours)
    return rows


def extrapolated(run: Callable[[int, float], tuple[np.ndarray, float]], n: int, h: float) -> np.ndarray:
    """The limit of an error of second order in elements and steps, of which both are halved."""
    coarse, fine = run(n, h)[0], run(2 * n, h / 2)[0]
    return fine + (fine - coarse) / 3.0


def theirs(run: Callable[..., tuple[np.ndarray, float]], numbers: Iterable[int], steps: Iterable[float],
           *, explicit: bool) -> list[Found]:
    """exudyn's exact beam over elements and steps, by each of its solvers that takes the scene."""
    import large_bends_exudyn as peer

    solvers = {"generalized-alpha": peer.IMPLICIT, **({"RK44": peer.EXPLICIT} if explicit else {})}
    found = []
    for n in numbers:
        for h in steps:
            for name, solver in solvers.items():
                place, seconds = run(n, h, solver)
                if np.isfinite(place).all():
                    found.append(Found(EXACT, f"{name}, h {h:g}", n, place, seconds))
    return found


def run(report: Report, *, quick: bool) -> None:
    """All scenes."""
    peer = None
    if find_spec("exudyn") is not None:
        import large_bends_exudyn as peer
    numbers = (4,) if quick else (4, 8, 16, 32)
    tolerances = (1e-3,) if quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
    steps = (0.02,) if quick else (0.05, 0.02, 0.01, 0.005, 0.0025)
    fine = 8 if quick else 64
    report.table("scene", "against", "program", "method", "elements a beam", "error over size", "ms")
    rows: list[list] = []

    turns: list[Callable[[], Found]] = [partial(rested_at_once, n) for n in (3, 4)]
    turns.append(partial(rested, lambda n, share: scenes.rolled(n, moment=share * _TURN), 4, 8))
    if peer:
        for kind, numbers_of, cable in ((EXACT, (4, 16), False), (CABLE, (8, 16), True)):
            for n in numbers_of:
                turns.append(lambda kind=kind, n=n, cable=cable: Found(
                    kind, "16 steps", n, *peer.rolled_up(n, cable=cable)))
    found = in_turns(turns, 2 if quick else 25)
    rows += tell(report, "rolled up, at rest", scenes.ROLLED_LENGTH, np.zeros(2), "closed form", found)

    found = [rested(lambda n, share: scenes.elbow(n, force=share * scenes.ELBOW_FORCE), n, 4) for n in numbers]
    exact = scenes.elbow_by_shooting()
    rows += tell(report, "elbow", scenes.ELBOW_RADIUS, exact, "the rod's differential equations", found)

    for name, scene_of, end, size, other in (
        ("rolled up, moving", scenes.rolled, scenes.ROLLED_END, scenes.ROLLED_LENGTH, peer and peer.rolled),
        ("flying beam", scenes.flying, scenes.FLYING_END, scenes.ROLLED_LENGTH, peer and peer.flying),
        ("right-angle cantilever", scenes.corner, scenes.CORNER_END, scenes.CORNER_ARM, None),
        ("four-bar, a hinge askew", scenes.four_bar, scenes.BARS_END, scenes.SHORT, None),
        ("rotating shaft", scenes.shaft, scenes.SHAFT_END, scenes.SHAFT_LENGTH, None),
    ):
        found = [one for method in (*METHODS, None) for one in moved(scene_of, end, numbers, tolerances, method)]
        exact, against = resolved(scene_of, end, fine), "finer elements"
        limit = extrapolated(other, fine, 0.01 if quick else 0.0005) if other else None
        if limit is not None and not np.isfinite(limit).all():
            exact, against = exact[:, :2], "finer elements; exudyn's ended in no number"
        elif limit is not None:
            apart = float(np.abs(limit - exact[:, :2]).max()) / size
            exact, against = limit, f"exudyn, extrapolated; finer elements of ours {apart:.0e} from it"
        if other:
            found += theirs(other, numbers, steps, explicit=name == "flying beam")
        rows += tell(report, name, size, exact, against, front(found, exact))
    vibrations(report, numbers)
    report.picture("large_bends.png", lambda path: draw(rows, path))


def vibrations(report: Report, numbers: Sequence[int]) -> None:
    """Frequencies of the Princeton beam about its bent state, against Simo's and Vu-Quoc's element, extrapolated."""
    report.say()
    report.say("The Princeton beam, bent in its weak plane by 13.345 N at its tip: its first two frequencies there.")
    report.say()
    report.table("elements", "first, over the exact one less 1", "second", "ms with the equilibrium")
    exact = scenes.princeton_by_another(64)
    for n in numbers:
        began = time.process_time()
        found = scenes.princeton_frequencies(n)
        errors = [abs(found / one - 1.0).min() for one in exact]
        report.say(f"| {n} | {errors[0]:.1e} | {errors[1]:.1e} | {1e3 * (time.process_time() - began):.0f} |")


def draw(rows: Sequence[Sequence], path: Path) -> None:
    """Error over time, a panel a scene."""
    names = list(dict.fromkeys(row[0] for row in rows))
    across = min(3, len(names))
    down = -(-len(names) // across)
    figure, panels = plt.subplots(
        down, across, figsize=(4.6 * across, 3.4 * down + 0.6), layout="constrained", squeeze=False
    )
    for axes in panels.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, names, strict=False):
        for style, method in (("C3o-", OURS), ("C4x", CHOSEN), ("C0s--", EXACT), ("C1^:", CABLE)):
            mine = [row for row in rows if row[0] == name and row[1] == method]
            if mine:
                axes.loglog([row[3] for row in mine], [max(row[2], 1e-16) for row in mine], style, label=method)
        axes.set(title=name, xlabel="processor time, ms", ylabel="error over size")
        axes.grid(which="major", alpha=0.3)
        plain_ticks(axes)
    legend_below(figure, panels.flat, columns=4)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def quick(report: Report) -> None:
    """Few elements."""
    run(report, quick=True)


def full(report: Report) -> None:
    """All."""
    run(report, quick=False)
