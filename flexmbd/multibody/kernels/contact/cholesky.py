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
    spread_at,
    sum_of,
)

#: Rows at a time: a divisor of LANES.
ROWS = 4


@kernel
def less_products(target, to, left, place, stride, right, rows, width, count, first):
    """Subtract from ROWS rows of ``target`` the products of ``count`` numbers each with as many rows of ``right``.

    Rows have ``width`` numbers, of which those from ``first`` are looked at; the target's begin at ``to``, the right's
    at ``rows``; those of row r are ``left[place + stride k + r]``.
    """
    for j in range(first, width, LANES):
        o = to + j
        a, b = lanes(target, o), lanes(target, o + width)
        c, d = lanes(target, o + 2 * width), lanes(target, o + 3 * width)
        for k in range(count):
            of = place + stride * k
            row = lanes(right, rows + width * k + j)
            a = less_product(a, spread_at(left, of), row)
            b = less_product(b, spread_at(left, of + 1), row)
            c = less_product(c, spread_at(left, of + 2), row)
            d = less_product(d, spread_at(left, of + 3), row)
        put_lanes(target, o, a)
        put_lanes(target, o + width, b)
        put_lanes(target, o + 2 * width, c)
        put_lanes(target, o + 3 * width, d)


@kernel
def _solve_rows(target, to, width, first, scale, before):
    """Solve ROWS rows by a triangle: the reciprocals of its diagonal, and what stands above, column by column."""
    s0, s1, s2, s3 = spread(scale[0]), spread(scale[1]), spread(scale[2]), spread(scale[3])
    u01, u02, u12 = spread(before[0]), spread(before[1]), spread(before[2])
    u03, u13, u23 = spread(before[3]), spread(before[4]), spread(before[5])
    zero = spread(0.0)
    for j in range(first, width, LANES):
        o = to + j
        a = plus_product(zero, s0, lanes(target, o))
        b = plus_product(zero, s1, less_product(lanes(target, o + width), u01, a))
        c = less_product(less_product(lanes(target, o + 2 * width), u02, a), u12, b)
        c = plus_product(zero, s2, c)
        d = less_product(less_product(lanes(target, o + 3 * width), u03, a), u13, b)
        d = plus_product(zero, s3, less_product(d, u23, c))
        put_lanes(target, o, a)
        put_lanes(target, o + width, b)
        put_lanes(target, o + 2 * width, c)
        put_lanes(target, o + 3 * width, d)


@kernel
def _triangle(values, o, N):
    """The factor of ROWS rows and columns at ``o``, as ``_solve_rows`` takes it; NaN where there is none."""
    s0 = 1.0 / math.sqrt(values[o])
    u01, u02, u03 = s0 * values[o + 1], s0 * values[o + 2], s0 * values[o + 3]
    o += N
    s1 = 1.0 / math.sqrt(values[o + 1] - u01 * u01)
    u12, u13 = s1 * (values[o + 2] - u01 * u02), s1 * (values[o + 3] - u01 * u03)
    o += N
    s2 = 1.0 / math.sqrt(values[o + 2] - u02 * u02 - u12 * u12)
    u23 = s2 * (values[o + 3] - u02 * u03 - u12 * u13)
    o += N
    s3 = 1.0 / math.sqrt(values[o + 3] - u03 * u03 - u13 * u13 - u23 * u23)
    return (s0, s1, s2, s3), (u01, u02, u12, u03, u13, u23)


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
    for i in range(0, n, ROWS):
        first, o = i // LANES * LANES, place + N * i
        less_products(values, o, values, place + i, N, values, place, N, i, first)
        scale, before = _triangle(values, o + i, N)
        if not scale[0] + scale[1] + scale[2] + scale[3] < math.inf:  # or not a number
            return False
        _solve_rows(values, o, N, first, scale, before)
        for r in range(ROWS):
            row = o + N * r
            for j in range(first, i + r):
                values[row + j] = 0.0
            values[row + i + r] = scale[r]
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
    """Solve U^T Y = B (n, width) in place, in rows from ``rows`` of the array B, which has room for N of them.

    Rows have ``width`` numbers, a `padded` number; the rows beyond n are overwritten.
    """
    N = padded(n)
    for i in range(0, n, ROWS):
        to, o = rows + width * i, place + N * i + i
        less_products(B, to, values, place + i, N, B, rows, width, i, 0)
        p, q, r = o + N, o + 2 * N, o + 3 * N
        scale = values[o], values[p + 1], values[q + 2], values[r + 3]
        before = values[o + 1], values[o + 2], values[p + 2], values[o + 3], values[p + 3], values[q + 3]
        _solve_rows(B, to, width, 0, scale, before)
