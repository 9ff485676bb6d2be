"""Pivoted Cholesky of small positive semidefinite matrices, which shows their rank."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.compiling import kernel

#: A pivot below this share of the usual diagonal entry is round-off: the matrix has no further rank.
RANK_FLOOR = 1e-13


@kernel
def factor_semidefinite(matrix, order, scale):
    """Factor S = P L L^T P^T in place, rows and columns divided by ``scale``; return the rank.

    L's diagonal falls from row to row: the rank to a coarser tolerance is that many of its rows.

    Args:
        matrix: (m, m) symmetric; its lower triangle in pivoted order is overwritten by L.
        order: (m,) integers, written: order[i] is the row that stands at i.
        scale: (m,) usual sizes of the diagonal's roots, in the original order.
    """
    m = matrix.shape[0]
    for i in range(m):
        order[i] = i
    for i in range(m):
        for j in range(m):
            matrix[i, j] /= scale[i] * scale[j]
    for k in range(m):
        best = k
        for i in range(k + 1, m):
            if matrix[i, i] > matrix[best, best]:
                best = i
        if not matrix[best, best] > RANK_FLOOR:
            return k
        if best != k:
            _exchange(matrix, order, k, best)
        pivot = math.sqrt(matrix[k, k])
        matrix[k, k] = pivot
        for i in range(k + 1, m):
            matrix[i, k] /= pivot
        for i in range(k + 1, m):
            share = matrix[i, k]
            for j in range(k + 1, i + 1):
                matrix[i, j] -= share * matrix[j, k]
    return m


@kernel
def _exchange(matrix, order, k, best):
    """Exchange rows and columns k and best > k of a matrix whose lower triangle alone is valid."""
    order[k], order[best] = order[best], order[k]
    matrix[k, k], matrix[best, best] = matrix[best, best], matrix[k, k]
    for j in range(k):
        matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
    for i in range(k + 1, best):
        matrix[i, k], matrix[best, i] = matrix[best, i], matrix[i, k]
    for i in range(best + 1, matrix.shape[0]):
        matrix[i, k], matrix[i, best] = matrix[i, best], matrix[i, k]


@kernel
def solve_semidefinite(matrix, rank, order, scale, rhs, scratch, out):
    """out = S^+ rhs with the factors of ``factor_semidefinite``: the basic solution of full rank.

    Where the rank is short, rows beyond it get zero: a consistent system is solved, an
    inconsistent one in the rows that carry the rank.
    """
    for i in range(rank):
        value = rhs[order[i]] / scale[order[i]]
        for j in range(i):
            value -= matrix[i, j] * scratch[j]
        scratch[i] = value / matrix[i, i]
    for i in range(rank - 1, -1, -1):
        value = scratch[i]
        for j in range(i + 1, rank):
            value -= matrix[j, i] * scratch[j]
        scratch[i] = value / matrix[i, i]
    for i in range(matrix.shape[0]):
        out[order[i]] = scratch[i] / scale[order[i]] if i < rank else 0.0
