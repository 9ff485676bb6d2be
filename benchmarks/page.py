"""docs/benchmarks.md, written from the results that are kept; nobody copies a number.

`benchmarks/page/head.md` stands first. Each benchmark follows with its own text (the docstring of its file), the
tables and pictures of its last whole run with what it was measured on, and `benchmarks/page/NAME.md` where there are
figures of earlier states that were measured by hand and have not been run again by the command.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import results
from discovery import benchmarks, text_of

HERE = Path(__file__).resolve().parent
TARGET = results.ROOT / "docs" / "benchmarks.md"
BY_HAND = HERE / "page"


def write() -> None:
    """Write docs/benchmarks.md."""
    TARGET.write_text(text(), encoding="utf-8")


def text() -> str:
    """The page, from what is kept in this checkout."""
    head = (BY_HAND / "head.md").read_text(encoding="utf-8").strip()
    return "\n\n".join([head, *_kept()]) + "\n"


def of_run(found: Sequence[results.Result], folder: Path) -> str:
    """The page of one run: machine and versions of each benchmark, tables, pictures, failures."""
    parts = ["# Benchmarks"]
    for result in found:
        parts += [f"## {result.name}", *_shown(result, f"{result.name}/")]
    return "\n\n".join(parts) + "\n"


def _kept() -> Iterator[str]:
    """Benchmarks in the order of their names."""
    for source in benchmarks():
        kept, by_hand = results.RESULTS / f"{source.stem}.json", BY_HAND / f"{source.stem}.md"
        yield f"## {source.stem}"
        yield _about(source)
        if kept.exists():
            yield from _shown(results.load(kept), "pictures/")
        else:
            yield "Not yet run as a whole by the command."
        if by_hand.exists():
            yield "### Measured by hand"
            yield by_hand.read_text(encoding="utf-8").strip()


def _about(source: Path) -> str:
    """The text of a benchmark; what it indents, as calls of it, as a block."""
    parts = []
    for part in text_of(source).split("\n\n"):
        block = all(line.startswith("    ") for line in part.splitlines())
        parts.append(f"```text\n{textwrap.dedent(part)}\n```" if block else part)
    return "\n\n".join(parts)


def _shown(result: results.Result, pictures: str) -> Iterator[str]:
    yield f"{'Short run, ' if result.quick else ''}{result.seconds:.0f} s. {result.setting.text()}"
    if result.failure:
        yield f"**Failed**: {result.failure}"
    if result.lines:
        yield "\n".join(_blocks(result.lines))
    yield from (f"![{name}]({pictures}{name})" for name in result.pictures)


def _blocks(lines: Sequence[str]) -> Iterator[str]:
    """Lines of tables as they are, each other line a paragraph."""
    before = ""
    for line in lines:
        if line and before and not (line.startswith("|") and before.startswith("|")):
            yield ""
        if line or before:
            yield line
        before = line
