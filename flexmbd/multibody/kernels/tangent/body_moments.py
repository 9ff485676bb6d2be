"""The contribution of one body to the tangent: its mass moments, and the derivatives of its forces by its own modes.

Particles of a body whose frame's motion varies accelerate by alpha + eta x r + 2 phi' x r' (see `tangent`), so the
mass, the first and second moments, the momentum and the integral of rho r r'^T say all that the wrench's derivative
needs; a mode's force needs three vectors more.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.jacobian_derivatives import add9, scale9, skew
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    compose_back,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.physics.elasticity import stretch
from flexmbd.multibody.kernels.physics.energy_polynomial import add_polynomial_tangent
from flexmbd.multibody.kernels.physics.gyroscopic import momentum_slope, rotor_momentum
from flexmbd.multibody.kernels.physics.inertial_forces import rigid_second_moment
from flexmbd.multibody.kernels.physics.modal_moments import FORCE, add_pair_products, first_moments, sum_pairs
from flexmbd.multibody.kernels.physics.reduced_inertia import deform_body
from flexmbd.multibody.kernels.tangent import tangent_layout as tl


@kernel
def axial(m):
    """Integral of r x phi, m being that of phi r^T."""
    return (m[7] - m[5], m[2] - m[6], m[3] - m[1])


@kernel
def outer(a, b):
    """The product a b^T."""
    return (
        a[0] * b[0], a[0] * b[1], a[0] * b[2],
        a[1] * b[0], a[1] * b[1], a[1] * b[2],
        a[2] * b[0], a[2] * b[1], a[2] * b[2],
    )  # fmt: skip


@kernel
def _moments(table, o, j):
    """Integral of rho phi_j u^T, row by row, from its nine numbers in rows o of a table (``modal_moments``)."""
    xx, xy, xz = table[o, j], table[o + 1, j], table[o + 2, j]
    yy, yz, zz = table[o + 3, j], table[o + 4, j], table[o + 5, j]
    x, y, z = 0.5 * table[o + 6, j], 0.5 * table[o + 7, j], 0.5 * table[o + 8, j]
    return (xx, xy - z, xz + y, xy + z, yy, yz - x, xz - y, yz + x, zz)


@kernel
def _spun_second(w, second):
    """Integral of rho r (w x r)^T: rows w x (row of the second moment)."""
    xx, xy, xz, yy, yz, zz = second
    a = cross3(w, (xx, xy, xz))
    b = cross3(w, (xy, yy, yz))
    c = cross3(w, (xz, yz, zz))
    return (*a, *b, *c)


@kernel
def _put_composite(row, origin, body, mass, first, rest, second, flow):
    """Write a body's moments about o in world axes; ``origin`` holds place and velocity of o.

    In the body's axes about its origin: first and second moment, ``rest`` the integral of rho Phi qd, ``flow`` that
    of rho r r'^T with r' seen from the origin.
    """
    R = load9(body, at.B_R)
    p = sub3(load3(body, at.B_P), load3(origin, 0))
    v = sub3(rotate(R, load3(body, at.B_V)), load3(origin, 3))
    w = rotate(R, load3(body, at.B_W))
    h = rotate(R, first)
    momentum = add3(scale3(mass, v), add3(cross3(w, h), rotate(R, rest)))
    xx, xy, xz, yy, yz, zz = second
    J = compose_back(compose(R, (xx, xy, xz, xy, yy, yz, xz, yz, zz)), R)
    N = add9(compose_back(compose(R, flow), R), add9(outer(p, momentum), outer(h, v)))
    row[tl.C_MASS] = mass
    for k in range(3):
        row[tl.C_FIRST + k] = h[k] + mass * p[k]
        row[tl.C_MOMENTUM + k] = momentum[k]
    o = tl.C_SECOND
    row[o] = J[0] + p[0] * (2.0 * h[0] + mass * p[0])
    row[o + 1] = J[1] + p[0] * h[1] + h[0] * p[1] + mass * p[0] * p[1]
    row[o + 2] = J[2] + p[0] * h[2] + h[0] * p[2] + mass * p[0] * p[2]
    row[o + 3] = J[4] + p[1] * (2.0 * h[1] + mass * p[1])
    row[o + 4] = J[5] + p[1] * h[2] + h[1] * p[2] + mass * p[1] * p[2]
    row[o + 5] = J[8] + p[2] * (2.0 * h[2] + mass * p[2])
    for k in range(9):
        row[tl.C_FLOW + k] = N[k]
    force = rotate(R, load3(body, at.B_F))
    torque = add3(rotate(R, load3(body, at.B_T)), cross3(p, force))
    for k in range(3):
        row[tl.C_FORCE + k] = force[k]
        row[tl.C_TORQUE + k] = torque[k]


@kernel
def rigid_composite(plan, work, tw, i):
    """Write the moments of rigid body i."""
    rigid = plan.rigid[i]
    body = work.body[i]
    second = rigid_second_moment(rigid)
    flow = _spun_second(load3(body, at.B_W), second)
    first = load3(rigid, at.FIRST_MOMENT)
    _put_composite(tw.body[i], tw.origin, body, rigid[at.MASS], first, (0.0, 0.0, 0.0), second, flow)


@kernel
def flexible_composite(plan, work, tw, i, q, qd, qdd):
    """Write the moments of reduced body i as it is deformed; leaves ``tw.mode_moments``."""
    flex = plan.flex[plan.tree[i, at.FLEX]]
    n = flex[at.N_MODES]
    body = work.body[i]
    sums = tw.mode_moments
    second, first = deform_body(plan, i, q, qd, False, sums)
    sum_pairs(plan.modal, flex[at.MODAL_MOMENTS], n, qd, sums, tl.M_RATES)
    sum_pairs(plan.modal, flex[at.MODAL_MOMENTS], n, qdd, sums, tl.M_SECOND_RATES)
    rest = first_moments(plan.modal, flex[at.MODAL_FIRST], n, qd)
    flow = _spun_second(load3(body, at.B_W), second)
    for j in range(n):
        V = _moments(sums, 0, j)
        V = (V[0], V[3], V[6], V[1], V[4], V[7], V[2], V[5], V[8])
        flow = add9(flow, scale9(qd[j], V))
    if flex[at.GYROSCOPIC] >= 0:
        # the particles of rotors move as well: h is the integral of rho r x r', twice the skew part
        flow = add9(flow, scale9(-0.5, skew(rotor_momentum(plan.modal, flex, q))))
    _put_composite(tw.body[i], tw.origin, body, plan.rigid[i, at.MASS], first, rest, second, flow)


@kernel
def modal_columns(plan, work, tw, i, per_x, per_v, per_a):
    """Write the projection of the frame's motion on the modes of body i, and the change of its wrench by its modes.

    Reads ``tw.mode_moments``.
    """
    tree = plan.tree[i]
    flex = plan.flex[tree[at.FLEX]]
    body = work.body[i]
    R = load9(body, at.B_R)
    p = sub3(load3(body, at.B_P), load3(tw.origin, 0))
    v = sub3(rotate(R, load3(body, at.B_V)), load3(tw.origin, 3))
    w = load3(body, at.B_W)
    a = load3(body, at.B_A)
    W = _spin_matrix(w, load3(body, at.B_DW))
    own = _particle_matrix(W, w, per_x, per_v)
    sums = tw.mode_moments
    G = (own[0] + per_a, own[1], own[2], own[3], own[4] + per_a, own[5], own[6], own[7], own[8] + per_a)
    for j in range(flex[at.N_MODES]):
        V, U = _moments(sums, 0, j), _moments(sums, tl.M_RATES, j)
        Z = _moments(sums, tl.M_SECOND_RATES, j)
        c = (sums[FORCE, j], sums[FORCE + 1, j], sums[FORCE + 2, j])
        # projection on phi_j: integrals of rho r' x phi_j, rho r x phi_j, rho phi_j
        cw = rotate(R, c)
        wV = (w[0] * V[0] + w[1] * V[3] + w[2] * V[6],
              w[0] * V[1] + w[1] * V[4] + w[2] * V[7],
              w[0] * V[2] + w[1] * V[5] + w[2] * V[8])  # fmt: skip
        swept = add3(sub3(wV, scale3(V[0] + V[4] + V[8], w)), axial(U))
        f0 = add3(rotate(R, swept), cross3(v, cw))
        f1 = add3(rotate(R, axial(V)), cross3(p, cw))
        # the accelerations phi_j makes of its particles, and those that it meets
        force = rotate(G, c)
        met = add9(compose_back(V, W), Z)
        u0 = cross3(w, (U[0], U[1], U[2]))
        u1 = cross3(w, (U[3], U[4], U[5]))
        u2 = cross3(w, (U[6], U[7], U[8]))
        met = add9(met, scale9(2.0, (*u0, *u1, *u2)))
        shifted = add3(cross3(c, a), scale3(-1.0, axial(met)))
        torque = add3(scale3(per_x, shifted), axial(compose(G, V)))
        if flex[at.GYROSCOPIC] >= 0:
            slope = momentum_slope(plan.modal, flex, j)
            f0 = sub3(f0, rotate(R, scale3(0.5, slope)))
            torque = add3(torque, add3(scale3(per_v, slope), scale3(per_x, cross3(w, slope))))
        fw = rotate(R, force)
        torque_o = add3(rotate(R, torque), cross3(p, fw))
        k = tree[at.MODAL_V] + j
        for t in range(3):
            tw.projection[t, k] += 2.0 * f0[t]
            tw.projection[3 + t, k] += f1[t]
            tw.projection[6 + t, k] += cw[t]
            tw.wrench[t, k] += fw[t]
            tw.wrench[3 + t, k] += torque_o[t]


@kernel
def _spin_matrix(w, dw):
    """[w]^2 + [dw]: the acceleration of a body's points over their place."""
    ww = dot3(w, w)
    square = outer(w, w)
    return add9(
        (square[0] - ww, square[1], square[2], square[3], square[4] - ww, square[5],
         square[6], square[7], square[8] - ww), skew(dw)
    )  # fmt: skip


@kernel
def _particle_matrix(W, w, per_x, per_v):
    """Acceleration of a particle over its displacement by a mode, but for ``per_a``."""
    return add9(scale9(per_x, W), scale9(2.0 * per_v, skew(w)))


@kernel
def add_modal_block(plan, work, tw, i, q, per_x, per_v, per_a, matrix):
    """Add body i's own modes by its own modes: inertia, stiffness, damping, stretch or polynomial."""
    tree = plan.tree[i]
    flex = plan.flex[tree[at.FLEX]]
    modal = plan.modal
    n = flex[at.N_MODES]
    first = tree[at.MODAL_V]
    body = work.body[i]
    w = load3(body, at.B_W)
    G = _particle_matrix(_spin_matrix(w, load3(body, at.B_DW)), w, per_x, per_v)
    damping = flex[at.MODAL_DAMPING]
    spins = tree[at.ROTATION] != kinds.NONROTATING
    for j in range(n):
        row = matrix[first + j, first : first + n]
        if spins:
            add_pair_products(modal, flex[at.MODAL_MOMENTS], n, j, G, row)
        row[j] += per_a + per_x * modal[flex[at.MODAL_STIFFNESS] + j]
        if damping >= 0:
            rates = modal[damping + n * j : damping + n * (j + 1)]
            for k in range(n):
                row[k] += per_v * rates[k]
    for s in range(flex[at.N_STRETCH]):
        _add_stretch_block(plan, flex, q, s, per_x, first, tw.mode_moments[0], matrix)
    if flex[at.POLYNOMIAL] >= 0:
        add_polynomial_tangent(modal, flex, q, per_x, tw.second, first, matrix)


@kernel
def _add_stretch_block(plan, flex, q, number, per_x, first, slope, matrix):
    """Second derivatives of a membrane strain's ((e + s)^2 - e^2) / 2 with e = c q and s = q^T C q / 2.

    ``slope`` is scratch for C q; of C the lower triangle is stored.
    """
    modal = plan.modal
    n = flex[at.N_MODES]
    c, start, e, s = stretch(plan, flex, q, number)
    pull = per_x * (e + s)
    o = start
    for i in range(n):
        t = modal[o + i] * q[i]
        for j in range(i):
            t += modal[o + j] * q[j]
            slope[j] += modal[o + j] * q[i]
        slope[i] = t
        o += i + 1
    o = start
    for i in range(n):
        # (c + C q) (c + C q)^T without c c^T, which is in K
        along = per_x * slope[i]
        whole = along + per_x * modal[c + i]
        for j in range(i):
            t = pull * modal[o + j] + whole * slope[j] + along * modal[c + j]
            matrix[first + i, first + j] += t
            matrix[first + j, first + i] += t
        matrix[first + i, first + i] += pull * modal[o + i] + whole * slope[i] + along * modal[c + i]
        o += i + 1
