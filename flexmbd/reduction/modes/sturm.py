"""How many modes lie below a frequency, by the signs of a factor's pivots, and whether all of them were found.

By Sylvester's law of inertia K - sigma M has as many negative pivots as there are eigenvalues below sigma.  Unknowns
without mass bring those of their own stiffness besides, as pressures do one each (`saddle_point`); averages that are
held at zero, C u = 0, change the count to that of the bordered matrix [[K - sigma M, C^T], [C, 0]] less their number;
a body that nothing holds has six rigid modes.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from flexmbd.continuum.matrices.blocks import inner, multiply, symmetric
from flexmbd.continuum.matrices.saddle_point import fill_empty_rows, negative_directions, principal_part
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.reduction.modes.eigensolver import ModeSearch
from flexmbd.reduction.modes.krylov_schur import shift_after
from flexmbd.reduction.static_shapes.factor import Factor, TooLargeError
from flexmbd.reduction.static_shapes.memory import memory_limit
from flexmbd.reduction.static_shapes.statics import Statics

# Relative gap of eigenvalues in which a count is sound, and how often more modes are looked for to find one.
_GAP, _MORE, _TIMES = 1e-3, 4, 4
# Power iteration on 1 - B^-1 A: vectors, steps, and what is well below one.
_COLUMNS, _POWERS, _NEAR = 4, 8, 0.5


def count_below(statics: Statics, eigenvalue: float) -> int:
    """Number of modes with all interfaces fixed below an eigenvalue (1/s^2). Collective.

    Where two factors do not fit in memory that of the statics is given up, and made again when it is needed. A
    compressed factor B of A = K - sigma M counts as well where no eigenvalue of B^-1 A is negative: then no matrix on
    the way from A to B is singular, and both have the same signs.

    Raises:
        TooLargeError: on all ranks: the factor would not fit in memory, alone neither.
        ReductionError: on all ranks: the eigenvalue is one of the body's, or a compressed factor tells nothing.
    """
    model, columns = statics.model, statics.held_averages
    shifted = principal_part(model.K, statics.mask)
    shifted.axpy(-eigenvalue, statics.M, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    if model.ties is not None:
        fill_empty_rows(shifted, model.tied_dofs[statics.mask])
    factor: Factor | None = None
    try:
        # of unknowns without mass, for which K - sigma M is K
        owed = negative_directions(shifted, statics.massless)
        factor = _indefinite_factor(statics, shifted)
        if statics.tolerance > 0.0:
            _check_nearness(factor, shifted)
        count = factor.negative_pivots - owed
        if columns is not None:
            small = symmetric(inner(model.comm, columns, factor.solve(columns)))
            size = np.sqrt(abs(np.diag(small)))
            signs = np.linalg.eigvalsh(small / np.outer(size, size)) > 0.0
            return int(model.comm.bcast(count + int(signs.sum()) - len(small)))
        return count - (0 if statics.interfaces or statics.nodal else 6)
    finally:
        shifted.destroy()
        if factor is not None:
            factor.destroy()


def _indefinite_factor(statics: Statics, shifted: PETSc.Mat) -> Factor:
    """Beside the statics' factor where there is room for both, else in its place. Collective."""
    for alone in (False, True):
        if alone:
            statics.release_factor()
        try:
            limit = memory_limit(statics.model.comm)
            return Factor(shifted, definite=False, limit=limit, tolerance=statics.tolerance)
        except TooLargeError:
            if alone:
                raise
    raise AssertionError


def _check_nearness(factor: Factor, matrix: PETSc.Mat) -> None:
    """Refuse a factor B of A where power iteration finds 1 - B^-1 A not well below one. Collective."""
    comm = matrix.comm.tompi4py()
    rest = np.random.default_rng(comm.rank).normal(size=(matrix.getLocalSize()[0], _COLUMNS)).copy(order="F")
    for _ in range(_POWERS):
        rest /= np.sqrt(np.diag(inner(comm, rest, rest)))
        rest = np.asfortranarray(rest - factor.solve(multiply(matrix, rest)))
    size = float(np.sqrt(np.diag(inner(comm, rest, rest)).max()))
    if not size < _NEAR:
        raise ReductionError(
            f"the compressed factor of K - sigma M has a relative error of {size:.1e}, bound {_NEAR:g}, so that its "
            "Sturm count is not reliable; take solver=Solver.DIRECT, or Truncation(..., complete=False)"
        )


def confirmed(statics: Statics, search: ModeSearch, count: int) -> str:
    """Make sure that the `count` lowest modes were found, and go on with the search where not. Collective.

    Returns:
        What was done, for the record's provenance.

    Raises:
        ConvergenceError: on all ranks: modes are missing that the search does not find.
    """
    if count == 0:
        return "none"
    if not statics.has_factor:
        search.search_again()
        return "not counted, for there is no factor; searched again from generic directions"
    for _ in range(_TIMES):
        shift, below = _shift(search, count)
        if below == 0:
            return "all there are"
        try:
            there = count_below(statics, shift)
        except TooLargeError:
            return "not counted, for a second factor would not fit in memory"
        hertz = np.sqrt(shift) / (2.0 * np.pi)
        if there == below:
            return f"counted, {there} below {hertz:.6g} Hz"
        if there < below:
            raise ReductionError(
                f"{below} fixed-interface modes were found below {hertz:.6g} Hz, and the Sturm count is {there}: "
                "round-off hides the softest modes; check whether the mesh is very thin or has slivers"
            )
        search.search_below(shift, there)
    raise ConvergenceError(
        f"modes are missing below {hertz:.6g} Hz, {there} by the Sturm count; take eigensolver=BlockMethod(), or more "
        "modes"
    )


def _shift(search: ModeSearch, count: int) -> tuple[float, int]:
    """A shift above the `count` lowest in a wide gap, and the number found below; zeros where all modes are known."""
    for _ in range(_TIMES):
        if search.exhausted and len(search.eigenvalues) <= count:
            return 0.0, 0
        if len(search.eigenvalues) > count:
            shift, below = shift_after(search.eigenvalues, count)
            if search.eigenvalues[below] > (1.0 + _GAP) * search.eigenvalues[below - 1] or search.exhausted:
                break
        search.find(count, spare=len(search.eigenvalues) - count + _MORE)
    return shift, below
