"""A steel ball strikes a steel beam: the reduced beam beside its mesh, force over time and processor time.

    ./run python benchmarks/struck_beam.py [--quick]

The problem of Gehr et al. 2022 (arXiv 2207.00795), whose figure is a thousand times less time than that of the full
model: a ball of 20 mm meets the middle of a beam of 150 x 15 x 10 mm at 0.3 m/s.  The full model has more than 60 000
unknowns, all of which go by central differences with lumped masses and 0.9 of the longest stable step; the reduced one
twenty modes and nine contact patches, with Hertz' law in series.  Timed are the steps of both, and the reduction;
meshes and matrices, which both need, are not.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from benchmark import Report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from verification.contact._struck_beam import Beam, Struck, model, record, unreduced
from verification.contact.sphere_on_beam import END, figures, struck

MINUTES = 5.0
PEERS: tuple[str, ...] = ()
FOLDER = Path("out_simulation")

MODES, TURNS = 20, 5
RTOLS = (1e-3, 1e-4, 1e-5)


def compare(report: Report, *, fine: int, deep: int, turns: int, cases: tuple[bool, ...]) -> None:
    """Rows of the beam, clamped and free."""
    report.table(
        "beam", "unknowns", "model", "steps", "largest force, N", "impulse", "rebound", "largest difference of force",
        "steps' time (s)", "full model's over it", "with the reduction",
    )  # fmt: skip
    histories = {}
    for clamped in cases:
        beam = Beam(clamped, fine=fine, deep=deep)
        size, name = model(beam).K.getSize()[0], "clamped" if clamped else "free"
        direct = unreduced(beam, end=END)
        most, whole = direct.force.max(), figures(direct)
        report.say(
            f"| {name} | {size} | full, central differences | {direct.steps} | {most:.1f} | 1 | 1 | | "
            f"{direct.seconds:.3g} | | |"
        )
        histories[name] = {"full": direct}
        began = time.process_time()
        part = record(beam, MODES)
        reduction = time.process_time() - began
        struck(part, clamped=clamped)  # compiles
        for rtol in RTOLS:
            times = []
            for _ in range(turns):
                found = struck(part, clamped=clamped, rtol=rtol)
                times.append(found.seconds)
            taken = float(np.median(times))
            shares = figures(found) / whole
            apart = abs(np.interp(direct.t, found.t, found.force) - direct.force).max() / most
            report.say(
                f"| {name} | {MODES} modes, 9 patches | reduced, rtol {rtol:.0e} | {found.steps} | "
                f"{found.force.max():.1f} | {shares[0]:.4f} | {shares[3]:.4f} | {100.0 * apart:.1f} % | {taken:.3g} | "
                f"{direct.seconds / taken:.0f} | {direct.seconds / (taken + reduction):.2g} |"
            )
            histories[name][f"reduced, rtol {rtol:.0e}"] = found
        report.say(f"| {name} | | reduction | | | | | | {reduction:.3g} | | |")
    report.picture("struck_beam.png", lambda path: _draw(path, histories))


def _draw(path: Path, histories: dict[str, dict[str, Struck]]) -> None:
    """Forces over time, full and reduced."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * len(histories), 3.2), layout="constrained")
    panels = figure.subplots(1, len(histories), squeeze=False)[0]
    for axes, (name, found) in zip(panels, histories.items(), strict=True):
        for (label, one), style in zip(found.items(), ("k-", "r:", "b-.", "g--"), strict=True):
            axes.plot(1e6 * one.t, one.force, style, lw=1.2, label=label)
        axes.set(title=name, xlabel="t in us", ylabel="force in N")
        axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


def quick(report: Report) -> None:
    """A coarse mesh, free alone."""
    compare(report, fine=1, deep=2, turns=1, cases=(False,))


def full(report: Report) -> None:
    """All."""
    compare(report, fine=2, deep=6, turns=TURNS, cases=(True, False))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh")
    FOLDER.mkdir(exist_ok=True)
    report = Report(FOLDER)
    (quick if parser.parse_args().quick else full)(report)


if __name__ == "__main__":
    main()
