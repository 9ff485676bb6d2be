"""A multigrid cycle whose coarser levels are the elements of lower degrees on the same mesh.

Quadratic elements are brought down to linear ones, an eighth of the dofs of a solid, whose stiffness is small enough
for a factor: P^T K P, with the interpolation P between the degrees (Roenquist & Patera 1987, doi:10.1007/BF01061297;
Sundar, Stadler & Biros 2015, doi:10.1002/nla.1979).  What is left for the smoother are deformations within a cell,
wherever that lies and whatever the form, so that the number of iterations does not depend on the mesh's size or on how
slender the body is.  It does grow where cells are thin: a deformation along a long edge is then soft beside those
across, and no neighbour's.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout, dof_layout
from flexmbd.continuum.finite_elements.lower_degree import next_lower, nodal_interpolation
from flexmbd.continuum.grid.row_exchange import share_of
from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.factor import Factor
from flexmbd.reduction.static_shapes.multigrid import MARGIN, largest_eigenvalue, smoothing_polynomial

# Most ranks that each hold the whole factor of the lowest degree.
SHARED = 8


@dataclass(frozen=True, eq=False)
class DegreeLevel:
    """A degree with the cycle of the lower ones; blocks are (rows of this rank, k).

    Attributes:
        matrix: K over all dofs.
        free: (rows of this rank, 1) one, and zero for dofs that are held.
        inverse: (rows of this rank, 1) of the diagonal of K, zero for dofs that are held.
        smoother: (a, b) of the approximate inverse D^-1 (a + b K D^-1), D the diagonal.
        interpolation: from the next lower degree, without the rows of dofs that are held.
        restriction: its transpose.
        coarse: nearly the inverse of the next lower degree's stiffness.
    """

    matrix: PETSc.Mat
    free: FloatArray
    inverse: FloatArray
    smoother: tuple[float, float]
    interpolation: PETSc.Mat
    restriction: PETSc.Mat
    coarse: BlockOperator

    def product(self, block: FloatArray) -> FloatArray:
        """K times a block that is zero where dofs are held, and there zero. Collective."""
        result = multiply(self.matrix, block)
        result *= self.free
        return result

    def cycle(self, loads: FloatArray) -> FloatArray:
        """Nearly the inverse times a block of loads: symmetric, positive definite. Collective."""
        result = self._smoothed(loads)
        rest = multiply(self.matrix, result)
        np.subtract(loads, rest, out=rest)
        result += multiply(self.interpolation, self.coarse(multiply(self.restriction, rest)))
        rest = multiply(self.matrix, result)
        np.subtract(loads, rest, out=rest)
        result += self._smoothed(rest)
        return result

    def _smoothed(self, loads: FloatArray) -> FloatArray:
        a, b = self.smoother
        first = self.inverse * loads
        result = multiply(self.matrix, first)
        result *= b * self.inverse
        first *= a
        result += first
        return result


@contextmanager
def degree_multigrid(
    stiffness: PETSc.Mat, mask: NDArray[np.bool_], *, layout: DofLayout
) -> Iterator[DegreeLevel]:
    """The cycle for a `with` block. Collective.

    Args:
        stiffness: positive semidefinite, definite once the dofs outside of `mask` are held.
        mask: (rows of this rank,) the dofs that are not held.
        layout: of the dofs, of a space that has a lower degree (`has_lower_degree`).

    Raises:
        ReductionError: on all ranks: the stiffness is singular, or there is not enough memory.
    """
    lower = next_lower(layout.space)
    if lower is None:
        raise ReductionError("there are no elements of a lower degree")
    with ExitStack() as stack:
        yield _level(stiffness, mask, layout, lower, stack)


def has_lower_degree(layout: DofLayout) -> bool:
    """Whether a space has elements of a lower degree below it. Collective."""
    return next_lower(layout.space) is not None


def _level(
    stiffness: PETSc.Mat, mask: NDArray[np.bool_], layout: DofLayout, lower: fem.FunctionSpace, stack: ExitStack
) -> DegreeLevel:
    """Collective."""
    space = layout.space
    comm = space.mesh.comm
    weights = nodal_interpolation(lower, space)
    interpolation = _interpolation(stiffness, weights, mask, lower)
    stack.callback(interpolation.destroy)
    coarse = stiffness.PtAP(interpolation)
    stack.callback(coarse.destroy)
    diagonal = coarse.getDiagonal()
    # a coarse dof without any that is free below it
    coarse_mask: NDArray[np.bool_] = diagonal.array_r != 0.0
    diagonal.destroy()
    below = next_lower(lower)
    if below is None:
        solve = _factor(coarse, coarse_mask, stack)
    else:
        solve = _level(coarse, coarse_mask, dof_layout(lower, layout.rigid_motion), below, stack).cycle
    free = np.where(mask, 1.0, 0.0)[:, None]
    inverse = _inverse_diagonal(stiffness) * free
    restriction = interpolation.transpose(PETSc.Mat())
    stack.callback(restriction.destroy)
    product = _scaled(stiffness, np.sqrt(inverse))
    largest = largest_eigenvalue(comm, product, rows=len(mask), size=stiffness.getSize()[0])
    smoother = smoothing_polynomial(MARGIN * largest)
    return DegreeLevel(stiffness, free, inverse, smoother, interpolation, restriction, solve)


def _interpolation(
    stiffness: PETSc.Mat, weights: scipy.sparse.csr_array, mask: NDArray[np.bool_], lower: fem.FunctionSpace
) -> PETSc.Mat:
    """The interpolation as a matrix over all dofs, without the rows of those that are held. Collective."""
    size = lower.dofmap.index_map_bs
    whole = scipy.sparse.kron(weights, np.eye(size), format="csr")
    whole = scipy.sparse.csr_array(scipy.sparse.diags_array(mask.astype(float)) @ whole)
    whole.eliminate_zeros()
    whole.sort_indices()
    kind = PETSc.IntType
    matrix = PETSc.Mat().createAIJWithArrays(
        ((len(mask), None), (size * lower.dofmap.index_map.size_local, None)),
        (whole.indptr.astype(kind), whole.indices.astype(kind), whole.data),
        comm=stiffness.comm,
    )
    matrix.assemble()
    return matrix


def _inverse_diagonal(stiffness: PETSc.Mat) -> FloatArray:
    diagonal = stiffness.getDiagonal()
    inverse: FloatArray = np.reciprocal(diagonal.array_r)[:, None]
    diagonal.destroy()
    return inverse


def _scaled(matrix: PETSc.Mat, root: FloatArray) -> BlockOperator:
    """D^-1/2 K D^-1/2."""
    return lambda block: np.asfortranarray(root * multiply(matrix, np.asfortranarray(root * block)))


def _factor(coarse: PETSc.Mat, mask: NDArray[np.bool_], stack: ExitStack) -> BlockOperator:
    """The inverse by a factor. Collective."""
    first = coarse.getOwnershipRange()[0]
    dofs = (np.flatnonzero(mask) + first).astype(PETSc.IntType)
    rows = PETSc.IS().createGeneral(dofs, comm=coarse.comm)
    part = coarse.createSubMatrix(rows, rows)
    rows.destroy()
    comm = coarse.comm.tompi4py()
    try:
        factor = SharedFactor(part) if 1 < comm.size <= SHARED else Factor(part, definite=True)
    finally:
        part.destroy()
    stack.callback(factor.destroy)

    def solve(block: FloatArray) -> FloatArray:
        result = np.zeros_like(block)
        result[mask] = factor.solve(np.asfortranarray(block[mask]))
        return result

    return solve


class SharedFactor:
    """A factor that each rank has in full and with which it solves for its share of the columns.

    MUMPS's solutions take as long on several ranks as on one: one after the other they climb the tree of the factor.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Factorise a positive definite matrix on every rank. Collective.

        Raises:
            ReductionError: on all ranks: it is singular, or there was not enough memory.
        """
        self._comm = matrix.comm.tompi4py()
        _, end = matrix.getOwnershipRange()
        self._edges = np.array([0, *self._comm.allgather(end)])
        whole = matrix.getRedundantMatrix(self._comm.size)
        try:
            self._factor = Factor(whole, definite=True)
        finally:
            whole.destroy()

    def solve(self, block: FloatArray) -> FloatArray:
        """The inverse times a block (rows of this rank, k). Collective."""
        columns = [share_of(rank, self._comm.size, block.shape[1]) for rank in range(self._comm.size)]
        mine = np.asfortranarray(np.vstack(self._comm.alltoall([block[:, some] for some in columns])))
        solved = self._factor.solve(mine)
        return np.hstack(self._comm.alltoall(np.split(solved, self._edges[1:-1])))

    def destroy(self) -> None:
        """Give the memory back. Collective."""
        self._factor.destroy()
