"""How many modes a frequency or a tolerance asks for, by searching the spectrum as far as that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.errors import ReductionError
from flexmbd.reduction.modes.eigensolver import ModeSearch
from flexmbd.reduction.modes.spectrum_error import Spectrum, StaticPart, compute_spectrum, static_part
from flexmbd.reduction.modes.truncation import LOWEST, MOST, Truncation
from flexmbd.reduction.static_shapes.statics import Statics

# An estimate needs all modes up to this multiple of the highest eigenvalue it is for, and is then at most about twice
# the error.
_REACH = 2.0
# Where more modes are needed, so many at least, and that share of those there are.
_MORE, _GROWTH = 8, 0.25


@dataclass(frozen=True)
class RequestedModes:
    """The eigenvalues that an estimate is for: those up to a number and below a bound, 1/s^2.

    Of the free body (False), of the body held at its frame (True), or both.
    """

    supports: tuple[bool, ...]
    count: int
    below: float

    def number(self, spectrum: Spectrum, *, held: bool) -> int:
        """How many eigenvalues these are, of the free body or of the one held at its frame."""
        return min(self.count, int(np.sum(spectrum.lower_bounds(held=held) < self.below)))

    def highest(self, spectrum: Spectrum) -> float:
        """1/s^2, the highest of them, or the bound where there is one."""
        if math.isfinite(self.below):
            return self.below
        return max(float(spectrum.lower_bounds(held=held)[: self.count].max(initial=0.0)) for held in self.supports)

    def error(self, spectrum: Spectrum, modes: int) -> float:
        """The largest of the errors with so many modes."""
        numbers = {held: self.number(spectrum, held=held) for held in self.supports}
        return max(float(spectrum.errors(modes, n, held=held).max(initial=0.0)) for held, n in numbers.items())


def count_below(search: ModeSearch, truncation: Truncation) -> int:
    """Number of modes below a frequency. Collective."""
    _find_beyond(search, truncation.eigenvalue)
    count = int(np.sum(search.eigenvalues < truncation.eigenvalue))
    if count == 0:
        raise ReductionError(
            f"no mode with all interfaces fixed lies below {truncation.below_hz:g} Hz: the first has "
            f"{hertz(search.eigenvalues[0]):.6g} Hz; raise below_hz, or ask for modes=0"
        )
    return count


def count_for_tolerance(
    statics: Statics, search: ModeSearch, truncation: Truncation, *, tol: float
) -> tuple[int, float]:
    """The smallest number of modes that fulfils a tolerance, and the estimated error then. Collective."""
    comm = statics.model.comm
    static = static_part(statics)
    # of a body without a frame on it there is nothing to hold
    supports = (False,) if statics.floating else (False, True)
    by_number = truncation.below_hz is None
    request = RequestedModes(supports, LOWEST if by_number else MOST, truncation.eigenvalue)
    spectrum = resolved_spectrum(static, search, request, comm=comm)
    parallel.on_root(comm, lambda: _check_range(spectrum, request, truncation))
    while True:
        count, error = parallel.on_root(comm, partial(_fewest_modes, spectrum, request, tol))
        if error <= tol:
            return count, error
        if search.exhausted or count >= MOST:
            raise ReductionError(
                f"no number of modes up to {count} brings the error of {truncation.range} down to {tol:g}: the "
                f"relative error of their eigenvalues (2 pi f)^2 is then still up to {error:.2e}; take a larger tol, "
                f"or modes={count}"
            )
        more = max(_MORE, int(_GROWTH * count))
        search.find(0, spare=min(count + more, MOST) + 1)
        spectrum = compute_spectrum(static, search)


def resolved_spectrum(static: StaticPart, search: ModeSearch, request: RequestedModes, *, comm: MPI.Comm) -> Spectrum:
    """Compute modes until an estimate is close to the error. Collective."""
    search.find(0, spare=_MORE)
    while True:
        spectrum = compute_spectrum(static, search)
        needed = _REACH * parallel.on_root(comm, partial(request.highest, spectrum))
        if spectrum.next >= needed:
            return spectrum
        _find_beyond(search, needed)


def _find_beyond(search: ModeSearch, eigenvalue: float) -> None:
    """Find all modes up to an eigenvalue, and one above it, if there are not too many. Collective."""
    search.find_beyond(eigenvalue, most=MOST)
    if search.count_below(eigenvalue) > MOST:
        raise ReductionError(
            f"with its interfaces fixed the body has more than {MOST} modes below {hertz(eigenvalue):.6g} Hz, which "
            "would all be needed; take a lower below_hz, or a number of modes"
        )


def _fewest_modes(spectrum: Spectrum, request: RequestedModes, tol: float) -> tuple[int, float]:
    """The smallest number of modes with an error up to the tolerance, and that error; or the most and theirs."""
    enough = min(len(spectrum.eigenvalues), MOST)
    error = request.error(spectrum, enough)
    # by bisection: more modes are never worse
    few = -1
    while error <= tol and enough - few > 1:
        middle = (few + enough) // 2
        found = request.error(spectrum, middle)
        if found <= tol:
            enough, error = middle, found
        else:
            few = middle
    return enough, error


def _check_range(spectrum: Spectrum, request: RequestedModes, truncation: Truncation) -> None:
    if all(request.number(spectrum, held=held) == 0 for held in request.supports):
        first = min(float(spectrum.lower_bounds(held=held)[0]) for held in request.supports)
        raise ReductionError(
            f"the body has no elastic frequency below {truncation.below_hz:g} Hz, to which tol would apply: the first "
            f"has {hertz(first):.6g} Hz; raise below_hz"
        )


def hertz(eigenvalue: float) -> float:
    """Hz, of an eigenvalue (2 pi f)^2."""
    return math.sqrt(eigenvalue) / (2.0 * math.pi)
