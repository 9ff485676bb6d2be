"""LU factors of a sparse matrix of blocks, real or complex, and solutions: front by front (``block_pattern``).

In the rows of a front's pivots columns are exchanged, never with other fronts' (static pivoting): the pivot is that of
the row's unknown where it is not small against the others, each by the largest of its column, so that units do not
matter.  A pivot that is round-off of the terms that it is the sum of is worthless, and told by its unknown.
"""

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

ComplexArray = NDArray[np.complex128]

_LEAST_PIVOT = 1e-12  # of the terms that it is the sum of: below, its round-off is no longer small
_DIAGONAL_SHARE = 0.1  # of the largest in its row, from which the diagonal entry is the pivot
_FOR_BLAS = 12000  # multiplications of a front's product, from which BLAS is quicker than loops
_LEAST_FOR_BLAS = 4  # pivots and others


@dataclass(frozen=True, eq=False)
class BlockMatrix(ArrayStruct):
    """Values of a matrix or its factors, and what its factorisation and solutions write.

    values: (fill,) entries by ``BlockPattern``.  exchanges: (n,) with which column of its front each was exchanged.
    worthless: (1,) the unknown whose pivot was, -1 if none.  stack (stack,), size (n,), columns (2, pivots), right (n,)
    and gathered (widest,) are scratch; blas, sizes, units are for BLAS.
    """

    values: FloatArray
    exchanges: IntArray
    worthless: IntArray
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
    matrix.worthless[0] = -1
    matrix.size[:] = 0.0
    for front in range(pattern.stack_at.shape[0]):
        first = pattern.pivots[front]
        p = pattern.pivots[front + 1] - first
        u = pattern.at[front + 1] - pattern.at[front]
        begin, to = pattern.values_at[front], pattern.stack_at[front]
        matrix.stack[to : to + u * u] = 0.0
        for q in range(pattern.children_at[front], pattern.children_at[front + 1]):
            _take(pattern, matrix, pattern.children[q], begin, to, p, u)
        by_blas = p >= _LEAST_FOR_BLAS and u >= _LEAST_FOR_BLAS and p * u * u > _FOR_BLAS
        bad = _eliminate(matrix, first, begin, p, p + u, p if by_blas else p + u)
        if bad >= 0:
            matrix.worthless[0] = pattern.unknown[first + bad]
            return False
        if u == 0:
            continue
        left = begin + p * (p + u)
        _exchange(matrix, first, left, p, u)
        if by_blas:
            blas, sizes, units, values = matrix.blas, matrix.sizes, matrix.units, matrix.values
            solve_upper_rows(blas, sizes, units, values, begin, p, u, p + u)
            solve_left_columns(blas, sizes, units, values, begin, left, p, u, p + u)
            subtract_product(blas, sizes, units, values, left, begin + p, matrix.stack, to, p, u, p + u)
        else:
            _leave(matrix, begin, left, to, p, u)
        _add_sizes(pattern, matrix, pattern.at[front], begin, left, p, u)
    return True


@kernel
def _take(pattern, matrix, child, begin, to, p, u):
    """Add what a child left to a front: the values at ``begin`` and what it will leave at ``to`` of the stack."""
    first = pattern.at[child]
    count = pattern.at[child + 1] - first
    above = pattern.above[first : first + count]
    split = 0  # how many are pivots of the front
    while split < count and above[split] < p:
        split += 1
    one_run = count > split and above[count - 1] - above[split] == count - 1 - split
    at, left = pattern.stack_at[child], begin + p * (p + u)
    for i in range(count):
        row = matrix.stack[at + i * count : at + i * count + count]
        place = above[i]
        if place < p:
            target = matrix.values[begin + place * (p + u) : begin + (place + 1) * (p + u)]
            for j in range(count):
                target[above[j]] += row[j]
            continue
        target = matrix.values[left + (place - p) * p : left + (place - p + 1) * p]
        for j in range(split):
            target[above[j]] += row[j]
        rest = matrix.stack[to + (place - p) * u : to + (place - p + 1) * u]
        if one_run:
            shift = above[split] - p - split
            for j in range(split, count):
                rest[j + shift] += row[j]
        else:
            for j in range(split, count):
                rest[above[j] - p] += row[j]


@kernel
def _eliminate(matrix, first, begin, p, w, reach):
    """LU of p rows at ``begin`` by their first p columns, up to column ``reach``; which pivot is worthless, or -1."""
    values, columns = matrix.values, matrix.columns
    for j in range(p):
        columns[0, j] = 0.0
        columns[1, j] = matrix.size[first + j]
        for i in range(p if p > 1 else 0):
            columns[0, j] = max(columns[0, j], abs(values[begin + i * w + j]))
    for k in range(p):
        row = values[begin + k * w : begin + (k + 1) * w]
        other = _pivot_column(row, columns, k, p)
        matrix.exchanges[first + k] = other
        if other != k:
            columns[0, k], columns[0, other] = columns[0, other], columns[0, k]
            columns[1, k], columns[1, other] = columns[1, other], columns[1, k]
            for i in range(p):
                entry = values[begin + i * w + k]
                values[begin + i * w + k] = values[begin + i * w + other]
                values[begin + i * w + other] = entry
        pivot = row[k]
        before, terms = pivot, 0.0
        for m in range(k):
            term = row[m] * values[begin + m * w + k]
            before += term
            terms += abs(term)
        kept = abs(before) + terms + np.sqrt(matrix.size[first + k] * columns[1, k])
        if not abs(pivot) > _LEAST_PIVOT * kept:
            return k
        for i in range(k + 1, p):
            below = values[begin + i * w : begin + (i + 1) * w]
            share = below[k] / pivot
            below[k] = share
            if share != 0.0:
                for c in range(k + 1, reach):
                    below[c] -= share * row[c]
    return -1


@kernel
def _pivot_column(row, columns, k, p):
    """Which column gives the pivot of row k: its own, unless that is small by the columns' scales."""
    if k == p - 1:
        return k
    best, largest, own = k, 0.0, 0.0
    for j in range(k, p):
        if columns[0, j] > 0.0:
            size = abs(row[j]) / columns[0, j]
            if j == k:
                own = size
            if size > largest:
                best, largest = j, size
    return k if own >= _DIAGONAL_SHARE * largest else best


@kernel
def _exchange(matrix, first, left, p, u):
    """Exchange the columns of the rows (u, p) at ``left`` as those of the pivots."""
    values = matrix.values
    for k in range(p):
        other = matrix.exchanges[first + k]
        if other != k:
            for i in range(left, left + u * p, p):
                entry = values[i + k]
                values[i + k] = values[i + other]
                values[i + other] = entry


@kernel
def _leave(matrix, begin, left, to, p, u):
    """The left columns divided by the pivots, and what the front leaves to its others."""
    values, stack, w = matrix.values, matrix.stack, p + u
    for i in range(u):
        own = values[left + i * p : left + (i + 1) * p]
        for k in range(p):
            row = values[begin + k * w : begin + (k + 1) * w]
            own[k] /= row[k]
            for c in range(k + 1, p):
                own[c] -= own[k] * row[c]
        rest = stack[to + i * u : to + (i + 1) * u]
        for k in range(0, p - 1, 2):
            one, two = own[k], own[k + 1]
            row = values[begin + k * w + p : begin + (k + 1) * w]
            next_row = values[begin + (k + 1) * w + p : begin + (k + 2) * w]
            for c in range(u):
                rest[c] -= one * row[c] + two * next_row[c]
        if p % 2 == 1:
            one = own[p - 1]
            row = values[begin + p * w - u : begin + p * w]
            for c in range(u):
                rest[c] -= one * row[c]


@kernel
def _add_sizes(pattern, matrix, at, begin, left, p, u):
    """Add to ``matrix.size`` of each other the terms that its diagonal entry became the sum of."""
    values, w = matrix.values, p + u
    for i in range(u):
        total = 0.0
        for k in range(p):
            total += abs(values[left + i * p + k] * values[begin + k * w + p + i])
        matrix.size[pattern.places[at + i]] += total


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
