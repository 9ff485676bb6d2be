"""Curves in panels: one panel a unit, the legend beside it, colours that never repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmbd.visual.library import load
from flexmbd.visual.palette import body_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

_EVENT_STYLES = ("--", ":", "-.")
_IN_A_COLUMN = 14  # names of a legend
_WIDTH, _COLUMN, _HEIGHT = 8.0, 1.6, 3.0  # inches: of a panel, of a legend's column, of a panel


@dataclass(frozen=True, eq=False)
class Curve:
    """A line of a picture: values (k,) over t (k,), in a unit, "" where it is not known."""

    label: str
    unit: str
    t: FloatArray
    values: FloatArray


def new_figure(curves: Sequence[Curve], *, shown: bool) -> Figure:
    """A figure as large as these curves need: pyplot's where it is to be shown; else one that nothing else holds."""
    panels = _by_unit(curves)
    columns = max(_legend_columns(len(members)) for members in panels.values())
    size = (_WIDTH + _COLUMN * columns, 0.8 + _HEIGHT * len(panels) if len(panels) > 1 else 4.5)
    return empty_figure(size, shown=shown)


def empty_figure(size: tuple[float, float], *, shown: bool) -> Figure:
    """A figure of this size in inches: pyplot's where it is to be shown; else one that nothing else holds."""
    owner = load("matplotlib.pyplot").figure if shown else load("matplotlib.figure").Figure
    figure: Figure = owner(figsize=size, layout="constrained")
    if shown:
        # a notebook shows pyplot's figures at a cell's end; as the cell's value it would show the same one again
        figure._ipython_display_ = partial(_leave_to_pyplot, figure)  # type: ignore[attr-defined]
    return figure


def _leave_to_pyplot(figure: Figure) -> None:
    """Display nothing of a figure that pyplot still holds; else IPython goes on to its picture."""
    if not load("matplotlib.pyplot").fignum_exists(figure.number):  # type: ignore[attr-defined]
        raise NotImplementedError


def draw_panels(
    figure: Figure,
    curves: Sequence[Curve],
    *,
    across: str,
    ylabel: str = "",
    title: str = "",
    events: Sequence[tuple[str, float]] = (),
) -> None:
    """Draw curves into a new figure, a panel for each unit in the order of the curves.

    Args:
        figure: of ``new_figure``.
        curves: at least one.
        across: label of the axis that all share.
        ylabel: of the only panel, or of the one whose unit is not known.
        title: above the first.
        events: names and times, marked by vertical lines.
    """
    panels = _by_unit(curves)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for diagram, (unit, members) in zip(axes, panels.items(), strict=True):
        for curve, colour in zip(members, body_colours(len(members)), strict=True):
            diagram.plot(curve.t, curve.values, label=curve.label, linewidth=1.4, color=colour)
        diagram.set_ylabel(_label(unit, members, ylabel, alone=len(panels) == 1))
        remove_frame(diagram)
        _mark_events(diagram, events, named=diagram is axes[0])
        if len(members) > 1 or len(panels) > 1 or (events and diagram is axes[0]):
            legend_beside(diagram, _legend_columns(len(members)))
    axes[-1].set_xlabel(across)
    axes[0].set_title(title)


def legend_beside(axes: Axes, columns: int = 1) -> None:
    """The legend to the right of a panel, clear of its curves."""
    axes.legend(
        frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, ncols=columns
    )


def remove_frame(axes: Axes) -> None:
    """A grid, and no lines at the top and the right."""
    axes.grid(color="0.9")
    axes.spines[["top", "right"]].set_visible(False)


def _by_unit(curves: Sequence[Curve]) -> dict[str, list[Curve]]:
    panels: dict[str, list[Curve]] = {}
    for curve in curves:
        panels.setdefault(curve.unit, []).append(curve)
    return panels


def _legend_columns(count: int) -> int:
    return 1 + (count - 1) // _IN_A_COLUMN


def _label(unit: str, members: Sequence[Curve], ylabel: str, *, alone: bool) -> str:
    """What stands along a panel: what it shows and its unit, as far as they are known."""
    if ylabel and (alone or not unit):
        return ylabel
    name = members[0].label if len(members) == 1 and alone else ""
    if not unit or unit == "1":
        return name
    return f"{name} in {unit}" if name else f"in {unit}"


def _mark_events(axes: Axes, events: Sequence[tuple[str, float]], *, named: bool) -> None:
    """A vertical line at each event; those of one name look alike and stand in the legend once."""
    names = list(dict.fromkeys(name for name, _ in events))
    seen: set[str] = set()
    for name, t in events:
        style = _EVENT_STYLES[names.index(name) % len(_EVENT_STYLES)]
        label = name if named and name not in seen else None
        axes.axvline(t, color="0.4", linewidth=0.9, linestyle=style, zorder=1.0, label=label)
        seen.add(name)
