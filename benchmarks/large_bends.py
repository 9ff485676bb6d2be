"""Beams that bend a lot: `fm.ExactBeam` beside exudyn's exact beam and ANCF cable, error over time.

A cantilever rolled up to a full circle, at rest and in motion; the flying beam and the right-angle cantilever of Simo
and Vu-Quoc; Bathe's and Bolourchi's elbow; a four-bar with a hinge askew (Bauchau et al. 2016).  Errors are of a place
at the end, over the beam's size, against closed forms, the rod's differential equations, or exudyn extrapolated;
against finer elements of the same kind where none of these is at hand.

    ./run python -m benchmarks large_bends [--quick]
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import large_bends_scenes as scenes
import matplotlib.pyplot as plt
import numpy as np
from benchmark import Report

import flexmbd as fm

MINUTES = 4.0
PEERS = ("exudyn",)
_TURN = 2.0 * np.pi * scenes.ROLLED.EI / scenes.ROLLED_LENGTH  # N m

#: A method, its elements, where it ends (m), and its processor time (s).
Found = tuple[str, int, np.ndarray, float]
OURS, EXACT, CABLE = "fm.ExactBeam", "exudyn, geometrically exact", "exudyn, ANCF cable"


def moved(scene_of: Callable[[int], tuple[fm.System, fm.Frame]], end: float, n: int, rtol: float) -> Found:
    """A scene in motion by the automatic choice, the second of two runs."""
    scene, frame = scene_of(n)
    machine = scene.compile()
    runs = [machine.simulate(end, rtol=rtol) for _ in range(2)]
    return OURS, n, runs[-1].position(frame)[-1], min(run.stats.seconds for run in runs)


def rested(scene_of: Callable[[int, float], tuple[fm.System, fm.Frame]], n: int, steps: int) -> Found:
    """A scene at rest under its load, brought up in steps."""
    began = time.process_time()
    place = scenes.statics(lambda share: scene_of(n, share), steps)
    return OURS, n, place, time.process_time() - began


def extrapolated(run: Callable[[int, float], tuple[np.ndarray, float]], n: int, h: float) -> np.ndarray:
    """The limit of an error of second order in elements and steps, of which both are halved."""
    coarse, fine = run(n, h)[0], run(2 * n, h / 2)[0]
    return fine + (fine - coarse) / 3.0


def tell(report: Report, name: str, size: float, exact: np.ndarray, against: str, found: Sequence[Found]) -> list[list]:
    """Rows of a scene; the same as numbers."""
    rows = []
    for method, n, place, seconds in found:
        error = float(np.abs(place[: len(exact)] - exact).max()) / size
        report.say(f"| {name} | {against} | {method} | {n} | {error:.1e} | {1e3 * seconds:.1f} |")
        rows.append([name, method, error, 1e3 * seconds])
    return rows


def run(report: Report, *, quick: bool) -> None:
    """All scenes."""
    peer = None
    if find_spec("exudyn") is not None:
        import large_bends_exudyn as peer
    numbers = (4, 8) if quick else (4, 8, 16, 32)
    coarse = ((8, 0.02), (16, 0.01)) if quick else ((8, 0.02), (16, 0.01), (32, 0.005), (64, 0.0025))
    finest = (16, 0.01) if quick else (64, 0.0025)
    fine = 16 if quick else 64
    report.table("scene", "against", "method", "elements a beam", "error over size", "ms")
    rows: list[list] = []

    found = [rested(lambda n, share: scenes.rolled(n, moment=share * _TURN), n, 8) for n in (3, 4)]
    if peer:
        found += [(EXACT, n, *peer.rolled_up(n, cable=False)) for n in (4, 16)]
        found += [(CABLE, n, *peer.rolled_up(n, cable=True)) for n in (8, 16)]
    rows += tell(report, "rolled up, at rest", scenes.ROLLED_LENGTH, np.zeros(2), "closed form", found)

    found = [rested(lambda n, share: scenes.elbow(n, force=share * scenes.ELBOW_FORCE), n, 4) for n in numbers]
    exact = scenes.elbow_by_shooting()
    rows += tell(report, "elbow", scenes.ELBOW_RADIUS, exact, "the rod's differential equations", found)

    for name, scene_of, end, size, other in (
        ("rolled up, moving", scenes.rolled, scenes.ROLLED_END, scenes.ROLLED_LENGTH, peer and peer.rolled),
        ("flying beam", scenes.flying, scenes.FLYING_END, scenes.ROLLED_LENGTH, peer and peer.flying),
        ("right-angle cantilever", scenes.corner, scenes.CORNER_END, scenes.CORNER_ARM, None),
        ("four-bar, a hinge askew", scenes.four_bar, scenes.BARS_END, scenes.SHORT, None),
    ):
        found = [moved(scene_of, end, n, 1e-6) for n in numbers]
        if other:
            exact, against = extrapolated(other, *finest), "exudyn, extrapolated"
            found += [(EXACT, n, *other(n, h)) for n, h in coarse]
        else:
            exact, against = moved(scene_of, end, 2 * numbers[-1] if quick else fine, 1e-8)[2], "finer elements"
        rows += tell(report, name, size, exact, against, found)
    report.picture("large_bends.png", lambda path: draw(rows, path))


def draw(rows: Sequence[Sequence], path: Path) -> None:
    """Error over time, a panel a scene."""
    names = list(dict.fromkeys(row[0] for row in rows))
    figure, panels = plt.subplots(2, 3, figsize=(13.0, 7.0), layout="constrained")
    for axes, name in zip(panels.flat, names, strict=True):
        for style, method in (("C3o-", OURS), ("C0s--", EXACT), ("C1^:", CABLE)):
            mine = [row for row in rows if row[0] == name and row[1] == method]
            if mine:
                axes.loglog([row[3] for row in mine], [max(row[2], 1e-16) for row in mine], style, label=method)
        axes.set(title=name, xlabel="processor time, ms", ylabel="error over size")
        axes.grid(which="both", alpha=0.25)
        axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def quick(report: Report) -> None:
    """Few elements."""
    run(report, quick=True)


def full(report: Report) -> None:
    """All."""
    run(report, quick=False)
