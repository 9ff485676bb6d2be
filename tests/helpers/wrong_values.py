"""What is certainly wrong for a parameter, by the words of its annotation, and what becomes of a call that is given it.

Independent of how the package checks: it reads the words of an annotation alone.
"""

from __future__ import annotations

import re
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import flexmbd
from flexmbd.errors import FlexmbdError

PACKAGE = Path(flexmbd.__file__).parent


class Stranger:
    """Of no kind that anything knows."""

    def __repr__(self) -> str:
        return "Stranger()"


NAN, STRANGER = float("nan"), Stranger()
#: Wrong for each kind that an annotation names.
_WRONG: dict[str, tuple[Any, ...]] = {
    "float": ("text", True, NAN, 1j, [1.0, 2.0], STRANGER, np.eye(2)),
    "int": ("text", True, NAN, 1j, 1.5, STRANGER, [1, 2]),
    "bool": ("no", 3, NAN, STRANGER, [True]),
    "str": (3, NAN, b"a", STRANGER, ["a"]),
    "path": (3, NAN, STRANGER, ["a"]),
    "ArrayLike": ("text", 1j, NAN, STRANGER, {}, [[1.0], 2.0]),
    "several": (3, NAN, STRANGER, [STRANGER], True),
    "object": (3, NAN, STRANGER, [STRANGER], Stranger),
}
#: Neither right nor wrong everywhere: an answer or a clear error.
_EXTREME: dict[str, tuple[Any, ...]] = {
    "float": (float("inf"), -float("inf"), 1e300, -1e300, 0.0, -1.0, 10**30),
    "int": (10**30, -1),
    "ArrayLike": (float("inf"), [], [1e300] * 3, np.eye(2)),
    "str": ("no such name", ""),
    "path": ("a\0b", "", "no/such/folder/a_file"),
    "several": ([], {}, "text"),
}


def kind_of(annotation: Any) -> str | None:
    """The kind of values that an annotation names; None where anything is right, or only their use can tell."""
    words = annotation if isinstance(annotation, str) else getattr(annotation, "__forward_arg__", None)
    if words is None or words in ("Any", "object", "F", "T"):
        return None
    words = re.sub(r" \| None$", "", words)
    if "Any" in words or "TimeFunction" in words or "Output" in words or "Observed" in words or words == "LoadFactor":
        return None
    if words in ("float", "int", "bool", "str"):
        return words
    if words in ("str | Path", "Path"):
        return "path"
    if words in ("ArrayLike", "npt.ArrayLike", "FloatArray", "Axis", "Sequence[float]", "tuple[int, int]"):
        return "ArrayLike" if words != "Axis" else "object"
    if re.match(r"(Sequence|Mapping|tuple|Iterable)\[", words):
        return "several"
    return "object" if re.fullmatch(r"[A-Za-z.]+", words) else None


def is_optional(annotation: Any) -> bool:
    return "None" in str(annotation)


def wrong_for(annotation: Any) -> Iterator[tuple[Any, bool]]:
    """Values, and whether each is certainly wrong."""
    kind = kind_of(annotation)
    if kind is None:
        return
    for value in _WRONG[kind]:
        yield value, True
    if not is_optional(annotation):
        yield None, True
    for value in _EXTREME.get(kind, ()):
        yield value, False


@dataclass(frozen=True)
class Finding:
    """What is neither an answer nor one clear error: raw (another error), taken (no error), text (says not what)."""

    kind: str
    place: str
    parameter: str
    value: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind:5} {self.place}({self.parameter}={self.value}): {self.text}"


def judged(call: Callable[[], Any], place: str, parameter: str, value: Any, *, wrong: bool) -> Finding | None:
    """Call it, with the value for the parameter."""
    said = repr(value)[:60]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call()
    except FlexmbdError as error:
        text = str(error)
        known = parameter.strip("=").split(".")[-1]
        stem = known.rstrip("s").lower().replace("_", " ")
        shown = value.__name__ if isinstance(value, type) else " ".join(repr(value).split())[:20].strip("[]")
        if wrong and stem not in text.lower().replace("_", " ") and shown not in " ".join(text.split()):
            return Finding("text", place, parameter, said, text[:200])
        return None
    except Exception as error:  # noqa: BLE001  (that is what is looked for)
        where = [step for step in traceback.extract_tb(error.__traceback__) if step.filename.startswith(str(PACKAGE))]
        inside = f"{Path(where[-1].filename).name}:{where[-1].lineno}" if where else "outside"
        return Finding("raw", place, parameter, said, f"{type(error).__name__} {inside}: {str(error)[:120]}")
    return Finding("taken", place, parameter, said, "no error") if wrong else None
