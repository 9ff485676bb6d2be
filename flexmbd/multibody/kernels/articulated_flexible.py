"""A reduced body in the articulated-body recursion: its modes are eliminated, never factored.

With y the acceleration of B, f the wrenches that children ask at the frames that deform, and W the
inverse modal mass (the identity, or a diagonal): qdd = -W (C^T y + Gamma^T f + b), where the rows of
Gamma are a frame's motion per unit of each mode.  A child asks f = I a + p of the frame's
acceleration a, so that only systems of 6 equations a child are solved (Woodbury's identity).
"""

from __future__ import annotations

from flexmbd.multibody.kernels import articulated_layout as to
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.elasticity import add_elastic_forces
from flexmbd.multibody.kernels.recursion import modal_sum
from flexmbd.multibody.kernels.so3 import (
    add3,
    compose,
    cross3,
    exp_rotation,
    left_jacobian,
    left_jacobian_rate,
    left_jacobian_transposed,
    load3,
    load9,
    scale3,
    store3,
    store9,
)
from flexmbd.multibody.kernels.spatial import load6, store6, symmetric_times


@kernel
def deform_interface(plan, aw, slot, x, v, w):
    """Write pose and bias accelerations of an interface; return its angular velocity, in B.

    ``w`` is that of B.  The frame is as in ``recursion.deform_frame``.
    """
    f = aw.interface_frame[slot]
    fixed = plan.frames[f]
    row = aw.interface[slot]
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    o = plan.frame_of[f, at.FRAME_MODES]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    move, theta = modal_sum(plan.modal, o, n, x[qx : qx + n])
    rate, theta_rate = modal_sum(plan.modal, o, n, v[qv : qv + n])
    spin = left_jacobian(theta, theta_rate)
    p = add3(load3(fixed, at.FRAME_P), move)
    store3(row, to.I_P, p)
    store9(row, to.I_R, compose(exp_rotation(theta), load9(fixed, at.FRAME_R)))
    store3(row, to.I_THETA, theta)
    store3(row, to.I_BIAS_ANGULAR, add3(left_jacobian_rate(theta, theta_rate), cross3(w, spin)))
    store3(row, to.I_BIAS_LINEAR, cross3(w, add3(cross3(w, p), scale3(2.0, rate))))
    return add3(w, spin)


@kernel
def prepare_body(plan, aw, k, x, v, w, extra):  # noqa: PLR0915  one pass over the pairs
    """Write the rigid inertia, coupling and bias forces of flexible body k.

    Bias is what the motion asks for where B turns at w without acceleration and qdd = 0: centrifugal,
    Coriolis, elastic and viscous forces (theory: seed 3 eq. 3.23-3.29).
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    flex = plan.flex[info[to.F_FLEX]]
    tree = plan.tree[info[to.F_BODY]]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    q = x[qx : qx + n]
    qd = v[qv : qv + n]
    modal = plan.modal
    c0 = flex[at.MODAL_FIRST]
    s0 = flex[at.MODAL_SECOND]
    p0 = flex[at.MODAL_PAIR]
    bias = aw.bias[k]
    weight = aw.weight[k]
    coupling = aw.coupling[k]
    for j in range(n):
        bias[j] = aw.asked[qv + j]
        weight[j] = 1.0
    for j in range(n if extra.shape[0] > 0 else 0):
        weight[j] = 1.0 / (1.0 + extra[qv + j])
    add_elastic_forces(plan, flex, q, qd, bias)
    ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    w00 = w[0] * w[0] - ww
    w11 = w[1] * w[1] - ww
    w22 = w[2] * w[2] - ww
    w01 = w[0] * w[1]
    w02 = w[0] * w[2]
    w12 = w[1] * w[2]
    constant = aw.constant[info[to.F_BODY]]
    hx, hy, hz = load3(constant, to.C_FIRST)
    ixx, ixy, ixz, iyy, iyz, izz = load6(constant, to.C_INERTIA)
    vx = vy = vz = 0.0
    tx = ty = tz = 0.0
    for j in range(n):
        base = p0 + 9 * n * j
        v0 = v1 = v2 = v3 = v4 = v5 = v6 = v7 = v8 = 0.0
        u1 = u2 = u3 = u5 = u6 = u7 = 0.0
        for i in range(n):
            f = q[i]
            g = qd[i]
            o = base + i
            v0 += modal[o] * f
            v1 += modal[o + n] * f
            v2 += modal[o + 2 * n] * f
            v3 += modal[o + 3 * n] * f
            v4 += modal[o + 4 * n] * f
            v5 += modal[o + 5 * n] * f
            v6 += modal[o + 6 * n] * f
            v7 += modal[o + 7 * n] * f
            v8 += modal[o + 8 * n] * f
            u1 += modal[o + n] * g
            u2 += modal[o + 2 * n] * g
            u3 += modal[o + 3 * n] * g
            u5 += modal[o + 5 * n] * g
            u6 += modal[o + 6 * n] * g
            u7 += modal[o + 7 * n] * g
        s = s0 + 9 * j
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
        # second moments grow by q_j (V_j + X_j^T), V_j = integral of rho phi_j r^T
        xx = f * (v0 + modal[s])
        yy = f * (v4 + modal[s + 4])
        zz = f * (v8 + modal[s + 8])
        ixx += yy + zz
        iyy += xx + zz
        izz += xx + yy
        ixy -= f * (v1 + modal[s + 3])
        ixz -= f * (v2 + modal[s + 6])
        iyz -= f * (v5 + modal[s + 7])
        c = load3(modal, c0 + 3 * j)
        hx += f * c[0]
        hy += f * c[1]
        hz += f * c[2]
        g = qd[j]
        vx += g * c[0]
        vy += g * c[1]
        vz += g * c[2]
        coupling[0, j] = v7 - v5
        coupling[1, j] = v2 - v6
        coupling[2, j] = v3 - v1
        coupling[3, j] = c[0]
        coupling[4, j] = c[1]
        coupling[5, j] = c[2]
        trace = v0 + v4 + v8
        g *= 2.0
        tx += g * (w[0] * trace - v0 * w[0] - v1 * w[1] - v2 * w[2])
        ty += g * (w[1] * trace - v3 * w[0] - v4 * w[1] - v5 * w[2])
        tz += g * (w[2] * trace - v6 * w[0] - v7 * w[1] - v8 * w[2])
        load = w00 * v0 + w11 * v4 + w22 * v8
        load += w01 * (v1 + v3) + w02 * (v2 + v6) + w12 * (v5 + v7)
        load += 2.0 * (w[0] * (u7 - u5) + w[1] * (u2 - u6) + w[2] * (u3 - u1))
        bias[j] += load
    inertia = (ixx, ixy, ixz, iyy, iyz, izz)
    first = (hx, hy, hz)
    row = aw.body[k]
    store6(row, to.B_INERTIA, inertia)
    store3(row, to.B_FIRST, first)
    gyroscopic = cross3(w, symmetric_times(inertia, w))
    store3(row, to.B_TORQUE, add3(gyroscopic, (tx, ty, tz)))
    coriolis = add3(cross3(w, first), scale3(2.0, (vx, vy, vz)))
    store3(row, to.B_FORCE, cross3(w, coriolis))


@kernel
def _modes_at(plan, aw, slot):
    """Offset of an interface's mode rows in Plan.modal."""
    return plan.frame_of[aw.interface_frame[slot], at.FRAME_MODES]


@kernel
def eliminate_modes(plan, aw, k):
    """Blocks A, B, M of flexible body k about B once its modes yield (a, b, m)."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    c = aw.coupling[k]
    weight = aw.weight[k]
    row = aw.body[k]
    a0, a1, a2, a3, a4, a5 = load6(row, to.B_INERTIA)
    hx, hy, hz = load3(row, to.B_FIRST)
    b0 = b4 = b8 = 0.0
    b1, b2, b3, b5, b6, b7 = -hz, hy, hz, -hx, -hy, hx
    m0 = m3 = m5 = aw.constant[info[to.F_BODY], to.C_MASS]
    m1 = m2 = m4 = 0.0
    for j in range(n):
        s = weight[j]
        x, y, z = c[0, j], c[1, j], c[2, j]
        u, v, w = c[3, j], c[4, j], c[5, j]
        sx, sy, sz = s * x, s * y, s * z
        a0 -= sx * x
        a1 -= sx * y
        a2 -= sx * z
        a3 -= sy * y
        a4 -= sy * z
        a5 -= sz * z
        b0 -= sx * u
        b1 -= sx * v
        b2 -= sx * w
        b3 -= sy * u
        b4 -= sy * v
        b5 -= sy * w
        b6 -= sz * u
        b7 -= sz * v
        b8 -= sz * w
        m0 -= s * u * u
        m1 -= s * u * v
        m2 -= s * u * w
        m3 -= s * v * v
        m4 -= s * v * w
        m5 -= s * w * w
    a = (a0, a1, a2, a3, a4, a5)
    b = (b0, b1, b2, b3, b4, b5, b6, b7, b8)
    m = (m0, m1, m2, m3, m4, m5)
    if info[to.F_COUNT] > 0:
        return _bear_children(plan, aw, k, a, b, m)
    return a, b, m


@kernel
def _bear_children(plan, aw, k, a, b, m):
    """Add the children's inertia as the modes pass it on: Y^T (1 + I G)^-1 I Y."""
    info = aw.flex[k]
    size = 6 * info[to.F_COUNT]
    _respond(plan, aw, k)
    _invert(aw, k, size)
    response = aw.response[k]
    stiff = aw.stiff[k]
    inertia = aw.inertia[k]
    for i in range(size):
        for j in range(6):
            t = 0.0
            for e in range(size):
                t += inertia[i, e] * response[e, j]
            stiff[i, j] = t
    for i in range(size):
        y = response[i]
        s = stiff[i]
        a = (
            a[0] + y[0] * s[0],
            a[1] + y[0] * s[1],
            a[2] + y[0] * s[2],
            a[3] + y[1] * s[1],
            a[4] + y[1] * s[2],
            a[5] + y[2] * s[2],
        )
        b = (
            b[0] + y[0] * s[3],
            b[1] + y[0] * s[4],
            b[2] + y[0] * s[5],
            b[3] + y[1] * s[3],
            b[4] + y[1] * s[4],
            b[5] + y[1] * s[5],
            b[6] + y[2] * s[3],
            b[7] + y[2] * s[4],
            b[8] + y[2] * s[5],
        )
        m = (
            m[0] + y[3] * s[3],
            m[1] + y[3] * s[4],
            m[2] + y[3] * s[5],
            m[3] + y[4] * s[4],
            m[4] + y[4] * s[5],
            m[5] + y[5] * s[5],
        )
    return a, b, m


@kernel
def _turn_rows(theta, matrix, row, columns):
    """Rows row .. row + 2 of ``matrix`` times J_l(theta) from the left."""
    for j in range(columns):
        turned = left_jacobian(theta, (matrix[row, j], matrix[row + 1, j], matrix[row + 2, j]))
        matrix[row, j] = turned[0]
        matrix[row + 1, j] = turned[1]
        matrix[row + 2, j] = turned[2]


@kernel
def _respond(plan, aw, k):
    """Write Y = X - Gamma W C^T and G = Gamma W Gamma^T of the interfaces of body k."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    modal = plan.modal
    weight = aw.weight[k]
    coupling = aw.coupling[k]
    response = aw.response[k]
    compliance = aw.compliance[k]
    for s in range(info[to.F_COUNT]):
        slot = info[to.F_FIRST] + s
        o = _modes_at(plan, aw, slot)
        theta = load3(aw.interface[slot], to.I_THETA)
        for i in range(6):
            # mode rows are translations first, wrenches and accelerations here angular first
            mine = o + n * ((i + 3) % 6)
            for j in range(6):
                t = 0.0
                for e in range(n):
                    t += modal[mine + e] * weight[e] * coupling[j, e]
                response[6 * s + i, j] = -t
            for r in range(s + 1):
                other = _modes_at(plan, aw, info[to.F_FIRST] + r)
                for j in range(6):
                    theirs = other + n * ((j + 3) % 6)
                    t = 0.0
                    for e in range(n):
                        t += modal[mine + e] * weight[e] * modal[theirs + e]
                    compliance[6 * s + i, 6 * r + j] = t
        _turn_rows(theta, response, 6 * s, 6)
        x, y, z = load3(aw.interface[slot], to.I_P)
        for i in range(6):
            response[6 * s + i, i] += 1.0
        response[6 * s + 3, 1] += z
        response[6 * s + 3, 2] -= y
        response[6 * s + 4, 0] -= z
        response[6 * s + 4, 2] += x
        response[6 * s + 5, 0] += y
        response[6 * s + 5, 1] -= x
    _turn_compliance(aw, k)


@kernel
def _turn_compliance(aw, k):
    """Fill the compliance above its diagonal blocks and turn both its sides by J_l(theta)."""
    info = aw.flex[k]
    compliance = aw.compliance[k]
    size = 6 * info[to.F_COUNT]
    for i in range(size):
        for j in range(i):
            compliance[j, i] = compliance[i, j]
    for s in range(info[to.F_COUNT]):
        theta = load3(aw.interface[info[to.F_FIRST] + s], to.I_THETA)
        _turn_rows(theta, compliance, 6 * s, size)
        _turn_rows(theta, compliance.T, 6 * s, size)


@kernel
def _invert(aw, k, size):
    """Write yielding = (1 + I G)^-1 and inertia = yielding I by elimination with pivots."""
    info = aw.flex[k]
    system = aw.system
    compliance = aw.compliance[k]
    for i in range(size):
        for j in range(2 * size):
            system[i, size + j] = 0.0
    for s in range(info[to.F_COUNT]):
        row = aw.interface[info[to.F_FIRST] + s]
        o = 2 * size + 6 * s
        for i in range(3):
            for j in range(3):
                system[6 * s + i, o + 3 + j] = row[to.I_B + 3 * i + j]
                system[6 * s + 3 + j, o + i] = row[to.I_B + 3 * i + j]
                p = i * (5 - i) // 2 + j if j >= i else j * (5 - j) // 2 + i
                system[6 * s + i, o + j] = row[to.I_A + p]
                system[6 * s + 3 + i, o + 3 + j] = row[to.I_M + p]
    for i in range(size):
        o = 6 * (i // 6)
        for j in range(size):
            t = 0.0
            for e in range(6):
                t += system[i, 2 * size + o + e] * compliance[o + e, j]
            system[i, j] = t
        system[i, i] += 1.0
        system[i, size + i] = 1.0
    _eliminate(system, size)
    for i in range(size):
        for j in range(size):
            aw.yielding[k, i, j] = system[i, size + j]
            aw.inertia[k, i, j] = 0.5 * (system[i, 2 * size + j] + system[j, 2 * size + i])


@kernel
def _eliminate(system, size):
    """Gauss-Jordan elimination with row pivots on (size, 3 size)."""
    for p in range(size):
        best = p
        for i in range(p + 1, size):
            if abs(system[i, p]) > abs(system[best, p]):
                best = i
        if best != p:
            for j in range(3 * size):
                t = system[p, j]
                system[p, j] = system[best, j]
                system[best, j] = t
        scale = 1.0 / system[p, p]
        for j in range(p, 3 * size):
            system[p, j] *= scale
        for i in range(size):
            if i != p:
                f = system[i, p]
                for j in range(p, 3 * size):
                    system[i, j] -= f * system[p, j]


@kernel
def modal_wrench(plan, aw, k, biased):
    """(torque, force) about B that body k asks while y = 0: of its modal forces and children.

    ``biased``: with the children's bias accelerations; without for a solve with the factors.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    c = aw.coupling[k]
    bias = aw.bias[k]
    weight = aw.weight[k]
    t0 = t1 = t2 = f0 = f1 = f2 = 0.0
    for j in range(n):
        s = weight[j] * bias[j]
        t0 -= c[0, j] * s
        t1 -= c[1, j] * s
        t2 -= c[2, j] * s
        f0 -= c[3, j] * s
        f1 -= c[4, j] * s
        f2 -= c[5, j] * s
    size = 6 * info[to.F_COUNT]
    if size == 0:
        return (t0, t1, t2), (f0, f1, f2)
    free, asked, held = aw.load[k, 0], aw.load[k, 1], aw.load[k, 2]
    ask = aw.ask[k]
    for j in range(n):
        ask[j] = -weight[j] * bias[j]
    for s in range(info[to.F_COUNT]):
        row = aw.interface[info[to.F_FIRST] + s]
        linear, angular = modal_sum(plan.modal, _modes_at(plan, aw, info[to.F_FIRST] + s), n, ask)
        angular = left_jacobian(load3(row, to.I_THETA), angular)
        if biased:
            angular = add3(angular, load3(row, to.I_BIAS_ANGULAR))
            linear = add3(linear, load3(row, to.I_BIAS_LINEAR))
        store3(free, 6 * s, angular)
        store3(free, 6 * s + 3, linear)
        store6(asked, 6 * s, load6(row, to.I_TORQUE))
    response = aw.response[k]
    for i in range(size):
        t = 0.0
        for j in range(size):
            t += aw.inertia[k, i, j] * free[j] + aw.yielding[k, i, j] * asked[j]
        held[i] = t
        t0 += response[i, 0] * t
        t1 += response[i, 1] * t
        t2 += response[i, 2] * t
        f0 += response[i, 3] * t
        f1 += response[i, 4] * t
        f2 += response[i, 5] * t
    return (t0, t1, t2), (f0, f1, f2)


@kernel
def accelerate_modes(plan, aw, k, angular, linear, biased, a):
    """Write the modal accelerations of body k, and the accelerations of its interfaces."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    qv = plan.tree[info[to.F_BODY], at.MODAL_V]
    c = aw.coupling[k]
    bias = aw.bias[k]
    weight = aw.weight[k]
    modal = plan.modal
    for j in range(n):
        a[qv + j] = -(
            bias[j]
            + c[0, j] * angular[0]
            + c[1, j] * angular[1]
            + c[2, j] * angular[2]
            + c[3, j] * linear[0]
            + c[4, j] * linear[1]
            + c[5, j] * linear[2]
        )
    count = info[to.F_COUNT]
    held, stiff = aw.load[k, 2], aw.stiff[k]
    y = (angular[0], angular[1], angular[2], linear[0], linear[1], linear[2])
    for s in range(count):
        for i in range(6 * s, 6 * s + 6):
            t = held[i]
            for j in range(6):
                t += stiff[i, j] * y[j]
            aw.load[k, 3, i] = t
        slot = info[to.F_FIRST] + s
        o = _modes_at(plan, aw, slot)
        wrench = load6(aw.load[k, 3], 6 * s)
        turn = left_jacobian_transposed(load3(aw.interface[slot], to.I_THETA), (wrench[0], wrench[1], wrench[2]))
        for j in range(n):
            a[qv + j] -= (
                modal[o + j] * wrench[3]
                + modal[o + n + j] * wrench[4]
                + modal[o + 2 * n + j] * wrench[5]
                + modal[o + 3 * n + j] * turn[0]
                + modal[o + 4 * n + j] * turn[1]
                + modal[o + 5 * n + j] * turn[2]
            )
    for j in range(n):
        a[qv + j] *= weight[j]
    for s in range(count):
        slot = info[to.F_FIRST] + s
        row = aw.interface[slot]
        move, theta_rate2 = modal_sum(modal, _modes_at(plan, aw, slot), n, a[qv : qv + n])
        dw = add3(angular, left_jacobian(load3(row, to.I_THETA), theta_rate2))
        d = add3(linear, add3(cross3(angular, load3(row, to.I_P)), move))
        if biased:
            dw = add3(dw, load3(row, to.I_BIAS_ANGULAR))
            d = add3(d, load3(row, to.I_BIAS_LINEAR))
        store3(row, to.I_ANGULAR, dw)
        store3(row, to.I_LINEAR, d)
