"""docs/verification.md, and the site's pages of all numbers, from what the scripts say and found when they last ran.

README and the paper quote a sentence of it between marks.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from verification import scripts
from verification.reference import Reference, Sureness
from verification.results import ROOT, Result

sys.path.insert(0, str(ROOT / "tools"))

from marked_text import marked, paragraph

TARGET, README, PAPER = ROOT / "docs" / "verification.md", ROOT / "README.md", ROOT / "paper.md"
_HEAD = """\
# Verification

Problems that others have published with numbers, computed by flexmbd.

<!-- verified -->
{sentence}
<!-- end -->

[The others](#not-met) stand here too. Each problem is one small file in `verification/`:

    ./run python -m verification --quick            # those of up to {quick:g} s, as the tests run them
    ./run python -m verification                    # all, {minutes:.0f} minutes of a core; writes this page
    ./run python -m verification machines.andrews   # some of them, with all digits
    ./run python -m verification --list             # their names and times

{begin}

{summary}

{end}

Nobody writes a number into this page: `verification/results.json` keeps what was found. The site that `./run docs`
builds has each quantity, published and ours, with its source ("All numbers").

- Difference: the largest of a problem's met quantities, ours less published, over the largest published component or
  over the size that the problem names; "allowed" is what the digits of the source and the mesh explain for it.
- Sure: {legend}.
"""
#: Between these marks lies the table that the site's first page shows, too.
_BEGIN, _END = "<!-- by field -->", "<!-- end of the fields -->"
_MARK = "verified"
#: Sources of a field that the first table names.
_NAMED = 4
_FIELDS = ("field", "problems", "quantities met", "differences of these", "published by")
_PROBLEMS = ("problem", "script", "source", "met", "difference", "allowed", "sure")
_HEADS = ("quantity", "published", "ours", "difference", "allowed", "sure")


def text(kept: Mapping[str, Result]) -> str:
    """The page."""
    names = [name for name in scripts.names() if name in kept]
    head = _HEAD.format(
        sentence=paragraph(headline(kept)),
        quick=scripts.QUICK,
        minutes=np.ceil(sum(kept[name].seconds for name in names) / 60.0),
        legend="; ".join(f"**{one.value}** {one.meaning}" for one in Sureness),
        begin=_BEGIN,
        end=_END,
        summary="\n".join(_table(_FIELDS, [_field_row(room, names, kept) for room in scripts.ROOMS])),
    )
    parts = [head.strip()]
    for room in scripts.ROOMS:
        here = [name for name in names if name.startswith(f"{room}.")]
        if here:
            parts.append(f"## {scripts.room_title(room)}")
            parts.append("\n".join(_table(_PROBLEMS, [_problem_row(name, kept[name]) for name in here])))
    parts.append("## Not met")
    parts.append("\n".join(_failures(names, kept)) or "None.")
    return "\n\n".join(parts) + "\n"


def headline(kept: Mapping[str, Result]) -> str:
    """How many quantities of how many problems are met, in a sentence; README quotes it."""
    names = [name for name in scripts.names() if name in kept]
    rows = [row for name in names for row in _rows(name, kept[name])]
    met = sum(reference.is_met(values) for reference, values in rows)
    return (
        f"Of {len(rows)} quantities of {len(names)} problems {met} are met within what the digits of their sources and "
        "the meshes explain."
    )


def readme(kept: Mapping[str, Result]) -> str:
    """README with the sentence between its marks."""
    return marked(README, _MARK, paragraph(headline(kept)))


def paper(kept: Mapping[str, Result]) -> str:
    """The paper with the sentence, and the median difference of each field's met quantities."""
    names = [name for name in scripts.names() if name in kept]
    medians = []
    for room in scripts.ROOMS:
        met = _met([name for name in names if name.startswith(f"{room}.")], kept)
        if met:
            title = scripts.room_title(room)
            medians.append(f"{title[0].lower()}{title[1:]} {met[len(met) // 2]:.0e}")
    others = "The others are listed in the documentation with what is known of the reason."
    return marked(
        PAPER, _MARK, paragraph(f"{headline(kept)} Median differences of these: {', '.join(medians)}. {others}")
    )


def write_numbers(folder: Path, kept: Mapping[str, Result]) -> list[str]:
    """Write a page with all numbers of each field into a folder; the names of the pages."""
    written = []
    for room in scripts.ROOMS:
        here = [name for name in scripts.names() if name in kept and name.startswith(f"{room}.")]
        if here:
            parts = [f"# {scripts.room_title(room)}", *("\n\n".join(_problem(name, kept[name])) for name in here)]
            written.append(f"verification_{room}")
            (folder / f"{written[-1]}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return written


def write(kept: Mapping[str, Result]) -> bool:
    """Write docs/verification.md, and what README and the paper quote, where they would change; whether any did."""
    changed = False
    for target, new in ((TARGET, text(kept)), (README, readme(kept)), (PAPER, paper(kept))):
        if not target.exists() or target.read_text(encoding="utf-8") != new:
            target.write_text(new, encoding="utf-8")
            changed = True
    return changed


def _rows(name: str, result: Result) -> Iterator[tuple[Reference, tuple[float, ...]]]:
    return zip(scripts.load(name).REFERENCES, result.values, strict=True)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    yield from (f"| {' | '.join(row)} |" for row in rows)


def _field_row(room: str, names: Sequence[str], kept: Mapping[str, Result]) -> tuple[str, ...]:
    here = [name for name in names if name.startswith(f"{room}.")]
    rows = [row for name in here for row in _rows(name, kept[name])]
    met = _met(here, kept)
    spread = f"{met[0]:.0e} to {met[-1]:.0e}, median {met[len(met) // 2]:.0e}" if met else ""
    sources = list(dict.fromkeys(_authors(name) for name in here))
    told = "; ".join(sources[:_NAMED]) + (f"; {len(sources) - _NAMED} more" if len(sources) > _NAMED else "")
    return scripts.room_title(room), f"{len(here)}", f"{len(met)} of {len(rows)}", spread, told


def _met(names: Sequence[str], kept: Mapping[str, Result]) -> list[float]:
    """Differences of the quantities that are met, ascending."""
    rows = (row for name in names for row in _rows(name, kept[name]))
    return sorted(abs(reference.difference(values)) for reference, values in rows if reference.is_met(values))


def _authors(name: str) -> str:
    """Of a source what stands before its title: authors and year, or what is named first."""
    text = scripts.load(name).SOURCE.text
    named = re.match(r"[^;]{1,70}?\b(?:18|19|20)\d\d\b", text)
    return named[0] if named else re.split("[,;]", text)[0]


def _problem_row(name: str, result: Result) -> tuple[str, ...]:
    source, rows = scripts.load(name).SOURCE, list(_rows(name, result))
    met = [(reference, values) for reference, values in rows if reference.is_met(values)]
    doi = f"[{_authors(name)}](https://doi.org/{source.doi})" if source.doi else _authors(name)
    worst, values = max(met, key=lambda row: abs(row[0].difference(row[1])), default=(None, ()))
    told = (f"{abs(worst.difference(values)):.1e}", f"{worst.within:.0e}") if worst else ("", "")
    sure = ", ".join(dict.fromkeys(reference.sure.value for reference, _ in rows))
    count = f"{len(met)} of {len(rows)}"
    return scripts.title(name), f"`{name}`", doi, count if len(met) == len(rows) else f"**{count}**", *told, sure


def _problem(name: str, result: Result) -> Iterator[str]:
    source = scripts.load(name).SOURCE
    yield f"## {scripts.title(name)}"
    if scripts.description(name):
        yield scripts.description(name)
    doi = f", [doi:{source.doi}](https://doi.org/{source.doi})" if source.doi else ""
    means = "".join(f" {part}." for part in (result.mesh, result.accuracy) if part)
    yield f"Source: {source.text}{doi}. `verification/{name.replace('.', '/')}.py`:{means} {_time(result.seconds)} s."
    rows = []
    for reference, values in _rows(name, result):
        unit = f" ({reference.unit})" if reference.unit else ""
        difference = reference.difference(values)
        told = f"{difference:.1e}" if reference.is_met(values) else f"**{difference:.1e}**"
        rows.append((
            f"{reference.quantity}{unit}", _published(reference), _ours(reference, values), told,
            f"{reference.within:.0e}", reference.sure.value,
        ))  # fmt: skip
    yield "\n".join(_table(_HEADS, rows))


def _published(reference: Reference) -> str:
    return ", ".join(f"{one:.13g}" for one in reference.published)


def _ours(reference: Reference, values: tuple[float, ...]) -> str:
    """As many places as tell the difference, and no more than the published numbers are shown with."""
    least = max(reference.scale * min(reference.within, max(abs(reference.difference(values)), 1e-13)), 1e-300)
    places = int(np.clip(1 - np.floor(np.log10(least)), 0, 16))
    return ", ".join(_rounded(one, places) for one in values)


def _rounded(value: float, places: int) -> str:
    told = f"{value:.{places}f}" if abs(value) < 1e7 and places < 12 else f"{value:.13g}"
    return f"{value:.5g}" if value != 0.0 and abs(value) < 1e-4 else told


def _failures(names: list[str], kept: Mapping[str, Result]) -> Iterator[str]:
    for name in names:
        for reference, values in _rows(name, kept[name]):
            if not reference.is_met(values):
                reason = reference.fails or "not known why"
                yield f"- {scripts.title(name)}, {reference.quantity}: {reference.difference(values):.1e}. {reason}"


def _time(seconds: float) -> str:
    """To one digit."""
    return f"{float(f'{seconds:.0e}'):g}" if seconds >= 0.01 else "0.01"
