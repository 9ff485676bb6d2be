"""Pivoted Cholesky of small positive semidefinite matrices, which shows their rank."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel

#: A pivot below this share of the usual diagonal entry is round-off: the matrix has no further rank.
RANK_FLOOR = 1e-13


@kernel
def factor_semidefinite(matrix, order, scale):
    """Factor S = P L L^T P^T in place, rows and columns divided by ``scale``; return the rank.

    L's diagonal falls from row to row: the rank to a coarser tolerance is that many of its rows.  Zeros are passed
    over: loops that lie in a row along a machine cost little more than their number squared.

    Args:
        matrix: (m, m) symmetric, of which the lower triangle is read; in pivoted order L is written there, its
            transpose above.
        order: (m,) integers, written: order[i] is the row that stands at i.
        scale: (m,) usual sizes of the diagonal's roots, in the original order.
    """
    return factor_block(matrix, 0, matrix.shape[0], order, scale)


@kernel
def factor_block(matrix, first, last, order, scale):
    """As ``factor_semidefinite`` of rows and columns ``first`` to before ``last``, which nothing couples to others.

    The block's L lies where the block lies, and ``order`` counts rows of the whole matrix.
    """
    for i in range(first, last):
        order[i] = i
        for j in range(first, i + 1):
            if matrix[i, j] != 0.0:
                matrix[i, j] /= scale[i] * scale[j]
    for k in range(first, last):
        best = k
        for i in range(k + 1, last):
            if matrix[i, i] > matrix[best, best]:
                best = i
        if not matrix[best, best] > RANK_FLOOR:
            return k - first
        if best != k:
            _exchange(matrix, first, last, order, k, best)
        pivot = math.sqrt(matrix[k, k])
        matrix[k, k] = pivot
        for i in range(k + 1, last):
            if matrix[i, k] != 0.0:
                matrix[i, k] /= pivot
            matrix[k, i] = matrix[i, k]
        for i in range(k + 1, last):
            share = matrix[i, k]
            if share != 0.0:
                for j in range(k + 1, i + 1):
                    matrix[i, j] -= share * matrix[k, j]
    return last - first


@kernel
def _exchange(matrix, first, last, order, k, best):
    """Exchange rows and columns k and best > k: of L and its transpose what is written, else the lower triangle."""
    order[k], order[best] = order[best], order[k]
    matrix[k, k], matrix[best, best] = matrix[best, best], matrix[k, k]
    for j in range(first, k):
        matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        matrix[j, k], matrix[j, best] = matrix[j, best], matrix[j, k]
    for i in range(k + 1, best):
        matrix[i, k], matrix[best, i] = matrix[best, i], matrix[i, k]
    for i in range(best + 1, last):
        matrix[i, k], matrix[i, best] = matrix[i, best], matrix[i, k]


@summing_kernel
def _dot(matrix, i, first, last, x):
    """Sum of matrix[i, j] x[j] from first to before last."""
    total = 0.0
    for j in range(first, last):
        total += matrix[i, j] * x[j]
    return total


@kernel
def solve_semidefinite(matrix, rank, order, scale, rhs, scratch, out):
    """out = S^+ rhs with the factors of ``factor_semidefinite``: the basic solution of full rank.

    Where the rank is short, rows beyond it get zero: a consistent system is solved, an
    inconsistent one in the rows that carry the rank.
    """
    solve_block(matrix, 0, matrix.shape[0], rank, order, scale, rhs, scratch, out)


@kernel
def solve_block(matrix, first, last, rank, order, scale, rhs, scratch, out):
    """As ``solve_semidefinite`` in the rows of a block, with the factors of ``factor_block``."""
    end = first + rank
    for i in range(first, end):
        value = rhs[order[i]] / scale[order[i]] - _dot(matrix, i, first, i, scratch)
        scratch[i] = value / matrix[i, i]
    for i in range(end - 1, first - 1, -1):
        scratch[i] = (scratch[i] - _dot(matrix, i, i + 1, end, scratch)) / matrix[i, i]
    for i in range(first, last):
        out[order[i]] = scratch[i] / scale[order[i]] if i < end else 0.0
