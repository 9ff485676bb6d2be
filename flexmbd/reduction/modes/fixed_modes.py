"""The fixed-interface modes that a reduction keeps, and the errors of the eigenvalues with several numbers of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.brief import brief
from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices import eigen
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ModesWarning, ReductionError, warn
from flexmbd.given import checked
from flexmbd.reduction.modes.davidson import DavidsonSearch
from flexmbd.reduction.modes.eigensolver import BlockMethod, Eigensolver, ModeSearch
from flexmbd.reduction.modes.mode_count import (
    RequestedModes,
    count_below,
    count_for_tolerance,
    hertz,
    resolved_spectrum,
)
from flexmbd.reduction.modes.signs import asymmetric_fields
from flexmbd.reduction.modes.slepc_search import slepc_search
from flexmbd.reduction.modes.spectrum_error import static_part
from flexmbd.reduction.modes.sturm import confirmed
from flexmbd.reduction.modes.sturm import count_below as inertia_below
from flexmbd.reduction.modes.truncation import LOWEST, MOST, Truncation, whole_number
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.memory import memory_limit, workspace
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.round_off import TEN_DIGITS

#: Modes beyond those that are asked for, so that a pair of equal frequencies is not cut unseen.
GUARD = 2
# Relative distance below which neighbouring eigenvalues count as equal: as equal as a mesh leaves those of a body whose
# shape has them so. Half a pair is a body that bends more easily one way than another.
_EQUAL = 1e-4
#: Basis vectors, enough for MOST modes.
SEARCH_LIMIT = 10 * MOST + 100


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

    __repr__ = brief


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
    there = _number_below(statics, truncation)
    known = truncation.modes if there is None else there
    limit = SEARCH_LIMIT if known is None else 10 * (known + GUARD) + 100
    search = _mode_search(statics, start, eigensolver, limit=limit)
    while True:
        count, provenance = _count(statics, search, truncation, there=there)
        whole = find_whole_clusters(search, count, size=statics.size)
        if not truncation.complete:
            provenance["completeness"] = "not counted"
            break
        if whole == there:
            provenance["completeness"] = f"counted, {there} below {truncation.below_hz:.6g} Hz"
            break
        before = search.eigenvalues[:whole].copy()
        provenance["completeness"] = confirmed(statics, search, whole)
        moved = abs(search.eigenvalues[:whole] - before) > TEN_DIGITS * before
        if not np.any(moved) and _whole_clusters(search.eigenvalues, whole) == whole:
            break  # else a mode was missing, and with it the number below a frequency or the end of a cluster changes
    found = search.modes(min(whole + GUARD, len(search.eigenvalues)))
    return FoundModes(whole, found, {**provenance, **_note_of_added(statics, found.eigenvalues, count, whole)})


@checked("model", "modes", "held", error=ReductionError, agree=parallel.told_to_all)
def truncation_errors(
    model: LinearModel, modes: Sequence[int], *, frame: str | None, count: int = LOWEST, held: bool = False
) -> TruncationErrors:
    """Estimate the errors of a body's frequencies by several numbers of modes. Collective.

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
    numbers = [whole_number("modes", n, least=0) for n in modes]
    count = whole_number("count", count, least=1)
    if held and frame is None:
        raise ReductionError("the body cannot be held in a frame that floats; name an interface as its frame")
    with body_statics(model, frame=frame) as statics:
        largest = max(numbers, default=0)
        _check_number(statics, largest)
        search = _mode_search(statics, asymmetric_fields(model)[statics.mask], BlockMethod())
        search.find(largest, spare=1)
        request = RequestedModes((held,), count, math.inf)
        spectrum = resolved_spectrum(static_part(statics), search, request, comm=model.comm)

    def estimate() -> TruncationErrors:
        number = request.number(spectrum, held=held)
        below = spectrum.lower_bounds(held=held)[:number]
        errors = [spectrum.errors(n, number, held=held) for n in numbers]
        return TruncationErrors(tuple(numbers), np.sqrt(below) / (2.0 * np.pi), np.reshape(errors, (-1, number)))

    return parallel.on_root(model.comm, estimate)


def _number_below(statics: Statics, truncation: Truncation) -> int | None:
    """How many modes lie below a frequency that is asked for, by inertia; None where that is not to be had. Collective.

    Raises:
        ReductionError: on all ranks: so many that they do not fit in memory.
    """
    if truncation.below_hz is None or truncation.tol is not None or not (truncation.complete and statics.has_factor):
        return None
    try:
        there = inertia_below(statics, truncation.eigenvalue)
    except ReductionError:
        return None  # no room for another factor, or the frequency is one of the body's
    comm = statics.model.comm
    shapes = 6 * len(statics.interfaces)
    limit, needed = memory_limit(comm), workspace(statics.model, shapes=shapes, modes=there)
    if limit is not None and needed > limit * comm.size:
        raise ReductionError(
            f"{there} fixed-interface modes lie below {truncation.below_hz:g} Hz; with them the reduction would take "
            f"{needed / 1e6:.0f} MB more, and {limit * comm.size / 1e6:.0f} MB are left: take a lower below_hz, or a "
            "number of modes"
        )
    return there


def _count(
    statics: Statics, search: ModeSearch, truncation: Truncation, *, there: int | None
) -> tuple[int, dict[str, str]]:
    """How many modes were asked for, by what is known of the spectrum, and what the provenance says. Collective.

    `there`: of `_number_below`.
    """
    if truncation.modes is not None:
        return truncation.modes, {}
    if there:
        search.find(0, spare=there)
        if int(np.sum(search.eigenvalues < truncation.eigenvalue)) < there:
            search.search_below(truncation.eigenvalue, there)
        return there, {"modes below": f"{truncation.below_hz:g} Hz"}
    if truncation.tol is None:
        return count_below(search, truncation), {"modes below": f"{truncation.below_hz:g} Hz"}
    count, error = count_for_tolerance(statics, search, truncation, tol=truncation.tol)
    return count, {
        "tolerance of eigenvalues": f"{truncation.tol:g} of {truncation.range}",
        "estimated error of eigenvalues": f"{error:.2e}",
    }


def find_whole_clusters(search: ModeSearch, count: int, *, size: int) -> int:
    """Find modes until the cluster that a number ends in is seen to end; returns the number with all of it. Collective.

    ``size``: dofs.
    """
    guard = GUARD
    while True:
        search.find(min(count + guard, size))
        whole = _whole_clusters(search.eigenvalues, count)
        if whole < len(search.eigenvalues) or len(search.eigenvalues) == size:
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
        f"{hertz(eigenvalues[count]):.6g} Hz have equal frequencies, and a part of them would favour a direction"
    )
    parallel.on_root(statics.model.comm, lambda: warn(text, ModesWarning))
    return {"equal frequencies": text}


def _mode_search(
    statics: Statics, start: FloatArray, eigensolver: Eigensolver, *, limit: int = SEARCH_LIMIT
) -> ModeSearch:
    if statics.size == 0:
        raise ReductionError("with its interfaces fixed the body has no modes; ask for modes=0 or refine the mesh")
    start = np.asfortranarray(start)
    if isinstance(eigensolver, BlockMethod):
        if statics.is_exact or statics.held_averages is not None:
            return eigen.BlockLanczos(statics.solve, statics.M, start=start, limit=limit)
        return DavidsonSearch(
            statics.stiffness,
            statics.M,
            statics.approximate,
            statics.noise,
            statics.deformation,
            start=start,
            size=statics.size,
            limit=limit,
        )
    return slepc_search(statics, eigensolver, start=start)


def _check_number(statics: Statics, count: int) -> None:
    if count > statics.size:
        raise ReductionError(
            f"{count} fixed-interface modes were asked for, and the interior has {statics.size} dofs; ask for fewer "
            "modes or refine the mesh"
        )
