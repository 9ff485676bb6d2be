"""How many fixed-interface modes a reduction keeps: a number, all below a frequency, or enough for a tolerance."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, replace
from numbers import Real

from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.reduction.modes.spectrum_error import FLOOR

#: Number of elastic frequencies that a tolerance is for where no range is named.
LOWEST = 6
#: Most modes that are looked for where their number is neither given nor counted.
MOST = 500


@checked(error=ReductionError)
@dataclass(frozen=True)
class Truncation:
    """How many fixed-interface modes a reduction keeps, by exactly one of `modes`, `below_hz` and `tol`.

    Checked where it is used.  A cluster of equal frequencies is kept whole: where that adds modes the record's
    provenance says so, and a warning.

    Attributes:
        modes: number of fixed-interface modes, of a body without interfaces of free-free ones; 0 gives Guyan's
            reduction.
        below_hz: Hz; all fixed-interface modes below it. Beside `tol`: the range that this is for.
        tol: as few modes as bring the relative error of the body's eigenvalues (2 pi f)^2, about twice that of its
            frequencies, down to it, by an estimate that is not below the true error
            (`flexmbd.reduction.modes.spectrum_error`): those of the free body, and of the body held at its frame, below
            `below_hz`, by default the lowest six.
        complete: whether the modes are counted by the signs of the pivots of a second factor, K - sigma M with sigma
            above them, and looked for again where some are missing. The record's provenance says what was counted;
            there is no count without a factor.
        free: whether these are modes of the body that nothing holds, rather than of that with all interfaces fixed
            (`flexmbd.reduction.modes.free_modes`); beside `modes` or `below_hz`.
    """

    modes: int | None = None
    below_hz: float | None = None
    tol: float | None = None
    complete: bool = True
    free: bool = False

    @property
    def range(self) -> str:
        """Which frequencies a tolerance is for, in words."""
        if self.below_hz is None:
            return f"the {LOWEST} lowest frequencies"
        return f"the frequencies below {self.below_hz:g} Hz"

    @property
    def eigenvalue(self) -> float:
        """(2 pi below_hz)^2, 1/s^2; infinite without a frequency."""
        return math.inf if self.below_hz is None else (2.0 * math.pi * self.below_hz) ** 2


def chosen_truncation(choice: object) -> Truncation:
    """A number of modes or a `Truncation` as a checked `Truncation`; not collective.

    Raises:
        ReductionError: not exactly one way, apart from a frequency beside a tolerance; or a value out of range.
    """
    if not isinstance(choice, Truncation):
        return Truncation(modes=whole_number("modes", choice, least=0))
    modes, below_hz, tol = choice.modes, choice.below_hz, choice.tol
    if choice.free and tol is not None:
        raise ReductionError(
            "tol is for fixed-interface modes, whose error is estimated; beside free=True give modes or below_hz"
        )
    given = [name for name, value in (("modes", modes), ("below_hz", below_hz), ("tol", tol)) if value is not None]
    if given not in (["modes"], ["below_hz"], ["tol"], ["below_hz", "tol"]):
        raise ReductionError(
            "say how many modes by exactly one of modes (a number), below_hz (all below a frequency) and tol (as many "
            f"as it takes; below_hz beside it is its range), got {' and '.join(given) or 'none of them'}"
        )
    if modes is not None:
        return replace(choice, modes=whole_number("modes", modes, least=0))
    frequency = accuracy = None
    if below_hz is not None:
        frequency = _real_number(below_hz)
        if not 0.0 < frequency < math.inf:
            raise ReductionError(f"below_hz must be a positive frequency in Hz, got {below_hz!r}")
    if tol is not None:
        accuracy = _real_number(tol)
        if not FLOOR < accuracy < 1.0:
            raise ReductionError(
                f"tol must be a relative error between {FLOOR:.0e}, to which modes are computed, and 1, got {tol!r}"
            )
    return replace(choice, below_hz=frequency, tol=accuracy)


def whole_number(name: str, value: object, *, least: int) -> int:
    """The value as a whole number, checked.

    Raises:
        ReductionError: it is not a whole number, or below ``least``.
    """
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = -1
    if number < least or isinstance(value, bool):
        raise ReductionError(f"{name} must be a whole number from {least} on, got {value!r}")
    return number


def _real_number(value: object) -> float:
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
