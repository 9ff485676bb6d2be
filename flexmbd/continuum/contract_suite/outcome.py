"""The result of a check of the contract: figures, or the reason why it was not run."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias


class Verdict(enum.Enum):
    """How a check ended."""

    PASS = "PASS"
    FAIL = "FAIL"
    NOTE = "NOTE"  # nothing wrong, but something to know
    SKIP = "SKIP"  # does not apply, or could not be run


@dataclass(frozen=True)
class Figure:
    """One number and the largest it may be.

    Attributes:
        name: what the number is, in words that go before it.
        value: NaN where it has none, which fails.
        limit: the largest that passes.
        remark: in words that go after it.
    """

    name: str
    value: float
    limit: float
    remark: str = ""

    @property
    def passed(self) -> bool:
        """Whether the number is there and within the limit."""
        return bool(self.value <= self.limit)

    @property
    def strain(self) -> float:
        """How near it is to the limit: above one it is beyond, infinite where there is no number."""
        if not self.value == self.value:
            return float("inf")
        return self.value / self.limit if self.limit > 0 else float(self.value > 0) * float("inf")

    def __str__(self) -> str:
        """Name and value; the limit only where it is exceeded."""
        said = f"{self.name} {self.value:.1g}"
        if not self.passed:
            said = f"{self.name} {self.value:.3g}, at most {self.limit:.1g} is allowed"
        return f"{said} ({self.remark})" if self.remark else said


@dataclass(frozen=True)
class Remark:
    """A check that has no figures.

    Attributes:
        verdict: any.
        text: why.
    """

    verdict: Verdict
    text: str


@dataclass(frozen=True)
class Raised(Remark):
    """An error that ended a check."""


Outcome: TypeAlias = Sequence[Figure] | Remark


@dataclass(frozen=True)
class Check:
    """One thing the contract asks of a form.

    Attributes:
        name: short, as a heading.
        run: on a trial, or trials of a history; its docstring says what it proves.
        remedy: what to look for in a form that fails.
    """

    name: str
    run: Callable[[Any], Outcome]
    remedy: str


def verdict(outcome: Outcome) -> Verdict:
    """How the check ended."""
    if isinstance(outcome, Remark):
        return outcome.verdict
    return Verdict.PASS if all(figure.passed for figure in outcome) else Verdict.FAIL


def attempt(check: Check, trial: Any) -> Outcome:
    """Run a check; an error of whatever kind is its failure."""
    try:
        return check.run(trial)
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        lines = str(error).strip().splitlines() or [""]
        return Raised(Verdict.FAIL, f"{type(error).__name__}: {lines[-1]}")
