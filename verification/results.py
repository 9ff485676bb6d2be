"""What the scripts found when they last ran, kept in verification/results.json; the page is written from it.

A number that moved by less than a tenth of what its reference allows stays as it was kept, for on other processors and
in other versions of libraries last digits differ. So does a processor time that did not fall to less than half.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from verification.reference import Computed, Reference

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "verification" / "results.json"
#: Share of what a reference allows by which a number may move and stay as it is kept.
_STILL = 0.1


@dataclass(frozen=True)
class Result:
    """Of one script.

    Attributes:
        values: for each reference its numbers.
        seconds: processor time.
    """

    values: tuple[tuple[float, ...], ...]
    mesh: str
    accuracy: str
    seconds: float


def load(path: Path = KEPT) -> dict[str, Result]:
    """What is kept, by the scripts' names; nothing where there is no file."""
    if not path.exists():
        return {}
    read = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: Result(tuple(map(tuple, one["values"])), one["mesh"], one["accuracy"], one["seconds"])
        for name, one in read.items()
    }


def save(kept: Mapping[str, Result], path: Path = KEPT) -> None:
    """Write what is kept, in the order of names."""
    text = json.dumps({name: asdict(kept[name]) for name in sorted(kept)}, indent=1)
    path.write_text(text + "\n", encoding="utf-8")


def settled(
    found: Computed, kept: Result | None, *, references: tuple[Reference, ...], seconds: float, new_time: bool = False
) -> Result:
    """What to keep of what was found, by what was kept before.

    Args:
        found: by a run.
        kept: before it.
        references: of the script.
        seconds: processor time of the run.
        new_time: the time is to be that of this run.
    """
    if kept is None or len(kept.values) != len(references):
        return Result(found.values, found.mesh, found.accuracy, seconds)
    values = tuple(
        old if len(old) == len(new) and _near(new, old, reference) else new
        for new, old, reference in zip(found.values, kept.values, references, strict=True)
    )
    time = seconds if new_time or seconds < 0.5 * kept.seconds else kept.seconds
    return Result(values, found.mesh, found.accuracy, time)


def _near(new: tuple[float, ...], old: tuple[float, ...], reference: Reference) -> bool:
    """Whether the page would say the same of both, and they lie together."""
    moved = max(abs(a - b) for a, b in zip(new, old, strict=True))
    allowed = max(reference.within, abs(reference.difference(old)) if reference.fails else 0.0)
    return moved <= _STILL * allowed * reference.scale and reference.is_met(new) == reference.is_met(old)
