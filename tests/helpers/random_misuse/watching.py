"""One seed's statements, each tried: what is neither an answer nor one clear error is a finding."""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import flexmbd
from flexmbd.errors import FlexmbdError

PACKAGE = Path(flexmbd.__file__).parent
LONGEST = 1500  # characters of an error's text
LONG = 10.0  # s of the processor for one statement, its compilation apart

#: Which words of an error's text show that it comes from inside.
_INSIDE = ("Traceback", "numba.", "TypingError", "object at 0x", "ufunc", "broadcast", "setting an array element")


@dataclass(frozen=True)
class Finding:
    """What must not be.

    Attributes:
        kind: raw, text, nan, warning, slow; of a process also crash, hang.
        where: file and function of the package in which it arose.
        text: of the error.
        statements: that led to it.
        seed: of the machine.
    """

    kind: str
    where: str
    text: str
    statements: tuple[str, ...] = ()
    seed: int = -1

    @property
    def key(self) -> tuple[str, str]:
        return self.kind, self.where


@dataclass
class Session:
    """The statements of a seed.

    Attributes:
        clock: s of the processor, without those of compilation.
        expected: errors of the user's own functions, which may reach the user as they are.
        begin: hears of each statement before it is run.
    """

    seed: int
    clock: Callable[[], float] = time.process_time
    expected: tuple[type[BaseException], ...] = ()
    begin: Callable[[str], None] = lambda what: None
    statements: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    refused: int = 0

    def do(self, what: str, statement: Callable[[], Any]) -> Any:
        """The result of a statement, None where it was refused or failed."""
        self.statements.append(what)
        self.begin(what)
        began = self.clock()
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            result = self._tried(statement)
        if self.clock() - began > LONG:
            self._found("slow", what.split()[0], f"{self.clock() - began:.0f} s")
        for one in told:
            if Path(one.filename).is_relative_to(PACKAGE) or issubclass(one.category, RuntimeWarning):
                text = f"{one.category.__name__}: {one.message}"
                self._found("warning", f"{Path(one.filename).name}:{one.lineno}", text)
        return result

    def _tried(self, statement: Callable[[], Any]) -> Any:
        try:
            return statement()
        except self.expected:
            return None
        except FlexmbdError as error:
            self.refused += 1
            text = str(error)
            inside = [word for word in _INSIDE if word in text]
            if inside or len(text) > LONGEST or not text.strip():
                self._found("text", _place(error), f"{type(error).__name__}: {text}")
        except Exception as error:  # noqa: BLE001  (that is what is looked for)
            if isinstance(error, ValueError) and _place(error).startswith("forms/"):
                return None  # forms know nothing of flexmbd, and refuse their parameters by Python's own error
            self._found("raw", f"{type(error).__name__} {_place(error)}", f"{type(error).__name__}: {error}")
        return None

    def finite(self, what: str, values: Any) -> None:
        """Note values that are no numbers, where nobody said so."""
        array = np.asarray(values)
        if array.dtype.kind in "fc" and not np.isfinite(array).all():
            self._found("nan", what, f"{what}: {array.ravel()[:6]}")

    def _found(self, kind: str, where: str, text: str) -> None:
        self.findings.append(Finding(kind, where, text[:LONGEST], tuple(self.statements), self.seed))


def _place(error: BaseException) -> str:
    """The innermost call of the package."""
    for step in reversed(traceback.extract_tb(error.__traceback__)):
        if Path(step.filename).is_relative_to(PACKAGE):
            return f"{Path(step.filename).relative_to(PACKAGE)}:{step.name}"
    return "outside"
