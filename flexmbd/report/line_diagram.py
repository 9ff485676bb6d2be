"""Diagrams of a report: lines over one axis, in the panels' style of `flexmbd.visual`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmbd.report.contents import ReportPicture
from flexmbd.visual.palette import body_colours
from flexmbd.visual.panels import remove_frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKERS = "osD^vP*X"
_ACROSS = 2  # diagrams side by side
_DECADE = 10.0  # a logarithmic axis is this long at least
_TICKS = 8  # values on a logarithmic axis that stand there as they are


@dataclass(frozen=True)
class Line:
    """A line of a diagram.

    Attributes:
        label: in the legend; empty: not there.
        x, y: values; what is not finite, or not positive on a logarithmic axis, is left out.
        is_marked: whether its points are.
        is_joined: whether lines go from point to point.
        panel: which of the diagrams it is in, from 0.
        is_dashed: whether the lines from point to point are.
    """

    label: str
    x: Sequence[float] | NDArray[np.float64]
    y: Sequence[float] | NDArray[np.float64]
    is_marked: bool = True
    is_joined: bool = True
    panel: int = 0
    is_dashed: bool = False


def diagram(
    name: str,
    caption: str,
    lines: Sequence[Line],
    *,
    x: str,
    y: str,
    scales: tuple[str, str] = ("log", "log"),
    titles: Sequence[str] = ("",),
) -> ReportPicture:
    """Lines in one or several diagrams side by side.

    Args:
        name: of the files.
        caption: a sentence.
        lines: at least one.
        x: label of the axis that all share.
        y: label of the other axis.
        scales: of the axes, "log" or "linear".
        titles: one a diagram.
    """

    def draw(figure: Figure) -> None:
        across = min(len(titles), _ACROSS)
        grid = figure.subplots(-(-len(titles) // across), across, sharex=True, sharey=True, squeeze=False)
        panels = list(grid.flat[: len(titles)])
        for spare in grid.flat[len(titles) :]:
            spare.set_axis_off()
        labels = list(dict.fromkeys(line.label for line in lines))
        colours = dict(zip(labels, body_colours(len(labels)), strict=True))
        shown: set[str] = set()
        for line in lines:
            label = None if line.label in shown else line.label
            shown.add(line.label)
            marker = _MARKERS[labels.index(line.label) % len(_MARKERS)] if line.is_marked else "None"
            panels[line.panel].plot(
                line.x, line.y, marker=marker, label=label, color=colours[line.label], linewidth=1.4, markersize=5,
                linestyle=("--" if line.is_dashed else "-") if line.is_joined else "None",
            )  # fmt: skip
        ticks = sorted({float(one) for line in lines for one in line.x}) if scales[0] == "log" else []
        ticks = ticks if len(ticks) <= _TICKS else []
        for axes, title in zip(panels, titles, strict=True):
            axes.set_xscale(scales[0])
            axes.set_yscale(scales[1])
            axes.set_title(title)
            remove_frame(axes)
            if ticks:
                axes.set_xticks(ticks, [f"{one:g}" for one in ticks])
                axes.set_xticks([], minor=True)
        low, high = panels[0].get_ylim()
        if scales[1] == "log" and high < _DECADE * low:  # so that what hardly changes is seen not to
            middle = (low * high) ** 0.5
            panels[0].set_ylim(middle / _DECADE**0.5, middle * _DECADE**0.5)
        for axes in panels[-across:]:
            axes.set_xlabel(x)
            axes.tick_params(labelbottom=True)
        for axes in grid[:, 0]:
            axes.set_ylabel(y)
        handles = [(one, text) for axes in panels for one, text in zip(*axes.get_legend_handles_labels(), strict=True)]
        if handles:
            panels[across - 1].legend(
                *zip(*handles, strict=True), frameon=False, fontsize="small", loc="upper left",
                bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0,
            )  # fmt: skip

    height = -(-len(titles) // _ACROSS)
    return ReportPicture(name, caption, draw, (3.0 + 3.2 * _ACROSS, 1.0 + 3.2 * height))
