"""The near null space of an elastic matrix for multigrid: motions that cost next to no energy."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import inner

FloatArray = NDArray[np.float64]


def near_null_space(matrix: PETSc.Mat, motions: FloatArray) -> tuple[PETSc.NullSpace, list[PETSc.Vec]]:
    """An orthonormal basis of motions for `Mat.setNearNullSpace`, and its vectors, to be destroyed after. Collective.

    Args:
        matrix: to whose rows it belongs.
        motions: (rows of this rank, k) rigid motions, m and m per rad; linearly independent.
    """
    vectors = []
    for column in _orthonormal(matrix, motions).T:
        vector = matrix.createVecLeft()
        vector.setArray(column)
        vectors.append(vector)
    return PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm), vectors


def _orthonormal(matrix: PETSc.Mat, motions: FloatArray) -> FloatArray:
    """(rows of this rank, k); scaled first, since some are m and some m per rad. Collective."""
    comm = matrix.comm.tompi4py()
    basis = motions / np.sqrt(np.diag(inner(comm, motions, motions)))
    for _ in range(2):
        # the second time takes off what round-off left
        lower = np.linalg.cholesky(inner(comm, basis, basis))
        basis = scipy.linalg.solve_triangular(lower, basis.T, lower=True).T
    return np.asarray(basis)
