"""What a benchmark is: a file of this folder with `MINUTES`, `PEERS`, `quick` and `full`; and what it reports to.

`python -m benchmarks` finds it there, or wherever its path says. The functions measure and report; nothing else of the
file is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol


@dataclass(frozen=True)
class Report:
    """What a benchmark found, printed as it comes and kept.

    Attributes:
        folder: exists; for what the benchmark writes, pictures among it, and what it need not make a second time.
        lines: of markdown: rows of tables begin with `|`, other lines are text of their own.
        pictures: files in the order of the page.
    """

    folder: Path
    lines: list[str] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """Print lines of markdown, and keep them for the page."""
        print(text, flush=True)
        self.lines.extend(text.splitlines() or [""])

    def table(self, *heads: str) -> None:
        """Begin a table; its rows are said."""
        self.say(f"| {' | '.join(heads)} |")
        self.say("|---" * len(heads) + "|")

    def picture(self, name: str, draw: Callable[[Path], object]) -> None:
        """Have a picture drawn into a file, as `beams.png`, that the page shows."""
        path = self.folder / name
        draw(path)
        self.pictures.append(path)


class Benchmark(Protocol):
    """The module of a benchmark.

    Attributes:
        MINUTES: about what `full` takes on two cores that do nothing else.
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
