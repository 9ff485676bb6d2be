"""Sums over the modes of a reduced body, whose integrals all stand in one layout, in vector registers.

Of a mode phi_i and a field u the moments are rho phi_i u^T integrated over the body, nine numbers: the symmetric part
(xx, xy, xz, yy, yz, zz) and the integral of rho u x phi_i (3).  ``Plan.modal`` holds from MODAL_MOMENTS those with the
place x, (9, n), and those with each mode j as the field, (n, 9, n) with j first, and from MODAL_FIRST the integrals of
rho phi_i, (3, n).  A moments' table is what the deformed body r = x + Phi q makes of them, one column a mode.

What a field Phi q makes of the moments is a sum over j of rows that are as long as a table: nine times the modes, for
which vector registers pay at any number of modes, where sums mode by mode would be too short for them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel

FloatArray = NDArray[np.float64]

# Rows of a moments' table: with r, the symmetric part; torque and force per unit modal acceleration, that is the
# integrals of rho r x phi_i and rho phi_i; the integral of rho (Phi qd) x phi_i.
SYMMETRIC, COUPLING, FORCE, RATES = 0, 6, 9, 12


def modal_moments(gram: FloatArray, n: int) -> FloatArray:
    """(1 + n, 9, n) what Plan.modal holds, from a record's Gram matrix (4 + 3 n, 4 + 3 n)."""
    fields = np.concatenate([gram[1:4, 4:], gram[4:, 4:]]).reshape(1 + n, 3, n, 3)
    m = fields.transpose(0, 3, 1, 2)  # [field, component of phi_i, component of the field, i]
    skew = np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
    upper = np.triu_indices(3)
    symmetric = 0.5 * (m + m.transpose(0, 2, 1, 3))[:, upper[0], upper[1]]
    return np.concatenate([symmetric, skew], axis=1)


@summing_kernel
def _add_fields(modal, o, stride, n, q, out):
    """Add to ``out`` (k,) the sum over j of q_j times the k numbers of ``modal`` from o + stride j."""
    # indices from a range need no look whether they count from the end, which would hold up the vector registers
    size = out.shape[0]
    four = n - n % 4
    for j in range(0, four, 4):
        p = o + stride * j
        row0 = modal[p : p + size]
        row1 = modal[p + stride : p + stride + size]
        row2 = modal[p + 2 * stride : p + 2 * stride + size]
        row3 = modal[p + 3 * stride : p + 3 * stride + size]
        f0, f1, f2, f3 = q[j], q[j + 1], q[j + 2], q[j + 3]
        for c in range(size):
            out[c] += f0 * row0[c] + f1 * row1[c] + f2 * row2[c] + f3 * row3[c]
    for j in range(four, n):
        row = modal[o + stride * j : o + stride * j + size]
        f = q[j]
        for c in range(size):
            out[c] += f * row[c]


@kernel
def _unpack(table, first, count, n):
    """Bring ``count`` rows of n numbers, which stand without gaps from row ``first`` on, to their places."""
    width = table.shape[1]
    if width == n:
        return
    memory = table.reshape((table.shape[0] * width,))
    o = first * width
    for k in range(count - 1, 0, -1):
        for i in range(n - 1, -1, -1):
            memory[o + k * width + i] = memory[o + k * n + i]


@kernel
def _fill(out, value):
    for c in range(out.shape[0]):
        out[c] = value


@kernel
def _copy(values, out):
    for c in range(out.shape[0]):
        out[c] = values[c]


@kernel
def sum_pairs(modal, o, n, q, table, first):
    """Write each mode's moments with Phi q to rows ``first`` .. of ``table``; ``o``: MODAL_MOMENTS of the body."""
    width = table.shape[1]
    rows = table.reshape((table.shape[0] * width,))[first * width : first * width + 9 * n]
    _fill(rows, 0.0)
    _add_fields(modal, o + 9 * n, 9 * n, n, q, rows)
    _unpack(table, first, 9, n)


@kernel
def sum_moving_pairs(modal, o, force, n, q, qd, table):
    """A whole table: of the place x + Phi q and, with the rates Phi qd, its last rows."""
    width = table.shape[1]
    rows = table.reshape((table.shape[0] * width,))[: 15 * n]
    _copy(modal[o : o + 9 * n], rows[: 9 * n])
    _add_fields(modal, o + 9 * n, 9 * n, n, q, rows[: 9 * n])
    _copy(modal[force : force + 3 * n], rows[FORCE * n : (FORCE + 3) * n])
    rates = rows[RATES * n :]
    _fill(rates, 0.0)
    _add_fields(modal, o + 15 * n, 9 * n, n, qd, rates)
    _unpack(table, 0, 15, n)


@kernel
def sum_couplings(modal, o, n, q, table, first):
    """The last three rows of ``sum_pairs`` alone, the integrals of rho (Phi q) x phi_i."""
    width = table.shape[1]
    rows = table.reshape((table.shape[0] * width,))[first * width : first * width + 3 * n]
    _fill(rows, 0.0)
    _add_fields(modal, o + 15 * n, 9 * n, n, q, rows)
    _unpack(table, first, 3, n)


@summing_kernel
def add_place(modal, o, force, n, table, first):
    """Add the moments with x to rows ``first`` to COUPLING + 2 of a table of Phi q; write the rows FORCE."""
    with_x = modal[o : o + 9 * n].reshape((9, n))
    forces = modal[force : force + 3 * n].reshape((3, n))
    for k in range(first, 9):
        for i in range(n):
            table[k, i] += with_x[k, i]
    for k in range(3):
        for i in range(n):
            table[FORCE + k, i] = forces[k, i]


@summing_kernel
def second_moments(modal, o, n, q, table):
    """What the deformation adds to the body's second moments (xx, xy, xz, yy, yz, zz)."""
    with_x = modal[o : o + 9 * n].reshape((9, n))
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(n):
        f = q[i]
        xx += f * (table[0, i] + with_x[0, i])
        xy += f * (table[1, i] + with_x[1, i])
        xz += f * (table[2, i] + with_x[2, i])
        yy += f * (table[3, i] + with_x[3, i])
        yz += f * (table[4, i] + with_x[4, i])
        zz += f * (table[5, i] + with_x[5, i])
    return xx, xy, xz, yy, yz, zz


@summing_kernel
def first_moments(modal, o, n, q):
    """Integral of rho Phi q; ``o``: MODAL_FIRST of the body."""
    rows = modal[o : o + 3 * n].reshape((3, n))
    x = y = z = 0.0
    for i in range(n):
        x += rows[0, i] * q[i]
        y += rows[1, i] * q[i]
        z += rows[2, i] * q[i]
    return x, y, z


@summing_kernel
def spin_forces(n, w, qd, table, bias):
    """Add centrifugal and Coriolis forces to ``bias``; return the torque of the Coriolis forces about B."""
    ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    a = w[0] * w[0] - ww
    b = 2.0 * w[0] * w[1]
    c = 2.0 * w[0] * w[2]
    d = w[1] * w[1] - ww
    e = 2.0 * w[1] * w[2]
    f = w[2] * w[2] - ww
    for i in range(n):
        load = a * table[0, i] + b * table[1, i] + c * table[2, i]
        load += d * table[3, i] + e * table[4, i] + f * table[5, i]
        bias[i] += load + 2.0 * (w[0] * table[12, i] + w[1] * table[13, i] + w[2] * table[14, i])
    # r x (w x phi) = w (r . phi) - phi (r . w), sums by component first
    xx = xy = xz = yy = yz = zz = x = y = z = 0.0
    for i in range(n):
        g = qd[i]
        xx += g * table[0, i]
        xy += g * table[1, i]
        xz += g * table[2, i]
        yy += g * table[3, i]
        yz += g * table[4, i]
        zz += g * table[5, i]
        x += g * table[6, i]
        y += g * table[7, i]
        z += g * table[8, i]
    return (
        2.0 * ((yy + zz) * w[0] - xy * w[1] - xz * w[2]) - y * w[2] + z * w[1],
        2.0 * ((xx + zz) * w[1] - xy * w[0] - yz * w[2]) - z * w[0] + x * w[2],
        2.0 * ((xx + yy) * w[2] - xz * w[0] - yz * w[1]) - x * w[1] + y * w[0],
    )


@summing_kernel
def accelerate(n, angular, linear, qdd, table, out):
    """Add qdd + C^T y to ``out`` (n,); return torque and force C qdd; C: rows COUPLING and FORCE of ``table``."""
    t0 = t1 = t2 = f0 = f1 = f2 = 0.0
    for j in range(n):
        s = qdd[j]
        t0 += table[6, j] * s
        t1 += table[7, j] * s
        t2 += table[8, j] * s
        f0 += table[9, j] * s
        f1 += table[10, j] * s
        f2 += table[11, j] * s
        out[j] += (
            s
            + table[6, j] * angular[0]
            + table[7, j] * angular[1]
            + table[8, j] * angular[2]
            + table[9, j] * linear[0]
            + table[10, j] * linear[1]
            + table[11, j] * linear[2]
        )
    return (t0, t1, t2), (f0, f1, f2)


@summing_kernel
def add_pair_products(modal, o, n, j, G, row):
    """Add to ``row`` (n,) the integrals of rho phi_j^T G phi_k, of mode j with each mode k."""
    pairs = modal[o + 9 * n * (j + 1) : o + 9 * n * (j + 2)].reshape((9, n))  # of phi_k, phi_j being the field
    a, b, c = G[1] + G[3], G[2] + G[6], G[5] + G[7]
    x, y, z = 0.5 * (G[5] - G[7]), 0.5 * (G[6] - G[2]), 0.5 * (G[1] - G[3])
    for k in range(n):
        row[k] += (
            G[0] * pairs[0, k]
            + a * pairs[1, k]
            + b * pairs[2, k]
            + G[4] * pairs[3, k]
            + c * pairs[4, k]
            + G[8] * pairs[5, k]
            + x * pairs[6, k]
            + y * pairs[7, k]
            + z * pairs[8, k]
        )
