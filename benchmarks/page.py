"""docs/benchmarks.md and the site's pages of all numbers, written from the kept results; nobody copies a number.

`benchmarks/page/head.md` stands first. Each benchmark follows with the first paragraph of its file's docstring, the
short tables and the pictures of its last whole run with what it was measured on, and `benchmarks/page/NAME.md` where
there are remarks or figures that were measured by hand. The site's pages, one a benchmark, have the whole docstring and
all tables.
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
#: Longer tables stand on the site alone.
_ROWS = 13


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


def write_numbers(folder: Path) -> list[str]:
    """Write a page with all numbers of each benchmark into a folder beside docs/pictures; the names of the pages."""
    names = []
    for source, kept in _with_results():
        parts = [f"# {source.stem}", _about(source), *_shown(kept, "../pictures/")]
        names.append(f"benchmark_{source.stem}")
        (folder / f"{names[-1]}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return names


def _with_results() -> Iterator[tuple[Path, results.Result]]:
    for source in benchmarks():
        kept = results.RESULTS / f"{source.stem}.json"
        if kept.exists():
            yield source, results.load(kept)


def _kept() -> Iterator[str]:
    """Benchmarks in the order of their names."""
    found = dict(_with_results())
    for source in benchmarks():
        by_hand = BY_HAND / f"{source.stem}.md"
        yield f"## {source.stem}"
        yield text_of(source).split("\n\n")[0]
        if source in found:
            yield from _short(found[source])
        else:
            yield "Not yet run as a whole by the command."
        if by_hand.exists():
            text = by_hand.read_text(encoding="utf-8").strip()
            yield text if text.startswith("What bounds") else f"Measured by hand. {text}"


def _short(result: results.Result) -> Iterator[str]:
    """Where it ran, its tables of up to `_ROWS` rows, its pictures; of other tables that they are elsewhere."""
    where = result.setting
    yield f"{where.date}, state {where.commit}, {where.machine}, load {where.load:.1f}."
    long = 0
    for block in "\n".join(_blocks(result.lines)).split("\n\n"):
        if block.startswith("|") and len(block.splitlines()) <= _ROWS + 2:
            yield block
        elif block.startswith("|"):
            long += len(block.splitlines()) - 2
    yield from (f"![{name}](pictures/{name})" for name in result.pictures)
    if long:
        yield f"{long} more rows: `benchmarks/results/{result.name}.json`."


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
