"""Six-dimensional inertias in registers: blocks (A, B; B^T, M) of rotation and translation.

A and M are symmetric, six entries (xx, xy, xz, yy, yz, zz); B, nine, couples torque with linear
acceleration: torque = A dw + B a, force = B^T dw + M a.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, compose_back, cross3
from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def load6(row, o):
    """Six entries of row from o."""
    return (row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5])


@kernel
def store6(row, o, a):
    """row[o : o + 6] = a."""
    row[o] = a[0]
    row[o + 1] = a[1]
    row[o + 2] = a[2]
    row[o + 3] = a[3]
    row[o + 4] = a[4]
    row[o + 5] = a[5]


@kernel
def row3(table, i, o):
    """Three entries of row i of a table from column o."""
    return (table[i, o], table[i, o + 1], table[i, o + 2])


@kernel
def row6(table, i, o):
    """Six entries of row i of a table from column o."""
    return (
        table[i, o],
        table[i, o + 1],
        table[i, o + 2],
        table[i, o + 3],
        table[i, o + 4],
        table[i, o + 5],
    )


@kernel
def row9(table, i, o):
    """Nine entries of row i of a table from column o."""
    return (
        table[i, o],
        table[i, o + 1],
        table[i, o + 2],
        table[i, o + 3],
        table[i, o + 4],
        table[i, o + 5],
        table[i, o + 6],
        table[i, o + 7],
        table[i, o + 8],
    )


@kernel
def put3(table, i, o, a):
    """Row i of a table from column o = a (3)."""
    table[i, o] = a[0]
    table[i, o + 1] = a[1]
    table[i, o + 2] = a[2]


@kernel
def put6(table, i, o, a):
    """Row i of a table from column o = a (6)."""
    put3(table, i, o, (a[0], a[1], a[2]))
    put3(table, i, o + 3, (a[3], a[4], a[5]))


@kernel
def put9(table, i, o, a):
    """Row i of a table from column o = a (9)."""
    put6(table, i, o, (a[0], a[1], a[2], a[3], a[4], a[5]))
    put3(table, i, o + 6, (a[6], a[7], a[8]))


@kernel
def add6(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


@kernel
def add9(a, b):
    """a + b."""
    return (
        a[0] + b[0],
        a[1] + b[1],
        a[2] + b[2],
        a[3] + b[3],
        a[4] + b[4],
        a[5] + b[5],
        a[6] + b[6],
        a[7] + b[7],
        a[8] + b[8],
    )


@kernel
def sub6(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5])


@kernel
def scale6(s, a):
    """s a."""
    return (s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5])


@kernel
def sub9(a, b):
    """a - b."""
    return add9(a, (-b[0], -b[1], -b[2], -b[3], -b[4], -b[5], -b[6], -b[7], -b[8]))


@kernel
def skew(h):
    """[h], so that [h] v = h x v."""
    return (0.0, -h[2], h[1], h[2], 0.0, -h[0], -h[1], h[0], 0.0)


@kernel
def transpose(m):
    """M^T."""
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def symmetric_times(a, v):
    """A v."""
    return (
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[1] * v[0] + a[3] * v[1] + a[4] * v[2],
        a[2] * v[0] + a[4] * v[1] + a[5] * v[2],
    )


@kernel
def rotate_symmetric(r, a):
    """R A R^T."""
    t = compose(r, (a[0], a[1], a[2], a[1], a[3], a[4], a[2], a[4], a[5]))
    return (
        t[0] * r[0] + t[1] * r[1] + t[2] * r[2],
        t[0] * r[3] + t[1] * r[4] + t[2] * r[5],
        t[0] * r[6] + t[1] * r[7] + t[2] * r[8],
        t[3] * r[3] + t[4] * r[4] + t[5] * r[5],
        t[3] * r[6] + t[4] * r[7] + t[5] * r[8],
        t[6] * r[6] + t[7] * r[7] + t[8] * r[8],
    )


@kernel
def rotate_block(r, b):
    """R B R^T."""
    return compose_back(compose(r, b), r)


@kernel
def turn_symmetric(c, s, a):
    """R A R^T of the turn by the angle of (c, s) about z."""
    cc = c * c
    ss = s * s
    cs = c * s
    t = 2.0 * cs * a[1]
    return (
        cc * a[0] - t + ss * a[3],
        cs * (a[0] - a[3]) + (cc - ss) * a[1],
        c * a[2] - s * a[4],
        ss * a[0] + t + cc * a[3],
        s * a[2] + c * a[4],
        a[5],
    )


@kernel
def turn_block(c, s, b):
    """R B R^T of the turn by the angle of (c, s) about z."""
    t0 = c * b[0] - s * b[3]
    t1 = c * b[1] - s * b[4]
    t3 = s * b[0] + c * b[3]
    t4 = s * b[1] + c * b[4]
    return (
        c * t0 - s * t1,
        s * t0 + c * t1,
        c * b[2] - s * b[5],
        c * t3 - s * t4,
        s * t3 + c * t4,
        s * b[2] + c * b[5],
        c * b[6] - s * b[7],
        s * b[6] + c * b[7],
        b[8],
    )


@kernel
def turn(c, s, v):
    """R v of the turn by the angle of (c, s) about z."""
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@kernel
def shift_block(r, b, m):
    """B + [r] M: the block B about a point from which the old one lies at r."""
    return (
        b[0] - r[2] * m[1] + r[1] * m[2],
        b[1] - r[2] * m[3] + r[1] * m[4],
        b[2] - r[2] * m[4] + r[1] * m[5],
        b[3] + r[2] * m[0] - r[0] * m[2],
        b[4] + r[2] * m[1] - r[0] * m[4],
        b[5] + r[2] * m[2] - r[0] * m[5],
        b[6] - r[1] * m[0] + r[0] * m[1],
        b[7] - r[1] * m[1] + r[0] * m[3],
        b[8] - r[1] * m[2] + r[0] * m[4],
    )


@kernel
def shift_symmetric(r, a, b, shifted):
    """A + B [r]^T + [r] shifted^T: the block A that goes with ``shifted`` = B + [r] M."""
    return (
        a[0] + r[1] * (b[2] + shifted[2]) - r[2] * (b[1] + shifted[1]),
        a[1] + r[2] * b[0] - r[0] * b[2] + r[1] * shifted[5] - r[2] * shifted[4],
        a[2] + r[0] * b[1] - r[1] * b[0] + r[1] * shifted[8] - r[2] * shifted[7],
        a[3] + r[2] * (b[3] + shifted[3]) - r[0] * (b[5] + shifted[5]),
        a[4] + r[0] * b[4] - r[1] * b[3] + r[2] * shifted[6] - r[0] * shifted[8],
        a[5] + r[0] * (b[7] + shifted[7]) - r[1] * (b[6] + shifted[6]),
    )


@kernel
def shift_torque(r, torque, force):
    """torque + r x force."""
    return add3(torque, cross3(r, force))


@kernel
def subtract_outer(a, b, m, u, e):
    """Blocks of the inertia less u e^T, where e is u but for a factor."""
    return (
        (
            a[0] - u[0] * e[0],
            a[1] - u[0] * e[1],
            a[2] - u[0] * e[2],
            a[3] - u[1] * e[1],
            a[4] - u[1] * e[2],
            a[5] - u[2] * e[2],
        ),
        (
            b[0] - u[0] * e[3],
            b[1] - u[0] * e[4],
            b[2] - u[0] * e[5],
            b[3] - u[1] * e[3],
            b[4] - u[1] * e[4],
            b[5] - u[1] * e[5],
            b[6] - u[2] * e[3],
            b[7] - u[2] * e[4],
            b[8] - u[2] * e[5],
        ),
        (
            m[0] - u[3] * e[3],
            m[1] - u[3] * e[4],
            m[2] - u[3] * e[5],
            m[3] - u[4] * e[4],
            m[4] - u[4] * e[5],
            m[5] - u[5] * e[5],
        ),
    )
