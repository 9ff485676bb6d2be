"""Blocks: tall dense matrices of which each rank holds its own rows, as plain arrays.

A block has shape (rows this rank owns, k). Many columns at once are what PETSc and MUMPS are fast
with; small products of blocks are the same on every rank.
"""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def multiply(matrix: PETSc.Mat, block: FloatArray) -> FloatArray:
    """Matrix times block. Collective.

    Args:
        matrix: (N, P) spread by rows.
        block: (p, k), this rank's rows in the layout of the matrix's columns.

    Returns:
        (n, k), this rank's rows.
    """
    if block.shape[1] == 0:
        return np.zeros((matrix.getLocalSize()[0], 0))
    if not np.diff(matrix.getOwnershipRangesColumn()).all():
        return _one_by_one(matrix, block)
    factor = to_dense(matrix.comm, block)
    product = matrix.matMult(factor)
    result = from_dense(product)
    product.destroy()
    factor.destroy()
    return result


def _one_by_one(matrix: PETSc.Mat, block: FloatArray) -> FloatArray:
    """Matrix times block where a rank has no columns, with which PETSc 3.25 multiplies no block. Collective."""
    right, left = matrix.createVecs()
    result = np.empty((matrix.getLocalSize()[0], block.shape[1]), order="F")
    for i in range(block.shape[1]):
        right.setArray(block[:, i])
        matrix.mult(right, left)
        result[:, i] = left.array_r
    right.destroy()
    left.destroy()
    return result


def inner(comm: MPI.Comm, left: FloatArray, right: FloatArray) -> FloatArray:
    """Transpose of one block times another, the same on every rank. Collective.

    Args:
        comm: the ranks the blocks are spread over.
        left: (n, j).
        right: (n, k).

    Returns:
        (j, k).
    """
    return total(comm, left.T @ right)


def total(comm: MPI.Comm, part: FloatArray) -> FloatArray:
    """The sum over the ranks of a small array, the same on every rank. Collective."""
    if comm.size > 1:
        # summed on one rank, because a sum may depend on the rank that makes it
        part = np.ascontiguousarray(comm.bcast(comm.reduce(part, root=0), root=0))
    return part


def symmetric(matrix: FloatArray) -> FloatArray:
    """The symmetric part of a small square matrix."""
    half: FloatArray = 0.5 * (matrix + matrix.T)
    return half


def to_dense(comm: MPI.Comm, block: FloatArray) -> PETSc.Mat:
    """The block as a PETSc matrix, which shares its memory where that is in Fortran's order.

    Collective. The block must outlive the matrix.
    """
    n, k = block.shape
    dense = PETSc.Mat().createDense(
        ((n, PETSc.DETERMINE), (PETSc.DECIDE, k)), array=np.asfortranarray(block), comm=comm
    )
    dense.assemble()
    return dense


def from_dense(dense: PETSc.Mat) -> FloatArray:
    """This rank's rows of a dense PETSc matrix, copied, in Fortran's order."""
    rows: FloatArray = dense.getDenseArray(readonly=True).copy(order="F")
    return rows
