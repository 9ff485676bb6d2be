"""What a benchmark is: a file of this folder with `MINUTES`, `PEERS`, `quick` and `full`; and what it reports to.

`python -m benchmarks` finds it there, or wherever its path says. The functions measure and report; nothing else of the
file is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Comparison:
    """Another program's time over flexmbd's at equal error: above 1 flexmbd is faster, below 1 the other program.

    Attributes:
        scene: as the benchmark's table names it.
        task: what is timed, as "stepping to 1e-6" or "start and stepping".
        peer: the other program and its method.
        times: the ratio.
        least, most: its range over the turns; None where the turns were not kept apart.
    """

    scene: str
    task: str
    peer: str
    times: float
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True)
class Report:
    """What a benchmark found, printed as it comes and kept.

    Attributes:
        folder: exists; for what the benchmark writes, pictures among it, and what it need not make a second time.
        lines: of markdown: rows of tables begin with `|`, other lines are text of their own.
        pictures: files in the order of the page.
        comparisons: with other programs; all of them stand in the page's first table.
    """

    folder: Path
    lines: list[str] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """Print lines of markdown, and keep them for the page."""
        print(text, flush=True)
        self.lines.extend(text.splitlines() or [""])

    def table(self, *heads: str) -> None:
        """Begin a table; its rows are said."""
        self.say(f"| {' | '.join(heads)} |")
        self.say("|---" * len(heads) + "|")

    def beside(
        self, scene: str, *, task: str, peer: str, theirs: float | Sequence[float], ours: float | Sequence[float]
    ) -> None:
        """Keep a comparison of processor times (s) at equal error: of one run each, or of several runs in turns.

        Of several the ratio is that of the medians, its range that of the ratios turn by turn.  Nothing is kept where
        either program did not come to the error, which its time that is not a number says.
        """
        others, own = np.atleast_1d(theirs), np.atleast_1d(ours)
        if not (np.isfinite(others).all() and np.isfinite(own).all()):
            return
        times = float(np.median(others) / np.median(own))
        turns = others / own if len(others) == len(own) > 1 else None
        span = (None, None) if turns is None else (float(turns.min()), float(turns.max()))
        self.comparisons.append(Comparison(scene, task, peer, times, *span))

    def picture(self, name: str, draw: Callable[[Path], object]) -> None:
        """Have a picture drawn into a file, as `beams.png`, that the page shows."""
        path = self.folder / name
        draw(path)
        self.pictures.append(path)


class Benchmark(Protocol):
    """The module of a benchmark.

    Attributes:
        MINUTES: about what `full` takes on two cores that do nothing else.
        TIMED: False where no times are measured, so that other work on the machine does no harm; may be left out.
        PEERS: distributions that it measures beside flexmbd where they are installed, and leaves out where not.
    """

    MINUTES: float
    PEERS: Iterable[str]

    @staticmethod
    def quick(report: Report) -> None:
        """Show within some ten seconds that it works."""

    @staticmethod
    def full(report: Report) -> None:
        """Measure all."""
