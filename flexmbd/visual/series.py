"""Series over time, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.visual.destination import checked_path, write
from flexmbd.visual.library import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexmbd.trajectory import Trajectory

FloatArray = NDArray[np.float64]

#: What ``plot_series`` writes.
SUFFIXES = (".pdf", ".png", ".svg")


def plot_series(
    trajectory: Trajectory,
    series: Sequence[tuple[str, ArrayLike]] = (),
    *,
    path: str | Path | None = None,
    ylabel: str = "",
    title: str = "",
) -> Figure:
    """Draw series over the trajectory's times; without any, its energies.

    Collective over the trajectory's team where ``path`` is given; its root writes.

    Args:
        trajectory: gives the times t (nt,).
        series: pairs (label, values), values (nt,) or (nt, k); k columns become k lines.
        path: .png, .pdf or .svg to write; an existing file survives a failure.  Without it the
            figure is pyplot's, to be shown by a notebook or ``matplotlib.pyplot.show()``.
        ylabel: what the values are, with their unit.
        title: of the picture.

    Returns:
        The figure, to be drawn on further.

    Raises:
        PictureError: values do not fit the times, or the file cannot be written.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    lines = _lines(trajectory, series)
    if not series:
        ylabel = ylabel or "energy in J"
    figure = _figure(shown=target is None)
    axes = figure.subplots()
    _draw(axes, trajectory.t, lines)
    axes.set_xlabel("time in s")
    axes.set_ylabel(ylabel or (lines[0][0] if len(axes.lines) == 1 else ""))
    axes.set_title(title)
    if target is not None:
        error = None
        if trajectory.team.is_root:
            try:
                write(target, lambda temporary: figure.savefig(temporary, dpi=150))
            except PictureError as caught:
                error = caught
        trajectory.team.fail(error)
    return figure


def _lines(
    trajectory: Trajectory, series: Sequence[tuple[str, ArrayLike]]
) -> list[tuple[str, FloatArray]]:
    if not series:
        energy = trajectory.energy()
        parts = {name: getattr(energy, name) for name in ("kinetic", "elastic", "gravitational", "spring")}
        # parts that a machine does not have are left out
        shown = {name: part for name, part in parts.items() if part.any()}
        series = [*shown.items(), ("total", energy.total)]
    lines = []
    for label, given in series:
        values = np.asarray(given, dtype=np.float64)
        if values.ndim not in (1, 2) or len(values) != len(trajectory.t):
            raise PictureError(
                f"series {label!r} has shape {values.shape}; it needs one row for each of the "
                f"{len(trajectory.t)} instants of the trajectory"
            )
        lines.append((label, values))
    return lines


def _figure(*, shown: bool) -> Figure:
    """A figure of pyplot's where it is to be shown; else one that nothing else holds."""
    owner = load("matplotlib.pyplot").figure if shown else load("matplotlib.figure").Figure
    figure: Figure = owner(figsize=(8.0, 4.5), layout="constrained")
    return figure


def _draw(axes: Axes, t: ArrayLike, lines: Sequence[tuple[str, FloatArray]]) -> None:
    for label, values in lines:
        if values.ndim == 1:
            axes.plot(t, values, label=label, linewidth=1.4)
            continue
        names = "xyz" if values.shape[1] == 3 else [f"[{k}]" for k in range(values.shape[1])]
        for name, column in zip(names, values.T, strict=True):
            axes.plot(t, column, label=f"{label} {name}", linewidth=1.4)
    axes.grid(color="0.9")
    axes.spines[["top", "right"]].set_visible(False)
    if len(axes.lines) > 1:
        axes.legend(frameon=False)
