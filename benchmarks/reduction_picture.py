"""The picture of the reduction benchmark over the dofs: time on each mesher's meshes, memory, stages of ours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from reduction_rows import LARGE, power

Row = dict[str, Any]

# by code and ranks, the same in all panels
STYLES = {
    ("flexmbd", 1): ("flexmbd", "C0", "o-"),
    ("flexmbd", 2): ("flexmbd, two ranks", "C0", "o:"),
    ("flexmbd, iterative", 2): ("without a factor, two ranks", "C9", "x:"),
    ("exudyn, scipy", 1): ("exudyn, scipy", "C3", "s-"),
    ("exudyn, NGSolve", 1): ("exudyn, NGSolve", "C1", "v-"),
    ("NGSolve", 1): ("NGSolve, Arnoldi", "C2", "^-"),
}
STAGES = ("assembly", "factor", "static shapes", "responses to loads", "modes", "projection")


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the rows and write a PNG file."""
    figure, panels = plt.subplots(2, 2, figsize=(11.0, 12.0), layout="constrained")
    gmsh, netgen, memory, stages = panels.ravel()
    for (code, ranks), (label, color, style) in STYLES.items():
        for axes, mesher in ((gmsh, "gmsh"), (netgen, "netgen")):
            mine = _of(rows, mesher, code, ranks)
            _line(axes, mine, lambda row: row["seconds"]["total"], label, color, style)
        _line(memory, _of(rows, "gmsh", code, ranks), lambda row: row["memory"]["peak"] / 1e6, label, color, style)
    ours = _of(rows, "gmsh", "flexmbd", 1)
    for i, stage in enumerate(STAGES):
        there = [row for row in ours if row["seconds"].get(stage)]
        _line(stages, there, lambda row, stage=stage: row["seconds"][stage], stage, f"C{i}", "o-")
    more = [row for row in ours if row["seconds"].get("geometric")]
    _line(stages, more, lambda row: row["seconds"]["geometric"], "geometric stiffness, on top", "0.4", "d--")
    gmsh.set(ylabel="s", title="time from mesh to 19 modes, meshes by gmsh")
    netgen.set(ylabel="s", title="the same, meshes by NETGEN")
    memory.set(ylabel="MB", title="peak memory, libraries included, by gmsh")
    stages.set(ylabel="s", title="flexmbd on one rank, by stage, by gmsh")
    for axes in panels.ravel():
        _set_scales(axes)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _short(value: float, _: object) -> str:
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if value >= max(unit, 1e4):
            return f"{value / unit:g}{letter}"
    return f"{value:g}"


def _set_scales(axes: plt.Axes) -> None:
    axes.set(xlabel="dofs", xscale="log", yscale="log")
    for axis, marks in ((axes.xaxis, (1.0, 3.0)), (axes.yaxis, (1.0,))):
        axis.set_major_locator(LogLocator(subs=marks))
        axis.set_major_formatter(FuncFormatter(_short))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(which="both", alpha=0.25)
    if axes.lines:
        axes.legend(fontsize=10, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)


def _of(rows: Sequence[Row], mesher: str, code: str, ranks: int) -> list[Row]:
    found = [row for row in rows if (row["mesher"], row["code"], row["ranks"]) == (mesher, code, ranks)]
    return sorted(found, key=lambda row: row["dofs"])


def _line(
    axes: plt.Axes, rows: Sequence[Row], value: Callable[[Row], float], label: str, color: str, style: str
) -> None:
    """One line; its label says the power of the growth."""
    if not rows:
        return
    x, y = np.array([(row["dofs"], value(row)) for row in rows]).T
    large = np.greater(x, LARGE)
    slope = f" ({power(np.compress(large, x), np.compress(large, y)):.2f})" if large.sum() > 1 else ""
    axes.plot(x, y, style, color=color, label=f"{label}{slope}", markersize=4)
