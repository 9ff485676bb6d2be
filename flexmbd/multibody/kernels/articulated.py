"""Forward dynamics in O(bodies): the articulated-body recursion through rigid and flexible bodies.

Outwards go velocities and what needs no acceleration; inwards each body's inertia and asked
wrench, of which a joint passes on what does not move it; outwards again the accelerations
(theory: Featherstone 2008, section 7.3; flexible bodies: ``articulated_flexible``).  Accelerations
are those of material points, so that no term holds the linear velocity; gravity is an acceleration
of the ground.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels import articulated_layout as to
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.articulated_flexible import (
    accelerate_modes,
    deform_interface,
    eliminate_modes,
    modal_wrench,
    prepare_body,
)
from flexmbd.multibody.kernels.closure import load_constraints, load_couplings
from flexmbd.multibody.kernels.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.elements import load_elements, push_coordinates
from flexmbd.multibody.kernels.joints import joint_motion, joint_pose
from flexmbd.multibody.kernels.recursion import forward
from flexmbd.multibody.kernels.so3 import (
    add3,
    compose,
    cross3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    store9,
    sub3,
)
from flexmbd.multibody.kernels.spatial import (
    add6,
    add9,
    load6,
    rotate_block,
    rotate_symmetric,
    shift_block,
    shift_symmetric,
    shift_torque,
    skew,
    store6,
    symmetric_times,
    turn,
    turn_block,
    turn_symmetric,
)


@kernel
def forward_dynamics(plan, work, aw, x, v, a, multipliers, extra):
    """Write the accelerations ``a`` (nv,) of the tree at (x, v): (M + diag(extra)) a = applied - bias - C^T nu.

    ``work.time`` must be up to date; prescribed coordinates must stand in x and v (``residual.drive``),
    their accelerations are taken from there.  Leaves the factors for ``solve_mass``.

    Args:
        plan: the scene.
        work: its scratch space, with the functions of time.
        aw: ``new_articulated_work(plan)``.
        x: (nx,) configuration.
        v: (nv,) velocity.
        a: (nv,) output.
        multipliers: (m,) of the loops' rows (N or N m).
        extra: (nv,) added to the mass matrix's diagonal, or (0,) for nothing.
    """
    asked = aw.asked
    for k in range(asked.shape[0]):
        asked[k] = 0.0
    for i in range(plan.driven.shape[0]):
        a[plan.driven[i, at.DRIVEN_V]] = work.time[plan.driven[i, at.DRIVEN_TIME], 2]
    loaded = _ask_loads(plan, work, aw, x, v, multipliers)
    _factor(plan, work, aw, x, v, a, extra, loaded)
    g = load3(plan.gravity, 0)
    _accelerate(plan, aw, scale3(-1.0, g), True, a)


@kernel
def _ask_loads(plan, work, aw, x, v, multipliers):
    """Add to ``aw.asked`` and, if it returns true, write to the bodies' wrenches what joints, elements and loops ask.

    Only wrenches between frames need poses in the world.
    """
    asked = aw.asked
    loaded = plan.rows.shape[0] > 0
    for i in range(plan.elements.shape[0]):
        loaded = loaded or plan.elements[i, at.EL_KIND] >= at.BETWEEN_SPRING
    if loaded:
        forward(plan, work, x, v, aw.rest)
        for i in range(plan.tree.shape[0]):
            for k in range(at.B_F, at.B_T + 3):
                work.body[i, k] = 0.0
        load_constraints(plan, work, multipliers, asked)
        load_elements(plan, work, asked)
        load_couplings(plan, multipliers, asked)
    if plan.elements.shape[0] > 0:
        push_coordinates(plan, work, x, v, asked)
    for i in range(plan.forces.shape[0]):
        asked[plan.forces[i, at.FORCE_V]] -= work.time[plan.forces[i, at.FORCE_TIME], 0]
    return loaded


@kernel
def articulate(plan, work, aw, x, extra):
    """Factor M(x) + diag(extra) for ``solve_mass``; arguments as for ``forward_dynamics``."""
    for k in range(aw.asked.shape[0]):
        aw.asked[k] = 0.0
    _factor(plan, work, aw, x, aw.rest, aw.rest, extra, False)


@kernel
def solve_mass(plan, work, aw, rhs, out):
    """Write M^-1 times each row of ``rhs`` (k, nv) into ``out`` (k, nv), with the factors at hand.

    Prescribed coordinates stay: their entries of ``rhs`` play no part and those of ``out`` are zero.
    """
    for k in range(rhs.shape[0]):
        for i in range(plan.driven.shape[0]):
            out[k, plan.driven[i, at.DRIVEN_V]] = 0.0
        _gather(plan, aw, rhs[k])
        _accelerate(plan, aw, (0.0, 0.0, 0.0), False, out[k])


@kernel
def _factor(plan, work, aw, x, v, a, extra, loaded):
    """Outwards with velocities, inwards with inertia and wrenches."""
    _move(plan, aw, x, v, a, extra)
    _articulate_bodies(plan, work, aw, extra, loaded)


@part_of_kernel
def _move(plan, aw, x, v, a, extra):  # noqa: PLR0915  one pass
    """Velocities and bias accelerations of all bodies, outwards."""
    w = (0.0, 0.0, 0.0)
    for i in range(aw.link.shape[0]):
        link = aw.link[i]
        constant = aw.constant[i]
        row = aw.row[i]
        parent = link[to.PARENT]
        if parent < 0:
            w = (0.0, 0.0, 0.0)
        elif parent != i - 1:
            w = load3(aw.row[parent], to.R_SPIN)
        position = rate = rate2 = 0.0
        if link[to.FORM] != to.SEVERAL and link[to.KIND] != at.FIXED:
            position = x[link[to.JOINT_X]]
            rate = v[link[to.JOINT_V]]
            if link[to.FREEDOMS] == 0:
                rate2 = a[link[to.JOINT_V]]
        slide = constant[to.C_SHIFT]
        spin = constant[to.C_TURN]
        c = 1.0
        s = 0.0
        if spin != 0.0:
            c = math.cos(spin * position)
            s = math.sin(spin * position)
        p_dot = (0.0, 0.0, slide * rate)
        relative = (0.0, 0.0, spin * rate)
        r = load3(constant, to.C_P)
        if link[to.FORM] == to.ALIGNED:
            r = (r[0], r[1], r[2] + slide * position)
            bias = turn(c, -s, cross3(w, add3(cross3(w, r), scale3(2.0, p_dot))))
            w = turn(c, -s, w)
            if slide != 0.0:
                store3(aw.pose[i], to.P_P, r)
        else:
            R = load9(constant, to.C_R)
            slot = link[to.INTERFACE]
            if slot >= 0:
                w = deform_interface(plan, aw, slot, x, v, w)
                R = load9(aw.interface[slot], to.I_R)
                r = (0.0, 0.0, 0.0)
            p = (0.0, 0.0, slide * position)
            R_FG = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
            if link[to.FORM] == to.SEVERAL:
                p, R_FG = joint_pose(link[to.KIND], 0.0, x, link[to.JOINT_X])
                p_dot, relative = joint_motion(link[to.KIND], 0.0, v, link[to.JOINT_V])
                _set_subspace(aw.subspace[link[to.MULTI], 0], link[to.FREEDOMS], R_FG)
            R_AG = compose(R, R_FG)
            r = add3(r, rotate(R, p))
            bias = rotate_back(R_AG, cross3(w, add3(cross3(w, r), scale3(2.0, rotate(R, p_dot)))))
            w = rotate_back(R_AG, w)
            store9(aw.pose[i], to.P_R, R_AG)
            store3(aw.pose[i], to.P_P, r)
        turning = add3(cross3(w, relative), (0.0, 0.0, spin * rate2))
        w = add3(w, relative)
        row[to.R_COS] = c
        row[to.R_SIN] = s
        store3(row, to.R_BIAS_ANGULAR, turning)
        store3(row, to.R_BIAS_LINEAR, (bias[0], bias[1], bias[2] + slide * rate2))
        if link[to.FLEX] >= 0:
            w = rotate(load9(constant, to.C_OWN_R), w)
            own = load3(constant, to.C_OWN_P)
            store3(aw.pose[i], to.P_BIAS, scale3(-1.0, cross3(w, cross3(w, own))))
            prepare_body(plan, aw, link[to.FLEX], x, v, w, extra)
        store3(row, to.R_SPIN, w)
        for k in range(to.N_GATHERED):
            aw.gathered[i, k] = 0.0


@kernel
def _set_subspace(S, freedoms, R_FG):
    """Motion of G (angular, linear; G's axes) per unit of each velocity of a joint of several."""
    for i in range(6):
        for j in range(6):
            S[i, j] = 0.0
    o = freedoms - 3
    for i in range(3):
        S[i, o + i] = 1.0
        if freedoms == 6:
            for j in range(3):
                S[3 + i, j] = R_FG[3 * j + i]


@part_of_kernel
def _articulate_bodies(plan, work, aw, extra, loaded):  # noqa: PLR0915  one pass
    """Articulated inertia and asked wrench of all bodies, inwards."""
    for i in range(aw.link.shape[0] - 1, -1, -1):
        link = aw.link[i]
        constant = aw.constant[i]
        row = aw.row[i]
        gathered = aw.gathered[i]
        w = load3(row, to.R_SPIN)
        a = load6(gathered, to.G_A)
        b = load9(gathered, to.G_B)
        m = load6(gathered, to.G_M)
        torque = load3(gathered, to.G_TORQUE)
        force = load3(gathered, to.G_FORCE)
        own_p = load3(constant, to.C_OWN_P)
        own_R = load9(constant, to.C_OWN_R)
        asked_force = (0.0, 0.0, 0.0)
        asked_torque = (0.0, 0.0, 0.0)
        if loaded:
            asked_force = load3(work.body[i], at.B_F)
            asked_torque = load3(work.body[i], at.B_T)
        if link[to.FLEX] < 0:
            mass = constant[to.C_MASS]
            first = load3(constant, to.C_FIRST)
            inertia = load6(constant, to.C_INERTIA)
            torque = add3(torque, cross3(w, symmetric_times(inertia, w)))
            force = add3(force, cross3(w, cross3(w, first)))
            a = add6(a, inertia)
            b = add9(b, skew(first))
            m = (m[0] + mass, m[1], m[2], m[3] + mass, m[4], m[5] + mass)
            if loaded:
                force = add3(force, rotate_back(own_R, asked_force))
                torque = add3(torque, rotate_back(own_R, sub3(asked_torque, cross3(own_p, asked_force))))
        else:
            k = link[to.FLEX]
            body_a, body_b, body_m = eliminate_modes(plan, aw, k)
            modal_torque, modal_force = modal_wrench(plan, aw, k, True)
            a = add6(a, body_a)
            b = add9(b, body_b)
            m = add6(m, body_m)
            bias = load3(aw.pose[i], to.P_BIAS)
            torque = add3(torque, add3(modal_torque, add3(load3(aw.body[k], to.B_TORQUE), rotate(b, bias))))
            force = add3(force, add3(modal_force, add3(load3(aw.body[k], to.B_FORCE), symmetric_times(m, bias))))
            force = add3(force, asked_force)
            torque = add3(torque, asked_torque)
            # from B to G
            p = scale3(-1.0, own_p)
            shifted = shift_block(p, b, m)
            back = _transpose(own_R)
            a = rotate_symmetric(back, shift_symmetric(p, a, b, shifted))
            b = rotate_block(back, shifted)
            m = rotate_symmetric(back, m)
            torque = rotate(back, shift_torque(p, torque, force))
            force = rotate(back, force)
        if link[to.PARENT] < 0 and link[to.FREEDOMS] == 0:
            continue
        angular = load3(row, to.R_BIAS_ANGULAR)
        linear = load3(row, to.R_BIAS_LINEAR)
        if link[to.FORM] == to.SEVERAL:
            a, b, m, torque, force = _yield_several(aw, link, a, b, m, torque, force, angular, linear, extra)
        else:
            spin = constant[to.C_TURN]
            slide = constant[to.C_SHIFT]
            u = (
                spin * a[2] + slide * b[2],
                spin * a[4] + slide * b[5],
                spin * a[5] + slide * b[8],
                spin * b[6] + slide * m[2],
                spin * b[7] + slide * m[4],
                spin * b[8] + slide * m[5],
            )
            d = 0.0
            left = 0.0
            if link[to.FREEDOMS] > 0:
                d = spin * u[2] + slide * u[5]
                if extra.shape[0] > 0:
                    d += extra[link[to.JOINT_V]]
                d = 1.0 / d
                left = -aw.asked[link[to.JOINT_V]] - spin * torque[2] - slide * force[2]
            store6(row, to.R_U, u)
            row[to.R_D] = d
            row[to.R_FORCE] = left
            e = (d * u[0], d * u[1], d * u[2], d * u[3], d * u[4], d * u[5])
            a, b, m = _subtract(a, b, m, u, e)
            torque = add3(torque, scale3(left, (e[0], e[1], e[2])))
            force = add3(force, scale3(left, (e[3], e[4], e[5])))
            torque = add3(torque, add3(symmetric_times(a, angular), rotate(b, linear)))
            force = add3(force, add3(rotate_back(b, angular), symmetric_times(m, linear)))
        if link[to.PARENT] < 0:
            continue
        if link[to.FORM] == to.ALIGNED:
            c = row[to.R_COS]
            s = row[to.R_SIN]
            r = load3(constant, to.C_P)
            if constant[to.C_SHIFT] != 0.0:
                r = load3(aw.pose[i], to.P_P)
            a = turn_symmetric(c, s, a)
            b = turn_block(c, s, b)
            m = turn_symmetric(c, s, m)
            torque = turn(c, s, torque)
            force = turn(c, s, force)
        else:
            R_AG = load9(aw.pose[i], to.P_R)
            r = load3(aw.pose[i], to.P_P)
            a = rotate_symmetric(R_AG, a)
            b = rotate_block(R_AG, b)
            m = rotate_symmetric(R_AG, m)
            torque = rotate(R_AG, torque)
            force = rotate(R_AG, force)
        shifted = shift_block(r, b, m)
        a = shift_symmetric(r, a, b, shifted)
        torque = shift_torque(r, torque, force)
        if link[to.INTERFACE] >= 0:
            target = aw.interface[link[to.INTERFACE]]
            store6(target, to.I_A, a)
            store9(target, to.I_B, shifted)
            store6(target, to.I_M, m)
            store3(target, to.I_TORQUE, torque)
            store3(target, to.I_FORCE, force)
        else:
            target = aw.gathered[link[to.PARENT]]
            store6(target, to.G_A, add6(load6(target, to.G_A), a))
            store9(target, to.G_B, add9(load9(target, to.G_B), shifted))
            store6(target, to.G_M, add6(load6(target, to.G_M), m))
            store3(target, to.G_TORQUE, add3(load3(target, to.G_TORQUE), torque))
            store3(target, to.G_FORCE, add3(load3(target, to.G_FORCE), force))


@kernel
def _transpose(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def _subtract(a, b, m, u, e):
    """Blocks of the inertia less u e^T."""
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


@kernel
def _yield_several(aw, link, a, b, m, torque, force, angular, linear, extra):
    """Eliminate a joint of several coordinates: what it passes on of inertia and asked wrench.

    D = S^T I S + extra = L L^T; Q = L^-1 S^T I takes the place of U^T.
    """
    S, Q, D = aw.subspace[link[to.MULTI], 0], aw.subspace[link[to.MULTI], 1], aw.subspace[link[to.MULTI], 2]
    left = aw.force[link[to.MULTI]]
    n = link[to.FREEDOMS]
    o = link[to.JOINT_V]
    for j in range(n):
        sw = (S[0, j], S[1, j], S[2, j])
        sv = (S[3, j], S[4, j], S[5, j])
        un = add3(symmetric_times(a, sw), rotate(b, sv))
        uf = add3(rotate_back(b, sw), symmetric_times(m, sv))
        store3(Q[j], 0, un)
        store3(Q[j], 3, uf)
        left[j] = -aw.asked[o + j]
        for i in range(3):
            left[j] -= S[i, j] * torque[i] + S[3 + i, j] * force[i]
    for j in range(n):
        for k in range(j + 1):
            t = 0.0
            for i in range(6):
                t += S[i, j] * Q[k, i]
            D[j, k] = t
        if extra.shape[0] > 0:
            D[j, j] += extra[o + j]
    for j in range(n):
        for k in range(j + 1):
            t = D[j, k]
            for i in range(k):
                t -= D[j, i] * D[k, i]
            D[j, k] = math.sqrt(t) if j == k else t / D[k, k]
        for i in range(6):
            t = Q[j, i]
            for k in range(j):
                t -= D[j, k] * Q[k, i]
            Q[j, i] = t / D[j, j]
        t = left[j]
        for k in range(j):
            t -= D[j, k] * left[k]
        left[j] = t / D[j, j]
        q = load6(Q[j], 0)
        a, b, m = _subtract(a, b, m, q, q)
        torque = add3(torque, scale3(left[j], (q[0], q[1], q[2])))
        force = add3(force, scale3(left[j], (q[3], q[4], q[5])))
    torque = add3(torque, add3(symmetric_times(a, angular), rotate(b, linear)))
    force = add3(force, add3(rotate_back(b, angular), symmetric_times(m, linear)))
    return a, b, m, torque, force


@part_of_kernel
def _gather(plan, aw, rhs):
    """Wrenches that the forces ``rhs`` (nv,) leave to the parents, inwards."""
    for i in range(aw.link.shape[0]):
        for k in range(to.G_TORQUE, to.N_GATHERED):
            aw.gathered[i, k] = 0.0
    for i in range(aw.link.shape[0] - 1, -1, -1):
        link = aw.link[i]
        constant = aw.constant[i]
        row = aw.row[i]
        torque = load3(aw.gathered[i], to.G_TORQUE)
        force = load3(aw.gathered[i], to.G_FORCE)
        if link[to.FLEX] >= 0:
            k = link[to.FLEX]
            o = plan.tree[i, at.MODAL_V]
            for j in range(aw.flex[k, to.F_MODES]):
                aw.bias[k, j] = -rhs[o + j]
            modal_torque, modal_force = modal_wrench(plan, aw, k, False)
            own_R = load9(constant, to.C_OWN_R)
            torque = add3(torque, modal_torque)
            force = add3(force, modal_force)
            torque = rotate_back(own_R, shift_torque(scale3(-1.0, load3(constant, to.C_OWN_P)), torque, force))
            force = rotate_back(own_R, force)
        if link[to.FREEDOMS] > 0:
            o = link[to.JOINT_V]
            if link[to.FORM] == to.SEVERAL:
                torque, force = _pass_several(aw, link, rhs, torque, force)
            else:
                u = rhs[o] - constant[to.C_TURN] * torque[2] - constant[to.C_SHIFT] * force[2]
                row[to.R_FORCE] = u
                u *= row[to.R_D]
                torque = add3(torque, scale3(u, load3(row, to.R_U)))
                force = add3(force, scale3(u, load3(row, to.R_U + 3)))
        if link[to.PARENT] < 0:
            continue
        if link[to.FORM] == to.ALIGNED:
            r = load3(constant, to.C_P)
            if constant[to.C_SHIFT] != 0.0:
                r = load3(aw.pose[i], to.P_P)
            torque = turn(row[to.R_COS], row[to.R_SIN], torque)
            force = turn(row[to.R_COS], row[to.R_SIN], force)
        else:
            R_AG = load9(aw.pose[i], to.P_R)
            r = load3(aw.pose[i], to.P_P)
            torque = rotate(R_AG, torque)
            force = rotate(R_AG, force)
        torque = shift_torque(r, torque, force)
        if link[to.INTERFACE] >= 0:
            target = aw.interface[link[to.INTERFACE]]
            store3(target, to.I_TORQUE, torque)
            store3(target, to.I_FORCE, force)
        else:
            target = aw.gathered[link[to.PARENT]]
            store3(target, to.G_TORQUE, add3(load3(target, to.G_TORQUE), torque))
            store3(target, to.G_FORCE, add3(load3(target, to.G_FORCE), force))


@kernel
def _pass_several(aw, link, rhs, torque, force):
    """What a joint of several coordinates passes on of a wrench while ``rhs`` moves it."""
    S, Q, D = aw.subspace[link[to.MULTI], 0], aw.subspace[link[to.MULTI], 1], aw.subspace[link[to.MULTI], 2]
    left = aw.force[link[to.MULTI]]
    for j in range(link[to.FREEDOMS]):
        t = rhs[link[to.JOINT_V] + j]
        for i in range(3):
            t -= S[i, j] * torque[i] + S[3 + i, j] * force[i]
        left[j] = t
    for j in range(link[to.FREEDOMS]):
        t = left[j]
        for k in range(j):
            t -= D[j, k] * left[k]
        left[j] = t / D[j, j]
        torque = add3(torque, scale3(left[j], load3(Q[j], 0)))
        force = add3(force, scale3(left[j], load3(Q[j], 3)))
    return torque, force


@part_of_kernel
def _accelerate(plan, aw, start, biased, out):
    """Accelerations of all bodies, outwards from the ground's (``start``); ``out`` (nv,) gets the coordinates'.

    ``biased``: with the bias accelerations of forward dynamics.
    """
    dw = (0.0, 0.0, 0.0)
    acc = start
    for i in range(aw.link.shape[0]):
        link = aw.link[i]
        constant = aw.constant[i]
        row = aw.row[i]
        parent = link[to.PARENT]
        if parent < 0:
            dw = (0.0, 0.0, 0.0)
            acc = start
        elif link[to.INTERFACE] >= 0:
            dw = load3(aw.interface[link[to.INTERFACE]], to.I_ANGULAR)
            acc = load3(aw.interface[link[to.INTERFACE]], to.I_LINEAR)
        elif parent != i - 1:
            dw = load3(aw.row[parent], to.R_ANGULAR)
            acc = load3(aw.row[parent], to.R_LINEAR)
        if link[to.FORM] == to.ALIGNED:
            r = load3(constant, to.C_P)
            if constant[to.C_SHIFT] != 0.0:
                r = load3(aw.pose[i], to.P_P)
            acc = turn(row[to.R_COS], -row[to.R_SIN], add3(acc, cross3(dw, r)))
            dw = turn(row[to.R_COS], -row[to.R_SIN], dw)
        else:
            R_AG = load9(aw.pose[i], to.P_R)
            acc = rotate_back(R_AG, add3(acc, cross3(dw, load3(aw.pose[i], to.P_P))))
            dw = rotate_back(R_AG, dw)
        if biased:
            dw = add3(dw, load3(row, to.R_BIAS_ANGULAR))
            acc = add3(acc, load3(row, to.R_BIAS_LINEAR))
        if link[to.FREEDOMS] > 0:
            o = link[to.JOINT_V]
            if link[to.FORM] == to.SEVERAL:
                dw, acc = _accelerate_several(aw, link, dw, acc, out)
            else:
                u = load6(row, to.R_U)
                t = row[to.R_FORCE] - u[0] * dw[0] - u[1] * dw[1] - u[2] * dw[2]
                t = row[to.R_D] * (t - u[3] * acc[0] - u[4] * acc[1] - u[5] * acc[2])
                out[o] = t
                dw = (dw[0], dw[1], dw[2] + constant[to.C_TURN] * t)
                acc = (acc[0], acc[1], acc[2] + constant[to.C_SHIFT] * t)
        if link[to.FLEX] >= 0:
            own_R = load9(constant, to.C_OWN_R)
            dw = rotate(own_R, dw)
            acc = sub3(rotate(own_R, acc), cross3(dw, load3(constant, to.C_OWN_P)))
            if biased:
                acc = add3(acc, load3(aw.pose[i], to.P_BIAS))
            accelerate_modes(plan, aw, link[to.FLEX], dw, acc, biased, out)
        store3(row, to.R_ANGULAR, dw)
        store3(row, to.R_LINEAR, acc)


@kernel
def _accelerate_several(aw, link, dw, acc, out):
    """Accelerations of a joint of several coordinates, written to ``out``; those of G with them."""
    S, Q, D = aw.subspace[link[to.MULTI], 0], aw.subspace[link[to.MULTI], 1], aw.subspace[link[to.MULTI], 2]
    left = aw.force[link[to.MULTI]]
    n = link[to.FREEDOMS]
    o = link[to.JOINT_V]
    for j in range(n - 1, -1, -1):
        t = left[j]
        for i in range(3):
            t -= Q[j, i] * dw[i] + Q[j, 3 + i] * acc[i]
        for k in range(j + 1, n):
            t -= D[k, j] * out[o + k]
        out[o + j] = t / D[j, j]
    for j in range(n):
        t = out[o + j]
        dw = add3(dw, (t * S[0, j], t * S[1, j], t * S[2, j]))
        acc = add3(acc, (t * S[3, j], t * S[4, j], t * S[5, j]))
    return dw, acc
