"""Legends of benchmark pictures: one for all panels, below them, clear of the curves; and colours that differ."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
