"""Sums over the modes of a reduced body that eliminate them, in vector registers; C (6, n): its coupling."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import summing_kernel


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
