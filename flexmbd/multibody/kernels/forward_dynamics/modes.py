"""Sums over the modes of a reduced body that the articulated-body recursion takes, in vector registers."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import summing_kernel


@summing_kernel
def sum_pairs(pairs, o, n, q, qd, spins, table):
    """Write what the deformation makes of each mode's first moments into ``table`` (15, n), all but rows 9 to 11.

    With V_i = integral of rho phi_i r^T, r = x + Phi q: the symmetric part (rows 0 to 5), and the integrals of
    r x phi_i (6 to 8) and, if the body ``spins``, of (Phi qd) x phi_i (12 to 14).
    ``pairs[o:]``: (n, 9, n), and before it (9, n) the same of x.
    """
    # indices from a range need no look whether they count from the end, which would hold up the vector registers
    blocks = pairs[o : o + 9 * n * (n + 1)].reshape((n + 1, 9, n))
    for i in range(n):
        t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = t8 = 0.0
        u6 = u7 = u8 = 0.0
        if spins:
            for j in range(n):
                f = q[j]
                g = qd[j]
                t0 += blocks[i + 1, 0, j] * f
                t1 += blocks[i + 1, 1, j] * f
                t2 += blocks[i + 1, 2, j] * f
                t3 += blocks[i + 1, 3, j] * f
                t4 += blocks[i + 1, 4, j] * f
                t5 += blocks[i + 1, 5, j] * f
                x = blocks[i + 1, 6, j]
                y = blocks[i + 1, 7, j]
                z = blocks[i + 1, 8, j]
                t6 += x * f
                t7 += y * f
                t8 += z * f
                u6 += x * g
                u7 += y * g
                u8 += z * g
        else:
            for j in range(n):
                f = q[j]
                t0 += blocks[i + 1, 0, j] * f
                t1 += blocks[i + 1, 1, j] * f
                t2 += blocks[i + 1, 2, j] * f
                t3 += blocks[i + 1, 3, j] * f
                t4 += blocks[i + 1, 4, j] * f
                t5 += blocks[i + 1, 5, j] * f
                t6 += blocks[i + 1, 6, j] * f
                t7 += blocks[i + 1, 7, j] * f
                t8 += blocks[i + 1, 8, j] * f
        table[0, i] = t0 + blocks[0, 0, i]
        table[1, i] = t1 + blocks[0, 1, i]
        table[2, i] = t2 + blocks[0, 2, i]
        table[3, i] = t3 + blocks[0, 3, i]
        table[4, i] = t4 + blocks[0, 4, i]
        table[5, i] = t5 + blocks[0, 5, i]
        table[6, i] = t6 + blocks[0, 6, i]
        table[7, i] = t7 + blocks[0, 7, i]
        table[8, i] = t8 + blocks[0, 8, i]
        table[12, i] = u6
        table[13, i] = u7
        table[14, i] = u8


@summing_kernel
def second_moments(pairs, o, n, q, table):
    """What the deformation adds to the body's second moments (xx, xy, xz, yy, yz, zz)."""
    of_x = pairs[o : o + 9 * n].reshape((9, n))
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(n):
        f = q[i]
        xx += f * (table[0, i] + of_x[0, i])
        xy += f * (table[1, i] + of_x[1, i])
        xz += f * (table[2, i] + of_x[2, i])
        yy += f * (table[3, i] + of_x[3, i])
        yz += f * (table[4, i] + of_x[4, i])
        zz += f * (table[5, i] + of_x[5, i])
    return xx, xy, xz, yy, yz, zz


@summing_kernel
def first_moments(coupling, n, q):
    """Integral of rho Phi q."""
    x = y = z = 0.0
    for i in range(n):
        x += coupling[3, i] * q[i]
        y += coupling[4, i] * q[i]
        z += coupling[5, i] * q[i]
    return x, y, z


@summing_kernel
def spin_forces(n, w, qd, table, coupling, bias):
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
        x += g * coupling[0, i]
        y += g * coupling[1, i]
        z += g * coupling[2, i]
    return (
        2.0 * ((yy + zz) * w[0] - xy * w[1] - xz * w[2]) - y * w[2] + z * w[1],
        2.0 * ((xx + zz) * w[1] - xy * w[0] - yz * w[2]) - z * w[0] + x * w[2],
        2.0 * ((xx + yy) * w[2] - xz * w[0] - yz * w[1]) - x * w[1] + y * w[0],
    )


@summing_kernel
def modes_schur(coupling, n):
    """C C^T: blocks (xx .. zz) of rotation, (9) of rotation by translation, (xx .. zz) of translation."""
    a0 = a1 = a2 = a3 = a4 = a5 = 0.0
    b0 = b1 = b2 = b3 = b4 = b5 = b6 = b7 = b8 = 0.0
    for j in range(n):
        x, y, z = coupling[0, j], coupling[1, j], coupling[2, j]
        u, v, w = coupling[3, j], coupling[4, j], coupling[5, j]
        a0 += x * x
        a1 += x * y
        a2 += x * z
        a3 += y * y
        a4 += y * z
        a5 += z * z
        b0 += x * u
        b1 += x * v
        b2 += x * w
        b3 += y * u
        b4 += y * v
        b5 += y * w
        b6 += z * u
        b7 += z * v
        b8 += z * w
    m0 = m1 = m2 = m3 = m4 = m5 = 0.0
    for j in range(n):
        x, y, z = coupling[3, j], coupling[4, j], coupling[5, j]
        m0 += x * x
        m1 += x * y
        m2 += x * z
        m3 += y * y
        m4 += y * z
        m5 += z * z
    return (a0, a1, a2, a3, a4, a5), (b0, b1, b2, b3, b4, b5, b6, b7, b8), (m0, m1, m2, m3, m4, m5)


@summing_kernel
def modes_wrench(coupling, bias, n):
    """-C bias: torque and force."""
    t0 = t1 = t2 = f0 = f1 = f2 = 0.0
    for j in range(n):
        s = bias[j]
        t0 -= coupling[0, j] * s
        t1 -= coupling[1, j] * s
        t2 -= coupling[2, j] * s
        f0 -= coupling[3, j] * s
        f1 -= coupling[4, j] * s
        f2 -= coupling[5, j] * s
    return (t0, t1, t2), (f0, f1, f2)


@summing_kernel
def free_modal_accelerations(coupling, bias, n, angular, linear, out):
    """out = -(bias + C^T y) for the acceleration y of B: modal accelerations without interface wrenches."""
    for j in range(n):
        out[j] = -(
            bias[j]
            + coupling[0, j] * angular[0]
            + coupling[1, j] * angular[1]
            + coupling[2, j] * angular[2]
            + coupling[3, j] * linear[0]
            + coupling[4, j] * linear[1]
            + coupling[5, j] * linear[2]
        )


@summing_kernel
def three_sums(modal, o, rows, n):
    """Sums of modal[o + j] rows[i, j] over the modes j, for three rows i."""
    row = modal[o : o + n]
    t0 = t1 = t2 = 0.0
    for j in range(n):
        s = row[j]
        t0 += s * rows[0, j]
        t1 += s * rows[1, j]
        t2 += s * rows[2, j]
    return t0, t1, t2
