"""Of benchmark pictures: one legend for all panels, below them; colours that differ; plain ticks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from flexmbd.visual.palette import body_colours


def legend_below(figure: Figure, panels: Iterable[Axes], *, columns: int, size: float = 11.0) -> None:
    """One legend of all labels of some panels, each once, below them."""
    handles: dict[str, Any] = {}
    for panel in panels:
        drawn, labels = panel.get_legend_handles_labels()
        handles |= {label: line for label, line in zip(labels, drawn, strict=True) if label not in handles}
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=columns, fontsize=size, frameon=False
    )


def colours(names: Iterable[Any]) -> dict[Any, str]:
    """A colour for each of these."""
    listed = list(dict.fromkeys(names))
    return dict(zip(listed, body_colours(len(listed)), strict=True))


def plain_ticks(axes: Axes) -> None:
    """On logarithmic axes powers of ten alone have labels, and over less than a decade and a half 2 and 5 of each."""
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if high < 30.0 * low:
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
