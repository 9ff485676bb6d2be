"""docs/verification.md, written from what the scripts say and what they found when they last ran."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from verification import scripts
from verification.reference import Reference, Sureness
from verification.results import ROOT, Result

TARGET = ROOT / "docs" / "verification.md"
_HEAD = """\
# Verification

Problems that others have published with numbers, computed by flexmbd. {met} of {all} quantities of {problems} problems
are met within what the digits of their sources and the meshes explain; [the others](#not-met) stand here too. Each
problem is one small file in `verification/`, which has all digits:

    ./run python -m verification --quick            # those of up to {quick:g} s, as the tests run them
    ./run python -m verification                    # all, {minutes:.0f} minutes of a core; writes this page
    ./run python -m verification machines.andrews   # some of them
    ./run python -m verification --list             # their names and times

Nobody writes a number into this page, and running all again changes nothing in it: `verification/results.json` keeps
what was found, and a number that moves by less than a tenth of what is allowed stays as it was kept. Processor times
are those of the fastest run, or of the one that was made with `--times`.

- Difference: the largest of a quantity's components, ours less published, over the largest published one or over the
  size that the problem names. Allowed: what the digits of the source and the mesh explain.
- Sure: {legend}.
- Processor time (s) is of one core, with kernels and forms compiled before, to one digit.
"""
_HEADS = ("quantity", "published", "ours", "difference", "allowed", "sure")


def text(kept: Mapping[str, Result]) -> str:
    """The page."""
    names = [name for name in scripts.names() if name in kept]
    rows = [(reference, values) for name in names for reference, values in _rows(name, kept[name])]
    head = _HEAD.format(
        met=sum(reference.is_met(values) for reference, values in rows),
        all=len(rows),
        problems=len(names),
        quick=scripts.QUICK,
        minutes=np.ceil(sum(kept[name].seconds for name in names) / 60.0),
        legend="; ".join(f"**{one.value}** {one.meaning}" for one in Sureness),
    )
    parts = [head.strip()]
    for room in scripts.ROOMS:
        here = [name for name in names if name.startswith(f"{room}.")]
        if here:
            parts.append(f"## {scripts.room_title(room)}")
            parts.extend("\n\n".join(_problem(name, kept[name])) for name in here)
    parts.append("## Not met")
    parts.append("\n".join(_failures(names, kept)) or "None.")
    return "\n\n".join(parts) + "\n"


def write(kept: Mapping[str, Result]) -> bool:
    """Write docs/verification.md where it would change; whether it did."""
    new = text(kept)
    if TARGET.exists() and TARGET.read_text(encoding="utf-8") == new:
        return False
    TARGET.write_text(new, encoding="utf-8")
    return True


def _rows(name: str, result: Result) -> Iterator[tuple[Reference, tuple[float, ...]]]:
    return zip(scripts.load(name).REFERENCES, result.values, strict=True)


def _problem(name: str, result: Result) -> Iterator[str]:
    source = scripts.load(name).SOURCE
    yield f"### {scripts.title(name)}"
    if scripts.description(name):
        yield scripts.description(name)
    doi = f", [doi:{source.doi}](https://doi.org/{source.doi})" if source.doi else ""
    means = "".join(f" {part}." for part in (result.mesh, result.accuracy) if part)
    yield f"Source: {source.text}{doi}. `verification/{name.replace('.', '/')}.py`:{means} {_time(result.seconds)} s."
    lines = [f"| {' | '.join(_HEADS)} |", "|---" * len(_HEADS) + "|"]
    for reference, values in _rows(name, result):
        unit = f" ({reference.unit})" if reference.unit else ""
        difference = reference.difference(values)
        told = f"{difference:.1e}" if reference.is_met(values) else f"**{difference:.1e}**"
        cells = (
            f"{reference.quantity}{unit}", _published(reference), _ours(reference, values), told,
            f"{reference.within:.0e}", reference.sure.value,
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    yield "\n".join(lines)


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
