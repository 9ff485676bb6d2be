"""The interior's stiffness, whose inverse continues displacements of the boundary.

The dofs are split into boundary dofs B, which a reduction keeps or binds to a frame, and interior
dofs I.  A displacement given on B is continued by K_II u_I = -K_IB u_B (seed 3 eq. 3.10).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.blocks import FloatArray, multiply
from flexmbd.continuum.model import ContinuumModel
from flexmbd.errors import ReductionError
from flexmbd.reduction.conjugate_gradients import conjugate_gradients
from flexmbd.reduction.factor import SINGULAR, Factor, TooLargeError, memory_limit

# Bound on what is out of equilibrium: a healthy part is five orders and more below it.
_EQUILIBRIUM = 1e-8


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
class Interior:
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
    model: ContinuumModel, boundary: NDArray[np.bool_], *, solver: Solver | None = None
) -> Iterator[Interior]:
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
            yield Interior(mask, mass, inverse)
    finally:
        # on several ranks nothing else does, since it takes all of them
        for item in (mass, rows):
            item.destroy()


def _factor(
    model: ContinuumModel, rows: PETSc.IS, stack: ExitStack, *, needed: bool
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


def _iteration(model: ContinuumModel, mask: NDArray[np.bool_], stack: ExitStack) -> Inverse:
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
    model: ContinuumModel, interior: Interior, boundary: FloatArray
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
    forces = multiply(model.K, shapes)
    check_equilibrium(model.comm, load=load[interior.mask], residual=forces[interior.mask])
    return shapes, forces


def check_equilibrium(comm: MPI.Comm, *, load: FloatArray, residual: FloatArray) -> None:
    """Refuse a static solution that leaves a residual. Collective.

    Args:
        comm: the ranks that the rows are spread over.
        load: (rows, k), N; the largest column is the measure.
        residual: (rows, k), N.

    Raises:
        ReductionError: on all ranks: the largest residual is above its bound.
    """
    before, after = _largest_norm(comm, load), _largest_norm(comm, residual)
    if not after <= _EQUILIBRIUM * before:
        raise ReductionError(
            f"the static shapes leave a residual of {after:.1e} of a load of {before:.1e} in the "
            f"interior, bound {_EQUILIBRIUM:.0e}; its stiffness is singular or nearly so: {SINGULAR}"
        )


def _largest_norm(comm: MPI.Comm, block: FloatArray) -> float:
    if block.shape[1] == 0:
        return 0.0
    squares = comm.allreduce((block**2).sum(axis=0))
    return float(np.sqrt(squares.max()))
