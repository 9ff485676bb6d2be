"""docs/benchmarks.md and the site's pages of all numbers, written from the kept results; nobody copies a number.

`benchmarks/page/head.md` stands first, then one table of all comparisons with other programs, those that another
program wins before the others. Each benchmark follows with the first paragraph of its file's docstring, the short
tables and the pictures of its last whole run with what it was measured on. The site's pages, one a benchmark, have the
whole docstring and all tables.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import results
from benchmark import Comparison
from discovery import benchmarks, text_of

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tools"))

from marked_text import marked, paragraph  # noqa: E402

TARGET = results.ROOT / "docs" / "benchmarks.md"
HEAD = HERE / "page" / "head.md"
README, PAPER = results.ROOT / "README.md", results.ROOT / "paper.md"
_MARK = "beside other programs"
#: Longer tables stand on the site alone.
_ROWS = 13


def write() -> None:
    """Write docs/benchmarks.md, and what README and the paper quote of it."""
    TARGET.write_text(text(), encoding="utf-8")
    README.write_text(readme(), encoding="utf-8")
    PAPER.write_text(paper(), encoding="utf-8")


def readme() -> str:
    """README with the sentence on other programs between its two marks as the kept results give it."""
    return marked(README, _MARK, paragraph(headline()))


def paper() -> str:
    """The paper with the same sentence, a row for each other program, and what is lost."""
    return marked(PAPER, _MARK, "\n\n".join([paragraph(headline()), "\n".join(_by_program()), paragraph(lost())]))


def text() -> str:
    """The page, from what is kept in this checkout."""
    head = HEAD.read_text(encoding="utf-8").strip()
    return "\n\n".join([head, *_beside(), *_kept()]) + "\n"


def headline() -> str:
    """All comparisons in a sentence: how many are won and lost, the median ratio and both ends.  README quotes it."""
    beside = [one for _, one in _comparisons()]
    times = [one.times for one in beside]
    won = sum(one > 1.0 for one in times)
    return (
        f"In {len(times)} comparisons with other programs, each at equal error, flexmbd takes less time in {won} and "
        f"more in {len(times) - won}: another program's time is {_two_digits(np.median(times))} times flexmbd's in the "
        f"median, {_two_digits(min(times))} times where flexmbd loses most ({beside[0].scene}) and "
        f"{_two_digits(max(times))} times where it wins most ({beside[-1].scene})."
    )


def lost() -> str:
    """What takes more time than another program, by scene, in a sentence."""
    scenes: dict[str, list[str]] = {}
    for _, one in _comparisons():
        if one.times < 1.0:
            scenes.setdefault(f"{one.scene} ({one.task})", []).append(f"{one.peer} {_two_digits(one.times)}")
    told = "; ".join(f"{scene}: {', '.join(peers)}" for scene, peers in scenes.items())
    return f"What is lost, with the other program's time over flexmbd's: {told}." if told else "Nothing is lost."


def _by_program() -> Iterator[str]:
    """Of each other program how many comparisons there are, and the least, the median and the largest ratio."""
    ratios: dict[str, list[float]] = {}
    for _, one in _comparisons():
        ratios.setdefault(one.peer.split(",")[0], []).append(one.times)
    yield "| other program | comparisons | least ratio | median | largest |"
    yield "|---|---|---|---|---|"
    for peer, found in sorted(ratios.items(), key=lambda row: -len(row[1])):
        least, middle, most = (_two_digits(float(one)) for one in (min(found), np.median(found), max(found)))
        yield f"| {peer} | {len(found)} | {least} | {middle} | {most} |"


def _two_digits(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):g}"


def _comparisons() -> list[tuple[results.Result, Comparison]]:
    """Of all kept results, those that flexmbd loses first."""
    kept = (results.load(path) for path in sorted(results.RESULTS.glob("*.json")))
    beside = [(result, one) for result in kept for one in result.comparisons]
    return sorted(beside, key=lambda one: (one[1].times, one[1].scene, one[1].peer))


def _beside() -> Iterator[str]:
    """The first table, and what it was measured on."""
    beside = _comparisons()
    if not beside:
        return
    yield "## Beside other programs"
    yield headline()
    yield (
        "Another program's processor time over flexmbd's at equal error, both by their best method of those tried: "
        "below 1 the other program is faster. The range is that of the turns, where they were kept apart. Each row's "
        "section says how it was measured."
    )
    rows = ["| scene | what is timed | other program | its time over flexmbd's | section |", "|---|---|---|---|---|"]
    for result, one in beside:
        times = _two_digits(one.times)
        if one.least is not None and one.most is not None:
            times += f" ({_two_digits(one.least)} to {_two_digits(one.most)})"
        shown = f"**{times}**" if one.times < 1.0 else times
        rows.append(f"| {one.scene} | {one.task} | {one.peer} | {shown} | [{result.name}](#{result.name}) |")
    yield "\n".join(rows)
    states = dict.fromkeys(
        f"{on.machine}, load {on.load:.1f}, state {on.commit}, {on.date}" for on in (one.setting for one, _ in beside)
    )
    if len(states) > 1:
        yield "These ratios are not all of one machine and state: " + "; ".join(states) + "."


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
        yield f"## {source.stem}"
        yield text_of(source).split("\n\n")[0]
        if source in found:
            yield from _short(found[source])
        else:
            yield "Not yet run as a whole by the command."


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
