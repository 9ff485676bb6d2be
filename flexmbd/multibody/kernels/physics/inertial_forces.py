"""Inertia of a rigid or reduced body: the wrench and modal forces that a motion requires."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, store3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, summing_kernel


@entry_kernel
def rigid_second_moment(row):
    """(xx, xy, xz, yy, yz, zz), integral of rho x x^T about B."""
    o = at.SECOND_MOMENT
    return (row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5])


@entry_kernel
def inertia_times(second, w):
    """(trace(J) - J) w: the inertia tensor of the second moment J, times w."""
    xx, xy, xz, yy, yz, zz = second
    return (
        (yy + zz) * w[0] - xy * w[1] - xz * w[2],
        -xy * w[0] + (xx + zz) * w[1] - yz * w[2],
        -xz * w[0] - yz * w[1] + (xx + yy) * w[2],
    )


@kernel
def add_rigid_wrench(mass, first, second, turning, row):
    """Write F, T = integral of rho a, rho r x a for a body that moves as a rigid one.

    a = a_B + dw x r + w x (w x r) (Ambrosio & Nikravesh 1992, eq. 28 without deformation).
    ``turning`` (``kinds.NONROTATING`` to ``kinds.FREE_ROTATION``) says where w x (J w) is zero.
    """
    w = load3(row, at.B_W)
    dw = load3(row, at.B_DW)
    a = load3(row, at.B_A)
    force = add3(
        scale3(mass, a), add3(cross3(dw, first), cross3(w, cross3(w, first)))
    )
    torque = add3(cross3(first, a), inertia_times(second, dw))
    if turning == kinds.PLANAR_ROTATION or turning == kinds.FREE_ROTATION:
        torque = add3(torque, cross3(w, inertia_times(second, w)))
    store3(row, at.B_F, force)
    store3(row, at.B_T, torque)


@summing_kernel
def _skew_sums(modal, o, n, q):
    """Integral of rho (Phi q) x phi_j, the pairs of mode j standing from ``o``."""
    pairs = modal[o : o + 9 * n].reshape((9, n))
    x = y = z = 0.0
    for k in range(n):
        f = q[k]
        x += (pairs[7, k] - pairs[5, k]) * f
        y += (pairs[2, k] - pairs[6, k]) * f
        z += (pairs[3, k] - pairs[1, k]) * f
    return x, y, z


@summing_kernel
def _pair_sums(modal, o, n, q, qd):
    """Integrals of rho phi_j (Phi q)^T, row by row, and of rho (Phi qd) x phi_j; see `_skew_sums`."""
    # indices from a range need no look whether they count from the end, which would hold up the vector registers
    pairs = modal[o : o + 9 * n].reshape((9, n))
    v0 = v1 = v2 = v3 = v4 = v5 = v6 = v7 = v8 = 0.0
    x = y = z = 0.0
    for k in range(n):
        f = q[k]
        g = qd[k]
        p1, p2, p3, p5, p6, p7 = pairs[1, k], pairs[2, k], pairs[3, k], pairs[5, k], pairs[6, k], pairs[7, k]
        v0 += pairs[0, k] * f
        v1 += p1 * f
        v2 += p2 * f
        v3 += p3 * f
        v4 += pairs[4, k] * f
        v5 += p5 * f
        v6 += p6 * f
        v7 += p7 * f
        v8 += pairs[8, k] * f
        x += (p7 - p5) * g
        y += (p2 - p6) * g
        z += (p3 - p1) * g
    return (v0, v1, v2, v3, v4, v5, v6, v7, v8), (x, y, z)


@kernel
def nonrotating_inertia(plan, i, q, qdd, row, out):
    """Write the wrench of reduced body i, whose frame never turns, and the modal forces of its inertia.

    With a = a_B + Phi qdd nothing is left of the Coriolis and centrifugal terms.
    """
    flex = plan.flex[plan.tree[i, at.FLEX]]
    modal = plan.modal
    rigid = plan.rigid[i]
    n = flex[at.N_MODES]
    a = load3(row, at.B_A)
    first = load3(rigid, at.FIRST_MOMENT)
    force = scale3(rigid[at.MASS], a)
    tx = ty = tz = 0.0
    for j in range(n):
        o = flex[at.MODAL_PAIR] + 9 * n * j
        s = flex[at.MODAL_SECOND] + 9 * j
        x, y, z = _skew_sums(modal, o, n, q)
        x += modal[s + 7] - modal[s + 5]
        y += modal[s + 2] - modal[s + 6]
        z += modal[s + 3] - modal[s + 1]
        c = load3(modal, flex[at.MODAL_FIRST] + 3 * j)
        e = qdd[j]
        first = add3(first, scale3(q[j], c))
        force = add3(force, scale3(e, c))
        tx += e * x
        ty += e * y
        tz += e * z
        out[j] = dot3(c, a) + e
    store3(row, at.B_F, force)
    store3(row, at.B_T, add3(cross3(first, a), (tx, ty, tz)))


@kernel
def flexible_inertia(plan, i, q, qd, qdd, row, out):  # noqa: PLR0915  one pass over the pairs
    """Write the wrench of reduced body i and the modal forces of its inertia.

    With r = x + Phi q and a = a_B + dw x r + w x (w x r) + 2 w x (Phi qd) + Phi qdd: F, T as for
    a rigid body, and out_i = integral of rho phi_i . a (Ambrosio & Nikravesh 1992, eq. 31-34).
    """
    flex = plan.flex[plan.tree[i, at.FLEX]]
    modal = plan.modal
    rigid = plan.rigid[i]
    n = flex[at.N_MODES]
    c0 = flex[at.MODAL_FIRST]
    s0 = flex[at.MODAL_SECOND]
    p0 = flex[at.MODAL_PAIR]
    w = load3(row, at.B_W)
    dw = load3(row, at.B_DW)
    a = load3(row, at.B_A)
    ww = dot3(w, w)
    # W = [w]^2 + [dw], so that the acceleration without a_B and q's rates is W r
    w00 = w[0] * w[0] - ww
    w11 = w[1] * w[1] - ww
    w22 = w[2] * w[2] - ww
    w01 = w[0] * w[1] - dw[2]
    w10 = w[0] * w[1] + dw[2]
    w02 = w[0] * w[2] + dw[1]
    w20 = w[0] * w[2] - dw[1]
    w12 = w[1] * w[2] - dw[0]
    w21 = w[1] * w[2] + dw[0]
    hx, hy, hz = rigid[at.FIRST_MOMENT], rigid[at.FIRST_MOMENT + 1], rigid[at.FIRST_MOMENT + 2]
    vx = vy = vz = 0.0  # integral of rho Phi qd
    ax = ay = az = 0.0  # integral of rho Phi qdd
    tx = ty = tz = 0.0  # torque of Coriolis terms and of Phi qdd
    xx, xy, xz, yy, yz, zz = rigid_second_moment(rigid)
    for j in range(n):
        v, u = _pair_sums(modal, p0 + 9 * n * j, n, q, qd)
        v0, v1, v2, v3, v4, v5, v6, v7, v8 = v
        s = s0 + 9 * j
        # J = J0 + sum q_j (V_j + X_j^T), V_j = integral of rho phi_j r^T
        f = q[j]
        v0 += modal[s]
        v1 += modal[s + 1]
        v2 += modal[s + 2]
        v3 += modal[s + 3]
        v4 += modal[s + 4]
        v5 += modal[s + 5]
        v6 += modal[s + 6]
        v7 += modal[s + 7]
        v8 += modal[s + 8]
        xx += f * (v0 + modal[s])
        yy += f * (v4 + modal[s + 4])
        zz += f * (v8 + modal[s + 8])
        xy += f * (v1 + modal[s + 3])
        xz += f * (v2 + modal[s + 6])
        yz += f * (v5 + modal[s + 7])
        c = (modal[c0 + 3 * j], modal[c0 + 3 * j + 1], modal[c0 + 3 * j + 2])
        hx += f * c[0]
        hy += f * c[1]
        hz += f * c[2]
        g = qd[j]
        vx += g * c[0]
        vy += g * c[1]
        vz += g * c[2]
        e = qdd[j]
        ax += e * c[0]
        ay += e * c[1]
        az += e * c[2]
        # r x phi_j, and r x (w x phi_j) = w (r . phi_j) - phi_j (r . w)
        trace = v0 + v4 + v8
        g *= 2.0
        tx += e * (v7 - v5) + g * (w[0] * trace - v0 * w[0] - v1 * w[1] - v2 * w[2])
        ty += e * (v2 - v6) + g * (w[1] * trace - v3 * w[0] - v4 * w[1] - v5 * w[2])
        tz += e * (v3 - v1) + g * (w[2] * trace - v6 * w[0] - v7 * w[1] - v8 * w[2])
        load = c[0] * a[0] + c[1] * a[1] + c[2] * a[2]
        load += w00 * v0 + w01 * v1 + w02 * v2
        load += w10 * v3 + w11 * v4 + w12 * v5
        load += w20 * v6 + w21 * v7 + w22 * v8
        # 2 phi_j . (w x Phi qd) = 2 w . sum phi_k x phi_j qd_k
        load += 2.0 * (w[0] * u[0] + w[1] * u[1] + w[2] * u[2])
        out[j] = load + e
    add_rigid_wrench(rigid[at.MASS], (hx, hy, hz), (xx, xy, xz, yy, yz, zz), kinds.FREE_ROTATION, row)
    coriolis = cross3(w, (vx, vy, vz))
    store3(
        row,
        at.B_F,
        add3(load3(row, at.B_F), add3((ax, ay, az), scale3(2.0, coriolis))),
    )
    store3(row, at.B_T, add3(load3(row, at.B_T), (tx, ty, tz)))
