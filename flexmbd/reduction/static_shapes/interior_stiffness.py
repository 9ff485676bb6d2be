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
from flexmbd.reduction.static_shapes.conjugate_gradients import conjugate_gradients
from flexmbd.reduction.static_shapes.factor import SINGULAR, Factor, TooLargeError, memory_limit
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, round_off


class Solver(Enum):
    """How the interior's stiffness is inverted.

    A factor is many times quicker; its memory grows with the power 4/3 of the dofs of a bulky body. Conjugate
    gradients with multigrid need memory in proportion to the dofs, and a positive definite stiffness.
    """

    DIRECT = "direct"
    ITERATIVE = "iterative"


class Inverse(Protocol):
    """K_II^-1."""

    name: str

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block (interior dofs of this rank, k), N or what K_II is to be solved for. Collective."""


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
    model: LinearModel, boundary: NDArray[np.bool_], *, solver: Solver | None = None
) -> Iterator[InteriorStiffness]:
    """Split the dofs and make the inverse of the interior's stiffness, for a `with` block. Collective.

    Args:
        model: with K and M.
        boundary: (owned dofs,) whether a dof of this rank is on the boundary.
        solver: the same on all ranks; None: a factor, or where that would not fit in memory conjugate gradients.

    Yields:
        The interior; its memory is given back at the end of the block.

    Raises:
        ReductionError: on all ranks: the solver is none; K_II is singular, or it is not definite and the solver
            iterative; there is not enough memory.
    """
    if solver is not None and not isinstance(solver, Solver):
        raise ReductionError(f"solver must be Solver.DIRECT, Solver.ITERATIVE or None, got {solver!r}")
    mask = ~boundary
    first = model.K.getOwnershipRange()[0]
    dofs = np.flatnonzero(mask).astype(PETSc.IntType) + first
    rows = PETSc.IS().createGeneral(dofs, comm=model.comm)
    mass = model.M.createSubMatrix(rows, rows)
    try:
        with ExitStack() as stack:
            inverse = None
            if solver is not Solver.ITERATIVE:
                inverse = _factor(model, rows, stack, needed=solver is Solver.DIRECT or not model.is_definite)
            if inverse is None:
                inverse = _iteration(model, mask, stack)
            yield InteriorStiffness(mask, mass, inverse)
    finally:
        # on several ranks nothing else does, since it takes all of them
        for item in (mass, rows):
            item.destroy()


def _factor(
    model: LinearModel, rows: PETSc.IS, stack: ExitStack, *, needed: bool
) -> Inverse | None:
    """A factor, or None where it would not fit in memory and is not needed. Collective."""
    stiffness = model.K.createSubMatrix(rows, rows)
    try:
        factor = Factor(stiffness, definite=model.is_definite, limit=memory_limit(model.comm))
    except TooLargeError:
        if needed:
            raise
        return None
    finally:
        # the factor does not need it any more
        stiffness.destroy()
    stack.callback(factor.destroy)
    return factor


def _iteration(model: LinearModel, mask: NDArray[np.bool_], stack: ExitStack) -> Inverse:
    """Collective."""
    if not model.is_definite:
        raise ReductionError(
            f"the stiffness of {model.form_name} is not positive definite, as it has unknowns like pressures, so that "
            "conjugate gradients cannot solve with it; take solver=Solver.DIRECT"
        )
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
    return equilibrated(model, interior.solve, shapes, mask=interior.mask)


def equilibrated(
    model: LinearModel,
    solve: Callable[[FloatArray], FloatArray],
    shapes: FloatArray,
    *,
    mask: NDArray[np.bool_],
    load: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Static shapes and K times them, once these are known to be in equilibrium. Collective.

    What is out of it by more than round-off is solved for once more (iterative refinement).

    Args:
        model: the body.
        solve: displacements under loads (rows of `mask`, k), in which the shapes stay what they are.
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
            shapes[mask] -= solve(np.asfortranarray(residual(forces)[mask]))
            forces = multiply(model.K, shapes)
            excess = measure.excess(residual(forces), shapes, rows=mask, load=load)
    if not excess <= MARGIN:
        raise ReductionError(
            f"the static shapes leave a residual in the interior that is {excess:.1e} times the round-off of its "
            f"terms, bound {MARGIN:.0f}; its stiffness is singular or nearly so: {SINGULAR}"
        )
    return shapes, forces
