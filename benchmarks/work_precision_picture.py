"""The picture of work_precision.py: a panel a scene, error over seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the rows and write a PNG file; ours in full lines, exudyn's dashed."""
    names = list(dict.fromkeys(row["scene"] for row in rows))
    series = list(dict.fromkeys((row["code"], row["method"]) for row in rows))
    across = min(3, len(names))
    down = math.ceil(len(names) / across)
    figure, axes = plt.subplots(
        down, across, figsize=(4.4 * across, 3.6 * down + 0.6), layout="constrained", squeeze=False
    )
    for panel, name in zip(axes.flat, names, strict=False):
        for k, (code, method) in enumerate(series):
            mine = [row for row in rows if (row["scene"], row["code"], row["method"]) == (name, code, method)]
            if mine:
                style = "o-" if code == "flexmbd" else "s--"
                x, y = [row["solve"] for row in mine], [row["error"] for row in mine]
                panel.loglog(x, y, style, color=f"C{k % 10}", markersize=3.5, label=f"{code} {method}")
        panel.axhline(1e-6, color="0.6", linewidth=0.8)
        panel.set(title=name, xlabel="s of processor time, stepping", ylabel="relative error")
        panel.grid(which="major", alpha=0.3)
    for panel in list(axes.flat)[len(names) :]:
        panel.set_axis_off()
    handles: dict[str, Any] = {}
    for panel in axes.flat:
        drawn, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, drawn, strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    figure.savefig(path, dpi=70)
    plt.close(figure)
