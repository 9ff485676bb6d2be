"""The picture of work_precision.py: a panel a scene, error over seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from picture_legend import colours, legend_below

# one style a code
STYLES = {"flexmbd": "o-"}
_OTHERS = "s--"
MEANING = """\
Each dot is a run: to the left it is
quicker, below it is nearer.

Along a line the tolerance (or the step)
becomes smaller. A line ends at a run
that is within 3e-8 of the size, or that
takes too long: a single dot was that
near at the first tolerance, 1e-3.

Below the grey line, a relative error
of 1e-6, the times are compared."""


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the rows and write a PNG file: ours in full lines with dots, exudyn's dashed with squares."""
    names = list(dict.fromkeys(row["scene"] for row in rows))
    colour = colours((row["code"], row["method"]) for row in rows)
    across = min(3, len(names))
    down = math.ceil(len(names) / across)
    with plt.rc_context({"font.size": 13}):
        figure, axes = plt.subplots(
            down, across, figsize=(4.6 * across, 3.7 * down + 1.2), layout="constrained", squeeze=False
        )
        for panel, name in zip(axes.flat, names, strict=False):
            for code, method in colour:
                mine = [row for row in rows if (row["scene"], row["code"], row["method"]) == (name, code, method)]
                if mine:
                    x, y = [row["solve"] for row in mine], [row["error"] for row in mine]
                    style, label = STYLES.get(code, _OTHERS), f"{code} {method}"
                    panel.loglog(x, y, style, color=colour[code, method], markersize=5, linewidth=1.8, label=label)
            panel.axhline(1e-6, color="0.6", linewidth=0.8)
            panel.set_title(name)
            panel.grid(which="major", alpha=0.3)
        spare = list(axes.flat)[len(names) :]
        for panel in spare:
            panel.set_axis_off()
        if spare:
            spare[0].text(0.04, 0.96, MEANING, va="top", transform=spare[0].transAxes)
        for panel in list(axes.flat)[max(0, len(names) - across) : len(names)]:
            panel.set_xlabel("processor time in s")
        figure.supylabel("relative error")
        legend_below(figure, axes.flat, columns=3, size=13)
        figure.savefig(path, dpi=70)
        plt.close(figure)
