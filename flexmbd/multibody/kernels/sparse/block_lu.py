"""LU factors of a sparse matrix of blocks, real or complex, and solutions: front by front (``fronts``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, summing_kernel
from flexmbd.multibody.kernels.base.native import blas_addresses, complex_blas_addresses
from flexmbd.multibody.kernels.sparse.blas import (
    N_BLAS_SIZES,
    solve_left_columns,
    solve_upper_rows,
    subtract_product,
)
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern
from flexmbd.multibody.kernels.sparse.fronts import add_sizes, eliminate, exchange, leave, take

ComplexArray = NDArray[np.complex128]

_FOR_BLAS = 12000  # multiplications of a front's product, from which BLAS is quicker than loops
_LEAST_FOR_BLAS = 4  # pivots and others


@dataclass(frozen=True, eq=False)
class BlockMatrix(ArrayStruct):
    """Values of a matrix or its factors, and what its factorisation and solutions write.

    values: (fill,) entries by ``BlockPattern``.  worthless: (1,) the unknown whose pivot was, -1 if none.
    held: (n,) what ``factor_holding`` has added to the diagonal.  least: (1,) the smallest pivot over the terms that it
    is the sum of.  terms: (n,) what diagonal entries are known to be the sum of when they are put in, zeros at first:
    what is round-off beside sqrt(terms_i terms_j) is no entry.  exchanges: (n,) with which column of its front each was
    exchanged.
    stack (stack,), size (n,), columns (2, pivots), right (n,) and gathered (widest,) are scratch; blas, sizes and units
    are for BLAS.
    """

    values: FloatArray
    exchanges: IntArray
    worthless: IntArray
    held: FloatArray
    least: FloatArray
    terms: FloatArray
    stack: FloatArray
    size: FloatArray
    columns: FloatArray
    right: FloatArray
    gathered: FloatArray
    blas: IntArray
    sizes: NDArray[np.int32]
    units: FloatArray


@dataclass(frozen=True, eq=False)
class ComplexBlockMatrix(ArrayStruct):
    """A ``BlockMatrix`` of complex numbers."""

    values: ComplexArray
    exchanges: IntArray
    worthless: IntArray
    held: FloatArray
    least: FloatArray
    terms: FloatArray
    stack: ComplexArray
    size: FloatArray
    columns: FloatArray
    right: ComplexArray
    gathered: ComplexArray
    blas: IntArray
    sizes: NDArray[np.int32]
    units: ComplexArray


def new_block_matrix(pattern: BlockPattern) -> BlockMatrix:
    """Allocate a real matrix of zeros."""
    return BlockMatrix(**_arrays(pattern, np.float64), blas=blas_addresses())


def new_complex_block_matrix(pattern: BlockPattern) -> ComplexBlockMatrix:
    """Allocate a complex matrix of zeros."""
    return ComplexBlockMatrix(**_arrays(pattern, np.complex128), blas=complex_blas_addresses())


def _arrays(pattern: BlockPattern, kind: type) -> dict[str, NDArray]:
    unknowns = pattern.unknowns
    deepest = int(np.diff(pattern.pivots).max(initial=0))
    return {
        "values": np.zeros(pattern.fill, kind),
        "exchanges": np.zeros(unknowns, np.int64),
        "worthless": np.full(1, -1, np.int64),
        "held": np.zeros(unknowns),
        "least": np.ones(1),
        "terms": np.zeros(unknowns),
        "stack": np.zeros(pattern.stack, kind),
        "size": np.zeros(unknowns),
        "columns": np.zeros((2, deepest)),
        "right": np.zeros(unknowns, kind),
        "gathered": np.zeros(pattern.widest, kind),
        "sizes": np.zeros(N_BLAS_SIZES, np.int32),
        "units": np.array([1.0, -1.0], kind),
    }


@entry_kernel
def clear(matrix):
    """Set all entries to zero, for a matrix to be added up."""
    matrix.values[:] = 0.0


@entry_kernel
def add_product(pattern, matrix, vector, weight, out):
    """Add ``weight`` times the matrix, not yet factored, times ``vector`` (n,) to ``out`` (n,)."""
    for i in range(pattern.entry_at.shape[0] - 1):
        for q in range(pattern.entry_at[i], pattern.entry_at[i + 1]):
            j = pattern.column[q]
            begin, end = pattern.first[j], pattern.first[j + 1]
            for r in range(pattern.first[i + 1] - pattern.first[i]):
                at = pattern.offset[q] + r * pattern.stride[q]
                row = matrix.values[at : at + end - begin]
                out[pattern.first[i] + r] += weight * _product(row, vector[begin:end])


@entry_kernel
def factor_sparse(pattern, matrix):
    """Factor in place; False if a pivot is worthless, that of the unknown in ``matrix.worthless``."""
    return _factor(pattern, matrix, False)


@entry_kernel
def factor_holding(pattern, matrix):
    """Factor in place; what has a worthless pivot is held by a diagonal entry of its own, in ``matrix.held``.

    Of a matrix whose rows and columns for this unknown depend on the others solutions stay what they are, up to
    multiples of what it annihilates: the unknown that is held is zero there.
    """
    return _factor(pattern, matrix, True)


@kernel
def _factor(pattern, matrix, holds):
    matrix.worthless[0] = -1
    matrix.least[0] = 1.0
    matrix.held[:] = 0.0
    for k in range(matrix.size.shape[0]):
        matrix.size[k] = matrix.terms[pattern.unknown[k]]
    for front in range(pattern.stack_at.shape[0]):
        first = pattern.pivots[front]
        p = pattern.pivots[front + 1] - first
        u = pattern.at[front + 1] - pattern.at[front]
        begin, to = pattern.values_at[front], pattern.stack_at[front]
        matrix.stack[to : to + u * u] = 0.0
        for q in range(pattern.children_at[front], pattern.children_at[front + 1]):
            take(pattern, matrix, pattern.children[q], begin, to, p, u)
        by_blas = p >= _LEAST_FOR_BLAS and u >= _LEAST_FOR_BLAS and p * u * u > _FOR_BLAS
        bad = eliminate(pattern, matrix, first, begin, p, p + u, p if by_blas else p + u, holds)
        if bad >= 0:
            matrix.worthless[0] = pattern.unknown[first + bad]
            return False
        if u == 0:
            continue
        left = begin + p * (p + u)
        exchange(matrix, first, left, p, u)
        if by_blas:
            blas, sizes, units, values = matrix.blas, matrix.sizes, matrix.units, matrix.values
            solve_upper_rows(blas, sizes, units, values, begin, p, u, p + u)
            solve_left_columns(blas, sizes, units, values, begin, left, p, u, p + u)
            subtract_product(blas, sizes, units, values, left, begin + p, matrix.stack, to, p, u, p + u)
        else:
            leave(matrix, begin, left, to, p, u)
        add_sizes(pattern, matrix, pattern.at[front], begin, left, p, u)
    return True


@entry_kernel
def count_signs(pattern, matrix):
    """How many pivots of a real matrix's factors are negative, held ones apart; and how many columns were exchanged.

    Without exchanges, of a symmetric matrix, it has as many negative eigenvalues (Sylvester's law of inertia).
    """
    negative, exchanged = 0, 0
    for front in range(pattern.stack_at.shape[0]):
        first, begin = pattern.pivots[front], pattern.values_at[front]
        p = pattern.pivots[front + 1] - first
        w = p + pattern.at[front + 1] - pattern.at[front]
        for k in range(p):
            exchanged += matrix.exchanges[first + k] != k
            is_held = matrix.held[pattern.unknown[first + k]] > 0.0
            negative += matrix.values[begin + k * w + k] < 0.0 and not is_held
    return negative, exchanged


@entry_kernel
def solve_sparse(pattern, matrix, rhs):
    """Solve with the factors; each row of the (k, n) ``rhs`` is one right-hand side, in place."""
    right, fronts = matrix.right, pattern.stack_at.shape[0]
    for q in range(rhs.shape[0]):
        for k in range(right.shape[0]):
            right[k] = rhs[q, pattern.unknown[k]]
        for front in range(fronts):
            _forward(pattern, matrix, front)
        for front in range(fronts - 1, -1, -1):
            _backward(pattern, matrix, front)
        for k in range(right.shape[0]):
            rhs[q, pattern.unknown[k]] = right[k]


@kernel
def _forward(pattern, matrix, front):
    values = matrix.values
    first, at = pattern.pivots[front], pattern.at[front]
    p, u = pattern.pivots[front + 1] - first, pattern.at[front + 1] - at
    begin, w = pattern.values_at[front], p + u
    own = matrix.right[first : first + p]
    for k in range(1, p):
        own[k] -= _product(values[begin + k * w : begin + k * w + k], own)
    left = begin + p * w
    for i in range(u):
        matrix.right[pattern.places[at + i]] -= _product(values[left + i * p : left + (i + 1) * p], own)


@kernel
def _backward(pattern, matrix, front):
    values = matrix.values
    first, at = pattern.pivots[front], pattern.at[front]
    p, u = pattern.pivots[front + 1] - first, pattern.at[front + 1] - at
    begin, w = pattern.values_at[front], p + u
    own, gathered = matrix.right[first : first + p], matrix.gathered
    for i in range(u):
        gathered[i] = matrix.right[pattern.places[at + i]]
    for k in range(p - 1, -1, -1):
        row = values[begin + k * w : begin + (k + 1) * w]
        found = own[k] - _product(row[p:], gathered)
        for j in range(k + 1, p):
            found -= row[j] * own[j]
        own[k] = found / row[k]
    for k in range(p - 1, -1, -1):
        other = matrix.exchanges[first + k]
        if other != k:
            own[k], own[other] = own[other], own[k]


@summing_kernel
def _product(row, values):
    """Of a row with the first of some values."""
    total = 0.0
    for c in range(row.shape[0]):
        total += row[c] * values[c]
    return total
