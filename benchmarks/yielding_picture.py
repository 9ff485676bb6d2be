"""The picture of yielding.py: a panel a scene, error over processor time, and one of time over cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from picture_legend import colours, legend_below, plain_ticks


def draw(rows: Sequence[Any], path: Path) -> None:
    """Draw the rows and write a PNG file; flexmbd in full lines, others dashed."""
    scenes = list(dict.fromkeys(row.scene for row in rows if row.error is not None))
    panels = len(scenes) + 1
    across = min(3, panels)
    down = math.ceil(panels / across)
    figure, axes = plt.subplots(
        down, across, figsize=(4 * across, 3.2 * down + 0.8), layout="constrained", squeeze=False
    )
    for panel, scene in zip(axes.flat, scenes, strict=False):
        for name, mine in _series(rows, scene):
            shown = [row for row in mine if row.error is not None]
            if shown:
                errors = [row.error for row in shown]
                panel.loglog([min(row.seconds) for row in shown], errors, label=name, **_look(name))
        panel.set(title=scene, xlabel="s of processor time", ylabel="relative error")
        panel.grid(which="major", alpha=0.3)
        plain_ticks(panel)
        panel.legend(fontsize=8)
    growth = axes.flat[len(scenes)]
    grown = [
        (f"{scene.split(',')[0]}, {name}", name, mine)
        for scene in dict.fromkeys(row.scene for row in rows)
        for name, mine in _series(rows, scene)
        if len({row.cells for row in mine}) > 1
    ]
    shades = colours(label for label, *_ in grown)
    for label, name, mine in grown:
        look = {"label": label, "color": shades[label], **_look(name)}
        growth.loglog([row.cells for row in mine], [min(row.seconds) for row in mine], **look)
    growth.set(title="growth", xlabel="cells", ylabel="s of processor time")
    growth.grid(which="major", alpha=0.3)
    plain_ticks(growth)
    legend_below(figure, [growth], columns=4, size=9)
    for panel in list(axes.flat)[panels:]:
        panel.set_axis_off()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _series(rows: Sequence[Any], scene: str) -> list[tuple[str, list[Any]]]:
    """Of a scene, by program or method."""
    mine = [row for row in rows if row.scene == scene]
    return [(name, [row for row in mine if row.series == name]) for name in dict.fromkeys(row.series for row in mine)]


def _look(name: str) -> dict[str, Any]:
    ours = name in ("flexmbd", "implicit", "explicit", "bricks", "solid-shells")
    return {"linestyle": "-" if ours else "--", "marker": "o" if ours else "s", "markersize": 3.5}
