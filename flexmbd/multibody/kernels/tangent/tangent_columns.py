"""Columns of the tangent: how an unknown moves the bodies outboard of it, and the wrench that this requires.

A unit of an unknown displaces everything outboard of it as one rigid body: by the twist xi = (phi, r), a rotation and
the translation of the point o, both of which go with time. Of the bodies outboard it changes the wrench, in their
own axes, by what phi', phi'' and alpha = r'' + phi x g say (d/dt in the world): this is why three vectors a column
serve all bodies.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.jacobian_derivatives import (
    add9,
    left_jacobian_derivatives,
    left_jacobian_torque_derivative,
    scale9,
    skew,
)
from flexmbd.multibody.kernels.algebra.polar_decomposition import (
    face_matrix,
    polar_column,
    polar_derivatives,
    polar_torque_derivative,
)
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import face_of, frame_motion
from flexmbd.multibody.kernels.physics.face_modes import add_face_forces, strain_of, strain_sum
from flexmbd.multibody.kernels.physics.frame_modes import modal_sum
from flexmbd.multibody.kernels.physics.joints import joint_column
from flexmbd.multibody.kernels.tangent import tangent_layout as tl

_ZERO = (0.0, 0.0, 0.0)

@kernel
def composite_change(row, turn, turn2, alpha):
    """Change of the wrench (force, torque about o) that a composite body requires.

    Particles accelerate by alpha + phi'' x r + 2 phi' x r'.
    """
    h = load3(row, tl.C_FIRST)
    force = add3(
        add3(scale3(row[tl.C_MASS], alpha), cross3(turn2, h)),
        scale3(2.0, cross3(turn, load3(row, tl.C_MOMENTUM))),
    )
    o = tl.C_SECOND
    xx, xy, xz, yy, yz, zz = row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5]
    turned = (
        (yy + zz) * turn2[0] - xy * turn2[1] - xz * turn2[2],
        -xy * turn2[0] + (xx + zz) * turn2[1] - yz * turn2[2],
        -xz * turn2[0] - yz * turn2[1] + (xx + yy) * turn2[2],
    )
    N = load9(row, tl.C_FLOW)
    swept = sub3(scale3(N[0] + N[4] + N[8], turn), rotate_back(N, turn))
    return force, add3(add3(cross3(h, alpha), turned), scale3(2.0, swept))


@kernel
def composite_projection(row, angular, linear):
    """Projection of phi', phi'' and alpha on a row with this twist: `composite_change` transposed."""
    h = load3(row, tl.C_FIRST)
    N = load9(row, tl.C_FLOW)
    o = tl.C_SECOND
    xx, xy, xz, yy, yz, zz = row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5]
    turned = (
        (yy + zz) * angular[0] - xy * angular[1] - xz * angular[2],
        -xy * angular[0] + (xx + zz) * angular[1] - yz * angular[2],
        -xz * angular[0] - yz * angular[1] + (xx + yy) * angular[2],
    )
    swept = sub3(scale3(N[0] + N[4] + N[8], angular), rotate(N, angular))
    turn = scale3(2.0, add3(cross3(load3(row, tl.C_MOMENTUM), linear), swept))
    turn2 = add3(cross3(h, linear), turned)
    return turn, turn2, add3(scale3(row[tl.C_MASS], linear), cross3(angular, h))


@kernel
def store_column(target, o, k, v):
    """Rows o to o + 2 of column k of ``target``."""
    target[o, k] = v[0]
    target[o + 1, k] = v[1]
    target[o + 2, k] = v[2]


@kernel
def _add(target, o, k, v):
    target[o, k] += v[0]
    target[o + 1, k] += v[1]
    target[o + 2, k] += v[2]


@kernel
def _add_column(wrench, projection, row, k, per_x, angular, linear, turn, turn2, alpha):
    """Add to wrench and projection of column k those of a twist of the composite body in ``row``."""
    force, torque = composite_change(row, turn, turn2, alpha)
    phi, r = scale3(per_x, angular), scale3(per_x, linear)
    F, T = load3(row, tl.C_FORCE), load3(row, tl.C_TORQUE)
    # the wrench itself turns with what it acts on
    force = add3(force, cross3(phi, F))
    torque = add3(torque, add3(cross3(phi, T), cross3(r, F)))
    _add(wrench, 0, k, force)
    _add(wrench, 3, k, torque)
    f0, f1, f2 = composite_projection(row, angular, linear)
    _add(projection, 0, k, f0)
    _add(projection, 3, k, f1)
    _add(projection, 6, k, f2)
    return force, torque


@kernel
def _joint_column(tw, i, k, weights, F, G, angular, linear):
    """One unknown of body i's joint: turns about ``angular`` through G, slides along ``linear``."""
    per_x, per_v, per_a = weights
    w_F, dw_F = F
    c, v, a, w_G = G
    phi = scale3(per_x, angular)
    spun = cross3(w_F, angular)
    turn = add3(scale3(per_x, spun), scale3(per_v, angular))
    turn2 = add3(
        add3(scale3(per_x, add3(cross3(dw_F, angular), cross3(w_F, spun))), scale3(per_a, angular)),
        scale3(per_v, add3(spun, cross3(w_G, angular))),
    )
    slid = cross3(w_F, linear)
    rate = add3(scale3(per_x, slid), scale3(per_v, linear))
    rate2 = add3(
        add3(scale3(per_x, add3(cross3(dw_F, linear), cross3(w_F, slid))), scale3(per_a, linear)),
        scale3(2.0 * per_v, slid),
    )
    rate = add3(rate, add3(cross3(v, phi), cross3(c, turn)))
    alpha = add3(add3(rate2, cross3(a, phi)), add3(scale3(2.0, cross3(v, turn)), cross3(c, turn2)))
    at_o = add3(linear, cross3(c, angular))
    store_column(tw.twist, 0, k, angular)
    store_column(tw.twist, 3, k, at_o)
    store_column(tw.motion, 0, k, turn)
    store_column(tw.motion, 3, k, turn2)
    store_column(tw.motion, 6, k, alpha)
    store_column(tw.motion, 9, k, rate)
    _add_column(tw.wrench, tw.projection, tw.body[i], k, per_x, angular, at_o, turn, turn2, alpha)


@kernel
def joint_columns(plan, work, tw, i, per_x, per_v, per_a):
    """Write the columns of body i's inboard joint; its composite must be complete."""
    tree = plan.tree[i]
    size = tree[at.JOINT_SIZE]
    if size == 0:
        return
    _, R_F, _, w_F, _, dw_F = frame_motion(plan, work, tree[at.FRAME_PARENT])
    F = (rotate(R_F, w_F), rotate(R_F, dw_F))
    body = work.body[i]
    R = load9(body, at.B_R)
    child = plan.frames[tree[at.FRAME_CHILD]]
    p = load3(child, at.FRAME_P)
    w = load3(body, at.B_W)
    wp = cross3(w, p)
    a = add3(load3(body, at.B_A), add3(cross3(load3(body, at.B_DW), p), cross3(w, wp)))
    c = sub3(add3(load3(body, at.B_P), rotate(R, p)), load3(tw.origin, 0))
    v = sub3(rotate(R, add3(load3(body, at.B_V), wp)), load3(tw.origin, 3))
    G = (c, v, rotate(R, a), rotate(R, w))
    R_G = compose(R, load9(child, at.FRAME_R))
    weights = (per_x, per_v, per_a)
    o = tree[at.JOINT_V]
    for k in range(size):
        angular, linear = joint_column(tree[at.JOINT_ADDS], plan.data, tree[at.JOINT_DATA], k)
        _joint_column(tw, i, o + k, weights, F, G, rotate(R_G, angular), rotate(R_F, linear))


@kernel
def _modes3(modal, o, n, k):
    return (modal[o + k], modal[o + n + k], modal[o + 2 * n + k])


@kernel
def _add_frame_block(plan, tw, f, first, n, matrix):
    """Add the modes' rows of the columns in ``tw.mode_moments``: forces, moments, and the rotation of the rows."""
    modal = plan.modal
    o = plan.frame_of[f, at.FRAME_MODES]
    edge = tw.edge_of[f]
    for j in range(n):
        s = _modes3(modal, o + 3 * n, n, j)
        axis, lever = load_column(tw.edge_twist, edge + j)
        row = matrix[first + j, first : first + n]
        add_products(lever, axis, tw.mode_moments, 0, row)
        add_product(s, tw.mode_moments, 6, 0, row)


@deferred_kernel()
def frame_columns(plan, work, tw, f, row, x, v, a, per_x, per_v, per_a, matrix):
    """Columns of a body's modes as far as they move its frame f with what ``row`` sums up there.

    Adds to the modes' wrenches and feelings, and to the block of the body's own modes; overwrites ``tw.mode_moments``.
    """
    if plan.frame_of[f, at.FRAME_STRAIN] >= 0:
        face_columns(plan, work, tw, f, row, v, a, per_x, per_v, per_a, matrix)
        return
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    o = plan.frame_of[f, at.FRAME_MODES]
    modal = plan.modal
    first, qx, edge = tree[at.MODAL_V], tree[at.MODAL_X], tw.edge_of[f]
    _, theta = modal_sum(modal, o, n, x[qx : qx + n])
    _, theta1 = modal_sum(modal, o, n, v[first : first + n])
    _, theta2 = modal_sum(modal, o, n, a[first : first + n])
    body = work.body[plan.frame_of[f, at.FRAME_BODY]]
    R = load9(body, at.B_R)
    wx = skew(load3(body, at.B_W))
    bend = add9(compose(wx, wx), skew(load3(body, at.B_DW)))
    p_F, R_F, v_F, _, a_F, _ = frame_motion(plan, work, f)
    c = sub3(p_F, load3(tw.origin, 0))
    v_F = sub3(rotate(R_F, v_F), load3(tw.origin, 3))
    a_F = rotate(R_F, a_F)
    J, J1, J2 = left_jacobian_derivatives(theta, theta1, theta2)
    # from the modes' rotations to phi, phi', phi'', and from their translations to r', r''
    wJ1 = add9(compose(wx, J), J1)
    M0 = compose(R, J)
    M1 = compose(R, add9(scale9(per_x, wJ1), scale9(per_v, J)))
    M2 = compose(
        R,
        add9(
            add9(
                scale9(per_x, add9(compose(bend, J), add9(scale9(2.0, compose(wx, J1)), J2))),
                scale9(2.0 * per_v, wJ1),
            ),
            scale9(per_a, J),
        ),
    )
    unit = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    T1 = compose(R, add9(scale9(per_x, wx), scale9(per_v, unit)))
    T2 = compose(R, add9(add9(scale9(per_x, bend), scale9(2.0 * per_v, wx)), scale9(per_a, unit)))
    force, torque = load3(row, tl.C_FORCE), load3(row, tl.C_TORQUE)
    Q = left_jacobian_torque_derivative(theta, rotate_back(R, sub3(torque, cross3(c, force))))
    for k in range(n):
        s, t = _modes3(modal, o + 3 * n, n, k), _modes3(modal, o, n, k)
        angular = rotate(M0, s)
        shift = rotate(R, t)
        at_o = add3(shift, cross3(c, angular))
        turn, turn2 = rotate(M1, s), rotate(M2, s)
        phi = scale3(per_x, angular)
        rate = add3(rotate(T1, t), add3(cross3(v_F, phi), cross3(c, turn)))
        alpha = add3(
            add3(rotate(T2, t), cross3(a_F, phi)),
            add3(scale3(2.0, cross3(v_F, turn)), cross3(c, turn2)),
        )
        _put_edge(tw, row, edge, first, k, per_x, angular, at_o, turn, turn2, alpha, rate, shift)
        store_column(tw.mode_moments, 6, k, scale3(per_x, rotate_back(Q, s)))
    _add_frame_block(plan, tw, f, first, n, matrix)


@kernel
def _put_edge(tw, row, edge, first, k, per_x, angular, at_o, turn, turn2, alpha, rate, shift):
    """Store the column of mode k at a frame, and what the wrench in ``row`` changes of the modes' own share."""
    store_column(tw.edge_twist, 0, edge + k, angular)
    store_column(tw.edge_twist, 3, edge + k, at_o)
    store_column(tw.edge_motion, 0, edge + k, turn)
    store_column(tw.edge_motion, 3, edge + k, turn2)
    store_column(tw.edge_motion, 6, edge + k, alpha)
    store_column(tw.edge_motion, 9, edge + k, rate)
    change, moment = _add_column(tw.wrench, tw.projection, row, first + k, per_x, angular, at_o, turn, turn2, alpha)
    # the lever and the axes of the modes' own share go with the frame
    moment = add3(moment, scale3(per_x, cross3(load3(row, tl.C_FORCE), shift)))
    store_column(tw.mode_moments, 0, k, change)
    store_column(tw.mode_moments, 3, k, moment)


@deferred_kernel()
def face_columns(plan, work, tw, f, row, v, a, per_x, per_v, per_a, matrix):
    """`frame_columns` of a frame that its face turns; ``work`` holds the motion."""
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    o, s = plan.frame_of[f, at.FRAME_MODES], plan.frame_of[f, at.FRAME_STRAIN]
    modal, first, edge, own = plan.modal, tree[at.MODAL_V], tw.edge_of[f], work.frame[f]
    body = work.body[plan.frame_of[f, at.FRAME_BODY]]
    R_WB, w, dw = load9(body, at.B_R), load3(body, at.B_W), load3(body, at.B_DW)
    p_F, R_F, v_F, _, a_F, _ = frame_motion(plan, work, f)
    c = sub3(p_F, load3(tw.origin, 0))
    v_F = sub3(rotate(R_F, v_F), load3(tw.origin, 3))
    a_F = rotate(R_F, a_F)
    F, R, solver = face_of(plan, work, f)
    qd, qdd = v[first : first + n], a[first : first + n]
    rate_F = face_matrix(modal_sum(modal, o, n, qd)[1], strain_sum(modal, s, n, qd))
    rate2_F = face_matrix(modal_sum(modal, o, n, qdd)[1], strain_sum(modal, s, n, qdd))
    derivatives = polar_derivatives(F, R, rate_F, rate2_F, load3(own, at.F_W), load3(own, at.F_DW))
    torque = rotate_back(R_WB, sub3(load3(row, tl.C_TORQUE), cross3(c, load3(row, tl.C_FORCE))))
    for k in range(n):
        t = _modes3(modal, o, n, k)
        X = face_matrix(_modes3(modal, o + 3 * n, n, k), strain_of(modal, s, n, k))
        phi, phi1, phi2 = polar_column(solver, derivatives, X)
        # a vector of the body's axes, and what it becomes in time: its rate is that in the body and w x it
        turn, turn2 = _in_time(w, dw, phi, phi1, phi2, per_x, per_v, per_a)
        move, move2 = _in_time(w, dw, t, _ZERO, _ZERO, per_x, per_v, per_a)
        angular, shift, turn, turn2 = rotate(R_WB, phi), rotate(R_WB, t), rotate(R_WB, turn), rotate(R_WB, turn2)
        at_o = add3(shift, cross3(c, angular))
        turned = scale3(per_x, angular)
        rate = add3(rotate(R_WB, move), add3(cross3(v_F, turned), cross3(c, turn)))
        alpha = add3(
            add3(rotate(R_WB, move2), cross3(a_F, turned)),
            add3(scale3(2.0, cross3(v_F, turn)), cross3(c, turn2)),
        )
        _put_edge(tw, row, edge, first, k, per_x, angular, at_o, turn, turn2, alpha, rate, shift)
        store_column(tw.mode_moments, 6, k, _ZERO)
        bend = polar_torque_derivative(solver, F, R, torque, X, phi)
        add_face_forces(modal, o, n, per_x, bend, matrix[first + k, first : first + n])
    _add_frame_block(plan, tw, f, first, n, matrix)


@kernel
def _in_time(w, dw, u, u1, u2, per_x, per_v, per_a):
    """Changes of the rates of z u, in B's axes, where z, z', z'' change by per_x, per_v, per_a; u', u'' in B."""
    spun = add3(cross3(w, u), u1)
    spun2 = add3(add3(cross3(dw, u), cross3(w, cross3(w, u))), add3(scale3(2.0, cross3(w, u1)), u2))
    rate = add3(scale3(per_x, spun), scale3(per_v, u))
    rate2 = add3(add3(scale3(per_x, spun2), scale3(2.0 * per_v, spun)), scale3(per_a, u))
    return rate, rate2


@kernel
def load_column(m, k):
    """The two vectors in rows 0 to 5 of column k."""
    return (m[0, k], m[1, k], m[2, k]), (m[3, k], m[4, k], m[5, k])


@summing_kernel
def add_product(a, m, o, k, row):
    """row += a . (rows o to o + 2 of m, from column k)."""
    # indices from a range need no look whether they count from the end, which would hold up the vector registers
    n = row.shape[0]
    m0, m1, m2 = m[o, k : k + n], m[o + 1, k : k + n], m[o + 2, k : k + n]
    for j in range(n):
        row[j] += a[0] * m0[j] + a[1] * m1[j] + a[2] * m2[j]


@summing_kernel
def add_motion_products(projection, r, m, k, row):
    """row += (column r of the nine rows of ``projection``) . (rows 0 to 8 of m), from column k."""
    n = row.shape[0]
    m0, m1, m2 = m[0, k : k + n], m[1, k : k + n], m[2, k : k + n]
    m3, m4, m5 = m[3, k : k + n], m[4, k : k + n], m[5, k : k + n]
    m6, m7, m8 = m[6, k : k + n], m[7, k : k + n], m[8, k : k + n]
    p0, p1, p2 = projection[0, r], projection[1, r], projection[2, r]
    p3, p4, p5 = projection[3, r], projection[4, r], projection[5, r]
    p6, p7, p8 = projection[6, r], projection[7, r], projection[8, r]
    for j in range(n):
        turn = p0 * m0[j] + p1 * m1[j] + p2 * m2[j]
        turn2 = p3 * m3[j] + p4 * m4[j] + p5 * m5[j]
        row[j] += turn + turn2 + (p6 * m6[j] + p7 * m7[j] + p8 * m8[j])


@summing_kernel
def add_products(a, b, m, k, row):
    """row += a . (rows 0 to 2 of m) + b . (rows 3 to 5), from column k."""
    n = row.shape[0]
    m0, m1, m2 = m[0, k : k + n], m[1, k : k + n], m[2, k : k + n]
    m3, m4, m5 = m[3, k : k + n], m[4, k : k + n], m[5, k : k + n]
    for j in range(n):
        row[j] += a[0] * m0[j] + a[1] * m1[j] + a[2] * m2[j] + b[0] * m3[j] + b[1] * m4[j] + b[2] * m5[j]
