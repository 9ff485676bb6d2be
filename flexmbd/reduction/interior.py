"""The interior's stiffness, factorised once, and how displacements of the boundary continue in it.

The dofs are split into boundary dofs B, which a reduction keeps or binds to a frame, and interior
dofs I.  A displacement given on B is continued by K_II u_I = -K_IB u_B (seed 3 eq. 3.10).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.blocks import FloatArray, from_dense, multiply, to_dense
from flexmbd.continuum.model import ContinuumModel
from flexmbd.errors import ReductionError

# Bound on what is out of equilibrium: a healthy part is five orders and more below it.
_EQUILIBRIUM = 1e-8


@dataclass(frozen=True, eq=False)
class Interior:
    """The interior dofs of a model and the factor of their stiffness.

    Attributes:
        mask: (owned dofs,) whether a dof of this rank is in the interior.
        K: K_II.
        M: M_II.
        factor: MUMPS' Cholesky factor of K_II; None where there is no interior at all.
    """

    mask: NDArray[np.bool_]
    K: PETSc.Mat
    M: PETSc.Mat
    factor: PETSc.KSP | None

    @property
    def size(self) -> int:
        """Number of interior dofs on all ranks."""
        return int(self.K.getSize()[0])

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block, all columns at once. Collective.

        Args:
            block: (interior dofs of this rank, k), N or what K_II is to be solved for.

        Returns:
            The same shape.
        """
        if self.factor is None or block.shape[1] == 0:
            return np.zeros_like(block)
        right = to_dense(self.K.comm, block)
        left = to_dense(self.K.comm, np.zeros(block.shape, order="F"))
        self.factor.matSolve(right, left)
        solution = from_dense(left)
        left.destroy()
        right.destroy()
        return solution


@contextmanager
def factorised(model: ContinuumModel, boundary: NDArray[np.bool_]) -> Iterator[Interior]:
    """Split the dofs and factorise the interior's stiffness, for a `with` block. Collective.

    Args:
        model: with K and M.
        boundary: (owned dofs,) whether a dof of this rank is on the boundary.

    Yields:
        The interior; its memory is given back at the end of the block.

    Raises:
        ReductionError: on all ranks: K_II is singular, or there is not enough memory.
    """
    mask = ~boundary
    first = model.K.getOwnershipRange()[0]
    dofs = np.flatnonzero(mask).astype(PETSc.IntType) + first
    rows = PETSc.IS().createGeneral(dofs, comm=model.comm)
    stiffness = model.K.createSubMatrix(rows, rows)
    mass = model.M.createSubMatrix(rows, rows)
    solver = PETSc.KSP().create(model.comm)
    try:
        if stiffness.getSize()[0] > 0:
            _factorise(solver, stiffness)
            yield Interior(mask, stiffness, mass, solver)
        else:
            yield Interior(mask, stiffness, mass, None)
    finally:
        # on several ranks nothing else does, since it takes all of them
        for item in (solver, mass, stiffness, rows):
            item.destroy()


def _factorise(solver: PETSc.KSP, stiffness: PETSc.Mat) -> None:
    # without this PETSc asks for an unsymmetric or indefinite factor, of twice the work
    stiffness.setOption(PETSc.Mat.Option.SPD, True)
    solver.setOperators(stiffness)
    solver.setType(PETSc.KSP.Type.PREONLY)
    solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
    solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    try:
        solver.setUp()
        failed = solver.getPC().getFailedReason()
    except PETSc.Error as error:
        raise ReductionError(
            f"the stiffness of the interior could not be factorised (PETSc error {error.ierr}); "
            "take a coarser mesh or more memory"
        ) from error
    if failed != PETSc.PC.FailedReason.NOERROR:
        memory = failed == PETSc.PC.FailedReason.OUTMEMORY
        remedy = "take a coarser mesh or more memory" if memory else _SINGULAR
        raise ReductionError(f"the stiffness of the interior could not be factorised: {remedy}")


_SINGULAR = (
    "it is singular: a part of the body is connected to no interface or not to the rest, or the nodes "
    "that are kept leave it free to move"
)


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
            f"interior, bound {_EQUILIBRIUM:.0e}; its stiffness is singular or nearly so: {_SINGULAR}"
        )


def _largest_norm(comm: MPI.Comm, block: FloatArray) -> float:
    if block.shape[1] == 0:
        return 0.0
    squares = comm.allreduce((block**2).sum(axis=0))
    return float(np.sqrt(squares.max()))
