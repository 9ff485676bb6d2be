"""The interior's stiffness, whose inverse continues displacements of the boundary.

The dofs are split into boundary dofs B, which a reduction keeps or binds to a frame, and interior
dofs I.  A displacement given on B is continued by K_II u_I = -K_IB u_B (Guyan 1965, doi:10.2514/3.2874).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.compressed import TOLERANCE, CompressedInverse
from flexmbd.reduction.static_shapes.conjugate_gradients import conjugate_gradients
from flexmbd.reduction.static_shapes.degree_inverse import DegreeInverse, by_degrees
from flexmbd.reduction.static_shapes.degree_multigrid import has_lower_degree
from flexmbd.reduction.static_shapes.factor import SINGULAR, Factor, TooLargeError, operations
from flexmbd.reduction.static_shapes.memory import memory_limit, multigrid_memory
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, round_off

# Operations of a factor for each dof from which on multigrid of the degrees is quicker: on blocks of bricks from some
# 240 000 dofs on. At most so many times the square of the dofs a factor takes, that of a compact solid.
_WORTH, _COMPACT = 4e6, 20.0


class Solver(Enum):
    """How the interior's stiffness is inverted.

    A factor is the quickest up to some 200 000 dofs of a bulky body, and to more of a thin one; its memory grows with
    about the power 1.4 of the dofs. A compressed factor with a few conjugate gradients takes half of that at 10^6 dofs.
    Conjugate gradients with multigrid need time and memory in proportion to the dofs, and a positive definite
    stiffness, as the compressed factor does. The multigrid is over the degrees of the elements
    (`flexmbd.reduction.static_shapes.degree_multigrid`), or algebraic where these are linear.
    """

    DIRECT = "direct"
    COMPRESSED = "compressed"
    ITERATIVE = "iterative"


class Inverse(Protocol):
    """K_II^-1."""

    name: str

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block (interior dofs of this rank, k), N or what K_II is to be solved for. Collective."""

    def refine(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times what `solve` left of a load, to three digits at least. Collective."""

    def approximate(self, block: FloatArray) -> FloatArray:
        """Nearly that, at the least cost: symmetric, positive definite where K_II is. Collective."""


class HeldFactor:
    """K_II^-1 by a factor that can be given up while another one needs its memory, and is then made again.

    Attributes:
        name: of the method, for the record's provenance.
        memory: bytes on all ranks, by MUMPS's estimate.
        tolerance: to which it is compressed; 0: it is not.
    """

    def __init__(self, make: Callable[[], Factor | CompressedInverse]) -> None:
        """Make it. Collective."""
        self._make = make
        self._factor: Factor | CompressedInverse | None = make()
        self.name, self.memory = self._factor.name, self._factor.memory
        self.tolerance = TOLERANCE if isinstance(self._factor, CompressedInverse) else 0.0

    def solve(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._made.solve(block)

    def refine(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._made.refine(block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._made.approximate(block)

    @property
    def _made(self) -> Factor | CompressedInverse:
        if self._factor is None:
            self._factor = self._make()
        return self._factor

    def release(self) -> None:
        """Give the memory back. Collective."""
        if self._factor is not None:
            self._factor.destroy()
        self._factor = None


@dataclass(frozen=True, eq=False)
class InteriorStiffness:
    """The interior dofs of a model and the inverse of their stiffness.

    Attributes:
        mask: (owned dofs,) whether a dof of this rank is in the interior.
        M: M_II.
        inverse: of K_II.
    """

    mask: NDArray[np.bool_]
    M: PETSc.Mat
    inverse: Inverse

    def solve(self, block: FloatArray) -> FloatArray:
        """`Inverse.solve`."""
        return self.inverse.solve(block)


@contextmanager
def factorised(
    model: LinearModel, boundary: NDArray[np.bool_], *, solver: Solver | None = None, beside: int = 0
) -> Iterator[InteriorStiffness]:
    """Split the dofs and make the inverse of the interior's stiffness, for a `with` block. Collective.

    Args:
        model: with K and M.
        boundary: (owned dofs,) whether a dof of this rank is on the boundary.
        solver: the same on all ranks; None: the quickest that fits in memory.
        beside: bytes on all ranks that the rest of the reduction needs at the same time.

    Yields:
        The interior; its memory is given back at the end of the block.

    Raises:
        ReductionError: on all ranks: the solver is none; K_II is singular, or it is not definite and the solver
            neither a factor nor None; there is not enough memory, which is known before it is taken.
    """
    if solver is not None and not isinstance(solver, Solver):
        known = ", ".join(map(str, Solver))
        raise ReductionError(f"solver must be {known} or None, got {solver!r}")
    mask = ~boundary
    first = model.K.getOwnershipRange()[0]
    dofs = np.flatnonzero(mask).astype(PETSc.IntType) + first
    rows = PETSc.IS().createGeneral(dofs, comm=model.comm)
    limit = memory_limit(model.comm)
    rest = None if limit is None else limit - beside // model.comm.size
    mass = model.M.createSubMatrix(rows, rows)
    try:
        with ExitStack() as stack:
            yield InteriorStiffness(mask, mass, _inverse(model, mask, rows, stack, solver=solver, limit=rest))
    finally:
        # on several ranks nothing else does, since it takes all of them
        for item in (mass, rows):
            item.destroy()


def _inverse(
    model: LinearModel,
    mask: NDArray[np.bool_],
    rows: PETSc.IS,
    stack: ExitStack,
    *,
    solver: Solver | None,
    limit: int | None,
) -> Inverse:
    """By the solver, or by the quickest that fits in so many bytes a rank. Collective."""
    if solver in (Solver.COMPRESSED, Solver.ITERATIVE):
        _check_definite(model, solver)
    if solver is None and model.is_definite:
        iteration = _quick_iteration(model, mask, rows, stack, limit=limit)
        if iteration is not None:
            return iteration
    chosen = [solver] if solver is not None else list(Solver) if model.is_definite else [Solver.DIRECT]
    for one in chosen:
        if one is Solver.ITERATIVE:
            _check_room(model, limit)
            return _iteration(model, mask, stack)
        try:
            return _factor(model, mask, rows, stack, compressed=one is Solver.COMPRESSED, limit=limit)
        except TooLargeError:
            if one is chosen[-1]:
                raise
    raise AssertionError


def _quick_iteration(
    model: LinearModel, mask: NDArray[np.bool_], rows: PETSc.IS, stack: ExitStack, *, limit: int | None
) -> DegreeInverse | None:
    """Multigrid of the degrees, where it is quicker than a factor and fits in so many bytes a rank. Collective."""
    dofs = int(rows.getSize())
    if not has_lower_degree(model.layout) or _COMPACT * dofs < _WORTH:
        return None
    try:
        _check_room(model, limit)
    except TooLargeError:
        return None
    part = model.K.createSubMatrix(rows, rows)
    needed = operations(part)
    part.destroy()
    if needed < _WORTH * dofs:
        return None
    with ExitStack() as trial:
        inverse = trial.enter_context(by_degrees(model.K, mask, layout=model.layout))
        if inverse.is_quick():
            stack.push(trial.pop_all())
            return inverse
    return None


def _factor(
    model: LinearModel,
    mask: NDArray[np.bool_],
    rows: PETSc.IS,
    stack: ExitStack,
    *,
    compressed: bool,
    limit: int | None,
) -> HeldFactor:
    """Collective."""

    def make() -> Factor | CompressedInverse:
        stiffness = model.K.createSubMatrix(rows, rows)
        try:
            if not compressed:
                return Factor(stiffness, definite=model.is_definite, limit=limit)
            return CompressedInverse(
                model.K, mask, Factor(stiffness, definite=True, limit=limit, tolerance=TOLERANCE)
            )
        finally:
            # the factor does not need it any more
            stiffness.destroy()

    held = HeldFactor(make)
    stack.callback(held.release)
    return held


def _check_definite(model: LinearModel, solver: Solver) -> None:
    if not model.is_definite:
        raise ReductionError(
            f"the stiffness of {model.form_name} is not positive definite, as it has unknowns like pressures, so that "
            f"conjugate gradients ({solver}) cannot solve with it; take solver=Solver.DIRECT"
        )


def _check_room(model: LinearModel, limit: int | None) -> None:
    """Refuse multigrid where it would not fit in so many bytes a rank. Collective."""
    needed = multigrid_memory(model)
    if limit is not None and needed > limit * model.comm.size:
        raise TooLargeError(
            f"multigrid for the stiffness would take {needed / 1e6:.0f} MB, and "
            f"{max(limit, 0) * model.comm.size / 1e6:.0f} MB are available beside the modes and the static shapes: "
            "take fewer modes or interfaces, a coarser mesh, more memory, or several computers (mpirun)"
        )


def _iteration(model: LinearModel, mask: NDArray[np.bool_], stack: ExitStack) -> Inverse:
    """By the degrees of the elements where there is a lower one. Collective."""
    if has_lower_degree(model.layout):
        return stack.enter_context(by_degrees(model.K, mask, layout=model.layout))
    motions = model.rigid_motions(np.zeros(3), np.eye(3))
    size = model.space.dofmap.index_map_bs
    return stack.enter_context(conjugate_gradients(model.K, mask, motions=motions, block_size=size))


def continued(
    model: LinearModel, interior: InteriorStiffness, boundary: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Continue displacements of the boundary into the interior in equilibrium. Collective.

    Args:
        model: the same as that of `interior`.
        interior: factorised.
        boundary: (owned dofs, k) displacements, zero in the interior.

    Returns:
        The shapes (owned dofs, k), and K times them: the forces on the boundary.

    Raises:
        ReductionError: on all ranks: the interior is not in equilibrium.
    """
    load = multiply(model.K, boundary)
    shapes = boundary.copy(order="F")
    shapes[interior.mask] = -interior.solve(np.asfortranarray(load[interior.mask]))
    return equilibrated(model, interior.inverse.refine, shapes, mask=interior.mask)


def equilibrated(
    model: LinearModel,
    refine: Callable[[FloatArray], FloatArray],
    shapes: FloatArray,
    *,
    mask: NDArray[np.bool_],
    load: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Static shapes and K times them, once these are known to be in equilibrium. Collective.

    What is out of it by more than round-off is solved for once more (iterative refinement).

    Args:
        model: the body.
        refine: displacements under loads (rows of `mask`, k), in which the shapes stay what they are, to a few digits.
        shapes: (owned dofs, k).
        mask: (owned dofs,) where K u = f is to hold.
        load: (owned dofs, k), f; default: none.

    Raises:
        ReductionError: on all ranks: they are not.
    """

    def residual(forces: FloatArray) -> FloatArray:
        return forces if load is None else forces - load

    forces = multiply(model.K, shapes)
    with round_off(model.K) as measure:
        excess = measure.excess(residual(forces), shapes, rows=mask, load=load)
        if excess > 1.0:
            shapes = shapes.copy(order="F")
            shapes[mask] -= refine(np.asfortranarray(residual(forces)[mask]))
            forces = multiply(model.K, shapes)
            excess = measure.excess(residual(forces), shapes, rows=mask, load=load)
    if not excess <= MARGIN:
        raise ReductionError(
            f"the static shapes leave a residual in the interior that is {excess:.1e} times the round-off of its "
            f"terms, bound {MARGIN:.0f}; its stiffness is singular or nearly so: {SINGULAR}"
        )
    return shapes, forces
