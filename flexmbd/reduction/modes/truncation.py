"""How many fixed-interface modes a reduction keeps: a number, all below a frequency, or enough for a tolerance."""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real

from mpi4py import MPI

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices import eigen
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.given import refuse_no_truth
from flexmbd.reduction.modes.eigensolver import BlockMethod, Eigensolver, ModeSearch
from flexmbd.reduction.modes.signs import asymmetric_fields
from flexmbd.reduction.modes.slepc_search import slepc_search
from flexmbd.reduction.modes.spectrum_error import FLOOR, Spectrum, StaticPart, spectrum, static_part
from flexmbd.reduction.modes.sturm import confirmed
from flexmbd.reduction.static_shapes.statics import Statics, body_statics

#: Number of elastic frequencies that a tolerance is for where no range is named.
LOWEST = 6
#: Most modes that are looked for where their number is not given.
MOST = 500

# Modes beyond those that are asked for, so that a pair of equal frequencies is not cut unseen.
_GUARD = 2
# Relative distance below which neighbouring eigenvalues count as equal: as equal as a mesh leaves those of a body whose
# shape has them so. Half a pair is a body that bends more easily one way than another.
_EQUAL = 1e-4
# An estimate needs all modes up to this multiple of the highest eigenvalue it is for, and is then at most about twice
# the error.
_REACH = 2.0
# Where more modes are needed, so many at least, and that share of those there are.
_MORE, _GROWTH = 8, 0.25
# Basis vectors, enough for MOST modes.
_LIMIT = 10 * MOST + 100


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
    """

    modes: int | None = None
    below_hz: float | None = None
    tol: float | None = None
    complete: bool = True

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


@dataclass(frozen=True, eq=False)
class FoundModes:
    """The modes that a reduction keeps.

    Attributes:
        count: number of modes that are kept.
        modes: these and up to two more, which show whether the last one is one of a pair; of any sign.
        provenance: how their number was found.
    """

    count: int
    modes: eigen.Modes
    provenance: dict[str, str]


@dataclass(frozen=True, eq=False)
class TruncationErrors:
    """Estimated errors of a body's eigenvalues (2 pi f)^2 by its number of fixed-interface modes.

    Attributes:
        modes: (r,) the numbers of modes.
        frequencies: (f,) Hz, lower bounds of the unreduced body's elastic frequencies, ascending.
        errors: (r, f) relative, about twice those of the frequencies; infinite where the reduced body has
            no such frequency.
    """

    modes: tuple[int, ...]
    frequencies: FloatArray
    errors: FloatArray


def chosen_truncation(choice: object) -> Truncation:
    """What was asked for, a number of modes or a `Truncation`, checked; not collective.

    Raises:
        ReductionError: not exactly one way, apart from a frequency beside a tolerance; or a value out of range.
    """
    if not isinstance(choice, Truncation):
        return Truncation(modes=_whole("modes", choice, least=0))
    modes, below_hz, tol = choice.modes, choice.below_hz, choice.tol
    refuse_no_truth(ReductionError, complete=choice.complete)
    given = [name for name, value in (("modes", modes), ("below_hz", below_hz), ("tol", tol)) if value is not None]
    if given not in (["modes"], ["below_hz"], ["tol"], ["below_hz", "tol"]):
        raise ReductionError(
            "say how many modes by exactly one of modes (a number), below_hz (all below a frequency) and tol (as many "
            f"as it takes; below_hz beside it is its range), got {' and '.join(given) or 'none of them'}"
        )
    if modes is not None:
        return replace(choice, modes=_whole("modes", modes, least=0))
    frequency = accuracy = None
    if below_hz is not None:
        frequency = _real(below_hz)
        if not 0.0 < frequency < math.inf:
            raise ReductionError(f"below_hz must be a positive frequency in Hz, got {below_hz!r}")
    if tol is not None:
        accuracy = _real(tol)
        if not FLOOR < accuracy < 1.0:
            raise ReductionError(
                f"tol must be a relative error between {FLOOR:.0e}, to which modes are computed, and 1, got {tol!r}"
            )
    return replace(choice, below_hz=frequency, tol=accuracy)


def fixed_interface_modes(
    statics: Statics,
    truncation: Truncation,
    *,
    start: FloatArray,
    eigensolver: Eigensolver,
) -> FoundModes:
    """The lowest modes with all interfaces fixed, as many as were asked for, clusters whole. Collective.

    Args:
        statics: of the body.
        truncation: what was asked for.
        start: (rows of `statics.mask`, b) start block of the eigensolver.
        eigensolver: the method.

    Raises:
        ReductionError: on all ranks: there are fewer modes; no frequency lies in the range; or no number of modes up
            to `MOST` is enough.
        ConvergenceError: on all ranks: the eigensolver did not converge.
    """
    if truncation.modes is not None:
        _check_number(statics, truncation.modes)
        if truncation.modes == 0:
            return FoundModes(0, eigen.Modes(np.zeros(0), np.zeros((len(start), 0))), {})
    limit = _LIMIT if truncation.modes is None else 10 * (truncation.modes + _GUARD) + 100
    process = _process(statics, start, eigensolver, limit=limit)
    while True:
        count, provenance = _count(statics, process, truncation)
        whole = _find_whole_clusters(process, count, size=statics.size)
        if not truncation.complete:
            provenance["completeness"] = "not counted"
            break
        before = process.eigenvalues[:whole].copy()
        provenance["completeness"] = confirmed(statics, process, whole)
        if np.array_equal(process.eigenvalues[:whole], before):
            break  # else a mode was missing, and with it the number below a frequency or the end of a cluster changes
    found = process.modes(min(whole + _GUARD, len(process.eigenvalues)))
    return FoundModes(whole, found, {**provenance, **_note_of_added(statics, found.eigenvalues, count, whole)})


def truncation_errors(
    model: LinearModel, modes: Sequence[int], *, frame: str | None, count: int = LOWEST, held: bool = False
) -> TruncationErrors:
    """Estimate what several numbers of modes do to a body's frequencies. Collective.

    Costs about as much as one reduction to the largest of them. An estimate is not below the true error against the
    unreduced body, and at most about twice that (`flexmbd.reduction.modes.spectrum_error`).

    Args:
        model: the body.
        modes: numbers of fixed-interface modes.
        frame: as for `craig_bampton`.
        count: number of elastic frequencies, from the lowest on.
        held: of the body held at its frame, rather than free.

    Raises:
        ReductionError: on all ranks: a number that is none, or of more modes than there are; a floating body that is
            to be held; or more than `MOST` modes needed for the estimate.
        InterfaceError: on all ranks: no interface `frame`.
        ConvergenceError: on all ranks: the eigensolver did not converge.
    """
    parallel.check_same(model.comm, ReductionError, modes=list(modes), frame=frame, count=count, held=held)
    numbers = [_whole("modes", n, least=0) for n in modes]
    count = _whole("count", count, least=1)
    if held and frame is None:
        raise ReductionError("a body whose frame floats cannot be held there; name an interface as its frame")
    with body_statics(model, frame=frame) as statics:
        largest = max(numbers, default=0)
        _check_number(statics, largest)
        process = _process(statics, asymmetric_fields(model)[statics.mask], BlockMethod())
        process.find(largest, spare=1)
        wanted = _Wanted((held,), count, math.inf)
        known = _resolved(static_part(statics), process, wanted, comm=model.comm)

    def estimate() -> TruncationErrors:
        number = wanted.number(known, held=held)
        below = known.lower_bounds(held=held)[:number]
        errors = [known.errors(n, number, held=held) for n in numbers]
        return TruncationErrors(tuple(numbers), np.sqrt(below) / (2.0 * np.pi), np.reshape(errors, (-1, number)))

    return parallel.on_root(model.comm, estimate)


@dataclass(frozen=True)
class _Wanted:
    """The eigenvalues that an estimate is for: those up to a number and below a bound, 1/s^2.

    Of the free body (False), of the body held at its frame (True), or both.
    """

    supports: tuple[bool, ...]
    count: int
    below: float

    def number(self, known: Spectrum, *, held: bool) -> int:
        return min(self.count, int(np.sum(known.lower_bounds(held=held) < self.below)))

    def highest(self, known: Spectrum) -> float:
        if math.isfinite(self.below):
            return self.below
        return max(float(known.lower_bounds(held=held)[: self.count].max(initial=0.0)) for held in self.supports)

    def error(self, known: Spectrum, modes: int) -> float:
        """The largest of the errors with so many modes."""
        numbers = {held: self.number(known, held=held) for held in self.supports}
        return max(float(known.errors(modes, n, held=held).max(initial=0.0)) for held, n in numbers.items())


def _count(statics: Statics, process: ModeSearch, truncation: Truncation) -> tuple[int, dict[str, str]]:
    """How many modes were asked for, by what is known of the spectrum, and what the provenance says. Collective."""
    if truncation.modes is not None:
        return truncation.modes, {}
    if truncation.tol is None:
        return _count_below(process, truncation), {"modes below": f"{truncation.below_hz:g} Hz"}
    count, error = _count_for_tolerance(statics, process, truncation, tol=truncation.tol)
    return count, {
        "tolerance of eigenvalues": f"{truncation.tol:g} of {truncation.range}",
        "estimated error of eigenvalues": f"{error:.2e}",
    }


def _find_whole_clusters(process: ModeSearch, count: int, *, size: int) -> int:
    """Find modes until the cluster that a number ends in is seen to end; returns the number with all of it. Collective.

    ``size``: dofs.
    """
    guard = _GUARD
    while True:
        process.find(min(count + guard, size))
        whole = _whole_clusters(process.eigenvalues, count)
        if whole < len(process.eigenvalues) or len(process.eigenvalues) == size:
            return whole
        guard *= 2


def _whole_clusters(eigenvalues: FloatArray, count: int) -> int:
    """The least number of modes, from a number on, that cuts no cluster of equal frequencies in two."""
    while 0 < count < len(eigenvalues) and eigenvalues[count] - eigenvalues[count - 1] <= _EQUAL * eigenvalues[count]:
        count += 1
    return count


def _note_of_added(statics: Statics, eigenvalues: FloatArray, count: int, whole: int) -> dict[str, str]:
    """Tell of modes beyond those that were asked for: for the provenance, and as a warning on the first rank."""
    if whole == count:
        return {}
    text = (
        f"{whole} fixed-interface modes, {whole - count} more than asked for: those at "
        f"{_hertz(eigenvalues[count]):.6g} Hz have equal frequencies, and a part of them would favour a direction"
    )
    if statics.model.comm.rank == 0:
        warnings.warn(text, UserWarning, stacklevel=2)
    return {"equal frequencies": text}


def _process(
    statics: Statics, start: FloatArray, eigensolver: Eigensolver, *, limit: int = _LIMIT
) -> ModeSearch:
    if statics.size == 0:
        raise ReductionError("with its interfaces fixed the body has no modes; ask for modes=0 or refine the mesh")
    start = np.asfortranarray(start)
    if isinstance(eigensolver, BlockMethod):
        return eigen.BlockLanczos(statics.solve, statics.M, start=start, limit=limit)
    return slepc_search(statics, eigensolver, start=start)


def _check_number(statics: Statics, count: int) -> None:
    if count > statics.size:
        raise ReductionError(
            f"{count} fixed-interface modes were asked for, and the interior has {statics.size} dofs; ask for fewer "
            "modes or refine the mesh"
        )


def _count_below(process: ModeSearch, truncation: Truncation) -> int:
    """Number of modes below a frequency. Collective."""
    _find_beyond(process, truncation.eigenvalue)
    count = int(np.sum(process.eigenvalues < truncation.eigenvalue))
    if count == 0:
        raise ReductionError(
            f"no mode with all interfaces fixed lies below {truncation.below_hz:g} Hz: the first has "
            f"{_hertz(process.eigenvalues[0]):.6g} Hz; raise below_hz, or ask for modes=0"
        )
    return count


def _count_for_tolerance(
    statics: Statics, process: ModeSearch, truncation: Truncation, *, tol: float
) -> tuple[int, float]:
    """The smallest number of modes that fulfils a tolerance, and the estimated error then. Collective."""
    comm = statics.model.comm
    static = static_part(statics)
    # of a body without a frame on it there is nothing to hold
    supports = (False,) if statics.floating else (False, True)
    by_number = truncation.below_hz is None
    wanted = _Wanted(supports, LOWEST if by_number else MOST, truncation.eigenvalue)
    known = _resolved(static, process, wanted, comm=comm)
    parallel.on_root(comm, lambda: _check_range(known, wanted, truncation))
    while True:
        count, error = parallel.on_root(comm, partial(_fewest_modes, known, wanted, tol))
        if error <= tol:
            return count, error
        if process.exhausted or count >= MOST:
            raise ReductionError(
                f"no number of modes up to {count} brings the error of {truncation.range} down to {tol:g}: the "
                f"relative error of their eigenvalues (2 pi f)^2 is then still up to {error:.2e}; take a larger tol, "
                f"or modes={count}"
            )
        more = max(_MORE, int(_GROWTH * count))
        process.find(0, spare=min(count + more, MOST) + 1)
        known = spectrum(static, process)


def _resolved(static: StaticPart, process: ModeSearch, wanted: _Wanted, *, comm: MPI.Comm) -> Spectrum:
    """Compute modes until an estimate is close to the error. Collective."""
    process.find(0, spare=_MORE)
    while True:
        known = spectrum(static, process)
        needed = _REACH * parallel.on_root(comm, partial(wanted.highest, known))
        if known.next >= needed:
            return known
        _find_beyond(process, needed)


def _find_beyond(process: ModeSearch, eigenvalue: float) -> None:
    """Find all modes up to an eigenvalue, and one above it, if there are not too many. Collective."""
    process.find_beyond(eigenvalue, most=MOST)
    if process.count_below(eigenvalue) > MOST:
        raise ReductionError(
            f"with its interfaces fixed the body has more than {MOST} modes below {_hertz(eigenvalue):.6g} Hz, which "
            "would all be needed; take a lower below_hz, or a number of modes"
        )


def _fewest_modes(known: Spectrum, wanted: _Wanted, tol: float) -> tuple[int, float]:
    """The smallest number of modes with an error up to the tolerance, and that error; or the most and theirs."""
    enough = min(len(known.eigenvalues), MOST)
    error = wanted.error(known, enough)
    # by bisection: more modes are never worse
    few = -1
    while error <= tol and enough - few > 1:
        middle = (few + enough) // 2
        found = wanted.error(known, middle)
        if found <= tol:
            enough, error = middle, found
        else:
            few = middle
    return enough, error


def _check_range(known: Spectrum, wanted: _Wanted, truncation: Truncation) -> None:
    if all(wanted.number(known, held=held) == 0 for held in wanted.supports):
        first = min(float(known.lower_bounds(held=held)[0]) for held in wanted.supports)
        raise ReductionError(
            f"the body has no elastic frequency below {truncation.below_hz:g} Hz, for which tol would be: the first "
            f"has {_hertz(first):.6g} Hz; raise below_hz"
        )


def _hertz(eigenvalue: float) -> float:
    return math.sqrt(eigenvalue) / (2.0 * math.pi)


def _whole(name: str, value: object, *, least: int) -> int:
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = -1
    if number < least or isinstance(value, bool):
        raise ReductionError(f"{name} must be a whole number from {least} on, got {value!r}")
    return number


def _real(value: object) -> float:
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
