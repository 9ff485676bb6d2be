"""The picture of the reduction benchmark: time and memory against dofs, with slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

Row = dict[str, Any]

# by code and ranks, the same in both panels
STYLES = {
    ("flexmbd", 1): ("flexmbd", "C0", "o-"),
    ("flexmbd", 2): ("flexmbd, two ranks", "C0", "o:"),
    ("flexmbd, iterative", 2): ("flexmbd without a factor, two ranks", "C9", "x:"),
    ("exudyn, scipy", 1): ("exudyn, scipy", "C3", "s-"),
    ("exudyn, NGSolve", 1): ("exudyn, NGSolve", "C1", "v-"),
    ("NGSolve", 1): ("NGSolve, Arnoldi", "C2", "^-"),
}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the rows and write a PNG file."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 6.6), layout="constrained")
    for (code, ranks), (label, color, style) in STYLES.items():
        mine = [row for row in rows if (row["code"], row["ranks"]) == (code, ranks)]
        _line(left, mine, lambda row: row["seconds"]["total"], label, color, style)
        _line(right, mine, lambda row: row["memory"]["peak"] / 1e6, label, color, style)
    ours = [row for row in rows if (row["code"], row["ranks"]) == ("flexmbd", 1)]
    more = [row for row in ours if "geometric" in row["seconds"]]
    _line(left, ours, lambda row: row["seconds"]["factor"], "its factorisation alone", "0.45", ".--")
    _line(left, more, lambda row: row["seconds"]["geometric"], "geometric stiffness, on top", "C4", "d--")
    _line(right, more, lambda row: row["memory"]["geometric"] / 1e6, "with geometric stiffness", "C4", "d--")
    left.set(xlabel="dofs", ylabel="s", title="time from mesh to 20 modes")
    right.set(xlabel="dofs", ylabel="MB", title="peak memory, libraries included")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(which="both", alpha=0.25)
        axes.legend(fontsize=10, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _line(
    axes: plt.Axes, rows: Sequence[Row], value: Callable[[Row], float], label: str, color: str, style: str
) -> None:
    """One line; its label says the slope between the two largest sizes."""
    if not rows:
        return
    x, y = np.array([(row["dofs"], value(row)) for row in rows]).T
    slope = f" (slope {np.log(y[-1] / y[-2]) / np.log(x[-1] / x[-2]):.2f})" if len(x) > 1 else ""
    axes.plot(x, y, style, color=color, label=f"{label}{slope}", markersize=4)
