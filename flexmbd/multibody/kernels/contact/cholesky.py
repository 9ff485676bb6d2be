"""Cholesky's factors of small dense matrices, by eights of their columns: C = U^T U.

U (N, N), N = `padded` n, stands row by row in an array from a place, with the reciprocals of its diagonal there, and
zeros before it in the eight of each row.  Rows and vectors have N numbers, of which n count.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import (
    LANES,
    lanes,
    less_product,
    padded,
    plus_product,
    put_lanes,
    spread,
    sum_of,
)

_ROWS = 4  # at a time: a divisor of LANES


@kernel
def _less_above(values, place, N, i, first):
    """Subtract from _ROWS rows from i, in the columns from ``first``, what the rows above them stand for."""
    o = place + N * i
    for j in range(first, N, LANES):
        a, b = lanes(values, o + j), lanes(values, o + N + j)
        c, d = lanes(values, o + 2 * N + j), lanes(values, o + 3 * N + j)
        for k in range(i):
            row = place + N * k
            right = lanes(values, row + j)
            a = less_product(a, spread(values[row + i]), right)
            b = less_product(b, spread(values[row + i + 1]), right)
            c = less_product(c, spread(values[row + i + 2]), right)
            d = less_product(d, spread(values[row + i + 3]), right)
        put_lanes(values, o + j, a)
        put_lanes(values, o + N + j, b)
        put_lanes(values, o + 2 * N + j, c)
        put_lanes(values, o + 3 * N + j, d)


@kernel
def factor(values, place, n):
    """Turn C, its upper triangle (N, N), into U in place; whether C is positive.  The rest need not be set."""
    N = padded(n)
    for i in range(n):
        for j in range(n, N):
            values[place + N * i + j] = 0.0
    for i in range(n, N):
        for j in range(i, N):
            values[place + N * i + j] = 1.0 if i == j else 0.0
    for i in range(0, n, _ROWS):
        first = i // LANES * LANES
        _less_above(values, place, N, i, first)
        for r in range(i, i + _ROWS):
            o = place + N * r
            for k in range(i, r):
                above = place + N * k
                share = spread(values[above + r])
                for j in range(first, N, LANES):
                    put_lanes(values, o + j, less_product(lanes(values, o + j), share, lanes(values, above + j)))
            if not values[o + r] > 0.0:
                return False
            size = 1.0 / math.sqrt(values[o + r])
            for j in range(first, N, LANES):
                put_lanes(values, o + j, plus_product(spread(0.0), spread(size), lanes(values, o + j)))
            for j in range(first, r):
                values[o + j] = 0.0
            values[o + r] = size
    return True


@kernel
def forward(values, place, n, b):
    """Solve U^T y = b (N,) in place; b is zero beyond n."""
    N = padded(n)
    for i in range(n):
        o = place + N * i
        y = b[i] * values[o + i]
        share = spread(y)
        for j in range(i // LANES * LANES, N, LANES):
            put_lanes(b, j, less_product(lanes(b, j), share, lanes(values, o + j)))
        b[i] = y


@kernel
def backward(values, place, n, b):
    """Solve U x = b (N,) in place; b is zero beyond n."""
    N = padded(n)
    for i in range(n - 1, -1, -1):
        o, y = place + N * i, b[i]
        b[i] = 0.0
        known = spread(0.0)
        for j in range(i // LANES * LANES, N, LANES):
            known = plus_product(known, lanes(b, j), lanes(values, o + j))
        b[i] = (y - sum_of(known)) * values[o + i]


@kernel
def forward_rows(values, place, n, B, rows, width):
    """Solve U^T Y = B (n, width) in place; its rows, of a `padded` number, are at ``rows`` of the array B."""
    N = padded(n)
    for j in range(n):
        scale = spread(values[place + N * j + j])
        for c in range(rows, rows + width, LANES):
            left = lanes(B, c + width * j)
            for i in range(j):
                left = less_product(left, spread(values[place + N * i + j]), lanes(B, c + width * i))
            put_lanes(B, c + width * j, plus_product(spread(0.0), scale, left))
