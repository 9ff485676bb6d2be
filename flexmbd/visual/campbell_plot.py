"""Campbell diagrams, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.multibody.linear.campbell import Campbell
from flexmbd.visual.destination import checked_path, save
from flexmbd.visual.palette import body_colours
from flexmbd.visual.panels import empty_figure, legend_beside, remove_frame
from flexmbd.visual.series_plot import SUFFIXES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@checked("diagram", "title", "highest", "names", "excited", error=PictureError)
def plot_campbell(
    diagram: Campbell,
    *,
    path: str | Path | None = None,
    title: str = "",
    highest: float | None = None,
    names: Sequence[str] | None = None,
    excited: Sequence[bool] | None = None,
) -> Figure:
    """Draw frequencies over the speed in turns a minute, engine orders and critical speeds.

    Collective over the diagram's team where ``path`` is given; its root writes.

    Args:
        diagram: of ``flexmbd.campbell``.
        path: .png, .pdf or .svg to write; without it the figure is pyplot's.
        title: of the picture.
        highest: Hz, up to which is drawn; by default up to the highest engine order at the highest speed, and at least
            to the lowest vibration.
        names: of the vibrations, as "forward whirl"; by default their numbers.
        excited: for each vibration whether what turns with the engine orders excites it; crossings of the others are
            drawn hollow.

    Raises:
        PictureError: there is no vibration, ``highest`` is not positive, ``names`` or ``excited`` are not as many as
            there are vibrations, or the file cannot be written.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    frequencies = diagram.frequencies
    if not np.isfinite(frequencies).any():
        raise PictureError("nothing vibrates at any of the speeds, so that there is nothing to draw")
    if highest is not None and not highest > 0.0:
        raise PictureError(f"highest = {highest} Hz must be positive")
    count = frequencies.shape[1]
    for what, given in (("names", names), ("excited", excited)):
        if given is not None and len(given) != count:
            raise PictureError(f"{what} has {len(given)} entries; the diagram has {count} vibrations: one each")
    called = names or [f"vibration {k + 1}" for k in range(count)]
    turns = diagram.speeds / (2.0 * np.pi)
    most = 1.2 * max(float(np.nanmin(frequencies)), max(diagram.orders, default=0.0) * float(turns.max()))
    top = highest or min(most, 1.05 * float(np.nanmax(frequencies)))
    figure = empty_figure((9.0, 4.5), shown=target is None)
    axes = figure.subplots()
    drawn = [k for k, branch in enumerate(frequencies.T) if np.nanmin(branch) <= top]
    for k, colour in zip(drawn, body_colours(len(drawn)), strict=True):
        axes.plot(60.0 * turns, frequencies[:, k], color=colour, linewidth=1.4, label=called[k])
    for order in diagram.orders:
        axes.plot(60.0 * turns, order * turns, color="0.6", linewidth=0.9, linestyle="--")
        end = min(float(turns.max()), top / order)
        axes.annotate(f"{order:g}x", (60.0 * end, order * end), color="0.4", fontsize="small", ha="right", va="bottom")
    for met, face, label in ((True, "black", "critical speed"), (False, "white", "crossing, not excited")):
        shown = [
            one for one in diagram.critical
            if one.frequency <= top and (excited is None or bool(excited[one.branch])) == met
        ]  # fmt: skip
        if shown:
            speeds = [60.0 * one.speed / (2.0 * np.pi) for one in shown]
            places = [one.frequency for one in shown]
            axes.plot(speeds, places, "o", color="black", markerfacecolor=face, markersize=5, label=label, zorder=3)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("speed in turns a minute")
    axes.set_ylabel("frequency in Hz")
    axes.set_title(title)
    legend_beside(axes)
    remove_frame(axes)
    if target is not None:
        save(figure, target, diagram.team)
    return figure
