"""A reduced body in the articulated-body recursion: its modes are eliminated, never factored.

With y the acceleration of B, f the wrenches that children ask at the frames that deform, and W the
inverse modal mass (the identity, or a diagonal): qdd = -W (C^T y + Gamma^T f + b), where the rows of
Gamma are a frame's motion per unit of each mode.  A child asks f = I a + p of the frame's
acceleration a, so that only systems of 6 equations a child are solved (Woodbury's identity).
"""

from __future__ import annotations

from flexmbd.multibody.kernels import articulated_layout as to
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.articulated_modes import (
    elastic_forces,
    first_moments,
    frame_sums,
    modes_asked,
    modes_schur,
    modes_wrench,
    second_moments,
    six_mode_sums,
    six_sums,
    spin_forces,
    subtract_frame_forces,
    sum_pairs,
)
from flexmbd.multibody.kernels.compiling import inner_kernel, part_of_kernel
from flexmbd.multibody.kernels.so3 import (
    add3,
    compose,
    cross3,
    exp_rotation,
    left_jacobian,
    left_jacobian_rate,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    store9,
)
from flexmbd.multibody.kernels.spatial import add6, load6, scale6, skew, store6, sub6, sub9, symmetric_times


@inner_kernel
def left_jacobian_matrix(theta):
    """J_l(theta) as nine entries."""
    x = left_jacobian(theta, (1.0, 0.0, 0.0))
    y = left_jacobian(theta, (0.0, 1.0, 0.0))
    z = left_jacobian(theta, (0.0, 0.0, 1.0))
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])


@part_of_kernel
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
    move, theta = frame_sums(plan.modal, o, n, x[qx : qx + n])
    rate, theta_rate = frame_sums(plan.modal, o, n, v[qv : qv + n])
    turning = left_jacobian_matrix(theta)
    spin = rotate(turning, theta_rate)
    p = add3(load3(fixed, at.FRAME_P), move)
    store3(row, to.I_P, p)
    store9(row, to.I_R, compose(exp_rotation(theta), load9(fixed, at.FRAME_R)))
    store9(row, to.I_TURN, turning)
    store3(row, to.I_BIAS_ANGULAR, add3(left_jacobian_rate(theta, theta_rate), cross3(w, spin)))
    store3(row, to.I_BIAS_LINEAR, cross3(w, add3(cross3(w, p), scale3(2.0, rate))))
    return add3(w, spin)


@part_of_kernel
def prepare_body(plan, aw, k, x, v, w, extra):
    """Write the rigid inertia, coupling and bias forces of flexible body k.

    Bias is what the motion asks for where B turns at w without acceleration and qdd = 0: centrifugal,
    Coriolis, elastic and viscous forces (theory: seed 3 eq. 3.23-3.29).
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    flex = plan.flex[info[to.F_FLEX]]
    tree = plan.tree[info[to.F_BODY]]
    qv = tree[at.MODAL_V]
    q = x[tree[at.MODAL_X] : tree[at.MODAL_X] + n]
    qd = v[qv : qv + n]
    bias = aw.bias[k]
    weight = aw.weight[k]
    table = aw.table[k]
    coupling = table[to.T_COUPLING : to.T_COUPLING + 6]
    for j in range(n):
        bias[j] = aw.asked[qv + j]
        weight[j] = 1.0
    for j in range(n if extra.shape[0] > 0 else 0):
        weight[j] = 1.0 / (1.0 + extra[qv + j])
    elastic_forces(plan.modal, flex, q, qd, aw.ask[k], bias)
    o = info[to.F_PAIRS]
    spins = w[0] != 0.0 or w[1] != 0.0 or w[2] != 0.0
    sum_pairs(aw.pairs, o, n, q, qd, spins, table)
    constant = aw.constant[info[to.F_BODY]]
    xx, xy, xz, yy, yz, zz = second_moments(aw.pairs, o, n, q, table)
    inertia = load6(constant, to.C_INERTIA)
    inertia = add6(inertia, (yy + zz, -xy, -xz, xx + zz, -yz, xx + yy))
    first = add3(load3(constant, to.C_FIRST), first_moments(coupling, n, q))
    torque = (0.0, 0.0, 0.0)
    force = torque
    if spins:
        torque = spin_forces(n, w, qd, table, coupling, bias)
        torque = add3(torque, cross3(w, symmetric_times(inertia, w)))
        coriolis = scale3(2.0, first_moments(coupling, n, qd))
        force = cross3(w, add3(cross3(w, first), coriolis))
    row = aw.body[k]
    store6(row, to.B_INERTIA, inertia)
    store3(row, to.B_FIRST, first)
    store3(row, to.B_TORQUE, torque)
    store3(row, to.B_FORCE, force)


@part_of_kernel
def _modes_at(plan, aw, slot):
    """Offset of an interface's mode rows in Plan.modal."""
    return plan.frame_of[aw.interface_frame[slot], at.FRAME_MODES]


@part_of_kernel
def eliminate_modes(plan, aw, k):
    """Blocks A, B, M of flexible body k about B once its modes yield (a, b, m)."""
    info = aw.flex[k]
    row = aw.body[k]
    coupling = aw.table[k, to.T_COUPLING : to.T_COUPLING + 6]
    a, b, m = modes_schur(coupling, aw.weight[k], info[to.F_MODES])
    mass = aw.constant[info[to.F_BODY], to.C_MASS]
    a = sub6(load6(row, to.B_INERTIA), a)
    b = sub9(skew(load3(row, to.B_FIRST)), b)
    m = sub6((mass, 0.0, 0.0, mass, 0.0, mass), m)
    if info[to.F_COUNT] > 0:
        return _bear_children(plan, aw, k, a, b, m)
    return a, b, m


@part_of_kernel
def _bear_children(plan, aw, k, a, b, m):
    """Add the children's inertia as the modes pass it on: Y^T (1 + I G)^-1 I Y, one half of it."""
    info = aw.flex[k]
    size = 6 * info[to.F_COUNT]
    _respond(plan, aw, k)
    _invert(aw, k, size)
    response = aw.response[k]
    stiff = aw.stiff[k]
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


@part_of_kernel
def _turn_rows(turning, matrix, row, columns):
    """Rows row .. row + 2 of ``matrix`` times the 3 x 3 matrix ``turning`` from the left."""
    for j in range(columns):
        turned = rotate(turning, (matrix[row, j], matrix[row + 1, j], matrix[row + 2, j]))
        matrix[row, j] = turned[0]
        matrix[row + 1, j] = turned[1]
        matrix[row + 2, j] = turned[2]


@part_of_kernel
def _respond(plan, aw, k):
    """Write Y = X - Gamma W C^T and G = Gamma W Gamma^T of the interfaces of body k."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    modal = plan.modal
    weight = aw.weight[k]
    coupling = aw.table[k, to.T_COUPLING : to.T_COUPLING + 6]
    response = aw.response[k]
    compliance = aw.compliance[k]
    for s in range(info[to.F_COUNT]):
        slot = info[to.F_FIRST] + s
        o = _modes_at(plan, aw, slot)
        for i in range(6):
            # mode rows are translations first, wrenches and accelerations here angular first
            mine = o + n * ((i + 3) % 6)
            store6(response[6 * s + i], 0, scale6(-1.0, six_sums(modal, mine, weight, coupling, n)))
            for r in range(s + 1):
                other = _modes_at(plan, aw, info[to.F_FIRST] + r)
                t = six_mode_sums(modal, mine, weight, other, n)
                store6(compliance[6 * s + i], 6 * r, (t[3], t[4], t[5], t[0], t[1], t[2]))
        _turn_rows(load9(aw.interface[slot], to.I_TURN), response, 6 * s, 6)
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


@part_of_kernel
def _turn_compliance(aw, k):
    """Fill the compliance above its diagonal blocks and turn both its sides by J_l(theta)."""
    info = aw.flex[k]
    compliance = aw.compliance[k]
    size = 6 * info[to.F_COUNT]
    for i in range(size):
        for j in range(i):
            compliance[j, i] = compliance[i, j]
    for s in range(info[to.F_COUNT]):
        turning = load9(aw.interface[info[to.F_FIRST] + s], to.I_TURN)
        _turn_rows(turning, compliance, 6 * s, size)
        _turn_rows(turning, compliance.T, 6 * s, size)


@inner_kernel
def _child_asks(row, source, o, j):
    """Child's inertia times rows o .. o + 5 of column j of ``source``: torque, force."""
    dw = (source[o, j], source[o + 1, j], source[o + 2, j])
    acc = (source[o + 3, j], source[o + 4, j], source[o + 5, j])
    b = load9(row, to.I_B)
    return (
        add3(symmetric_times(load6(row, to.I_A), dw), rotate(b, acc)),
        add3(rotate_back(b, dw), symmetric_times(load6(row, to.I_M), acc)),
    )


@part_of_kernel
def _invert(aw, k, size):
    """Write yielding = (1 + I G)^-1 and stiff = yielding I Y by elimination with pivots."""
    info = aw.flex[k]
    system = aw.system
    for s in range(info[to.F_COUNT]):
        row = aw.interface[info[to.F_FIRST] + s]
        o = 6 * s
        for j in range(size + 6):
            if j < size:
                torque, force = _child_asks(row, aw.compliance[k], o, j)
                for i in range(6):
                    system[o + i, size + j] = 0.0
            else:
                torque, force = _child_asks(row, aw.response[k], o, j - size)
            column = j if j < size else size + j
            for i in range(3):
                system[o + i, column] = torque[i]
                system[o + 3 + i, column] = force[i]
    for i in range(size):
        system[i, i] += 1.0
        system[i, size + i] = 1.0
    _eliminate(system, size, 2 * size + 6)
    for i in range(size):
        for j in range(size):
            aw.yielding[k, i, j] = system[i, size + j]
        for j in range(6):
            aw.stiff[k, i, j] = system[i, 2 * size + j]


@inner_kernel
def _eliminate(system, size, columns):
    """Gauss-Jordan elimination with row pivots on (size, columns)."""
    for p in range(size):
        best = p
        for i in range(p + 1, size):
            if abs(system[i, p]) > abs(system[best, p]):
                best = i
        if best != p:
            for j in range(columns):
                t = system[p, j]
                system[p, j] = system[best, j]
                system[best, j] = t
        scale = 1.0 / system[p, p]
        for j in range(p, columns):
            system[p, j] *= scale
        for i in range(size):
            if i != p:
                f = system[i, p]
                for j in range(p, columns):
                    system[i, j] -= f * system[p, j]


@part_of_kernel
def modal_wrench(plan, aw, k, share):
    """(torque, force) about B that body k asks while y = 0: of its modal forces and children.

    ``share``: of the children's bias accelerations, zero for a solve with the factors.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    bias = aw.bias[k]
    weight = aw.weight[k]
    torque, force = modes_wrench(aw.table[k, to.T_COUPLING : to.T_COUPLING + 6], weight, bias, n)
    size = 6 * info[to.F_COUNT]
    if size == 0:
        return torque, force
    t0, t1, t2 = torque
    f0, f1, f2 = force
    asked, held = aw.load[k, 0], aw.load[k, 1]
    ask = aw.ask[k]
    for j in range(n):
        ask[j] = -weight[j] * bias[j]
    for s in range(info[to.F_COUNT]):
        row = aw.interface[info[to.F_FIRST] + s]
        linear, angular = frame_sums(plan.modal, _modes_at(plan, aw, info[to.F_FIRST] + s), n, ask)
        angular = rotate(load9(row, to.I_TURN), angular)
        angular = add3(angular, scale3(share, load3(row, to.I_BIAS_ANGULAR)))
        linear = add3(linear, scale3(share, load3(row, to.I_BIAS_LINEAR)))
        b = load9(row, to.I_B)
        child_torque = add3(symmetric_times(load6(row, to.I_A), angular), rotate(b, linear))
        child_force = add3(rotate_back(b, angular), symmetric_times(load6(row, to.I_M), linear))
        store3(asked, 6 * s, add3(load3(row, to.I_TORQUE), child_torque))
        store3(asked, 6 * s + 3, add3(load3(row, to.I_FORCE), child_force))
    response = aw.response[k]
    for i in range(size):
        t = 0.0
        for j in range(size):
            t += aw.yielding[k, i, j] * asked[j]
        held[i] = t
        t0 += response[i, 0] * t
        t1 += response[i, 1] * t
        t2 += response[i, 2] * t
        f0 += response[i, 3] * t
        f1 += response[i, 4] * t
        f2 += response[i, 5] * t
    return (t0, t1, t2), (f0, f1, f2)


@part_of_kernel
def accelerate_modes(plan, aw, k, angular, linear, share, a):
    """Write the modal accelerations of body k, and the accelerations of its interfaces."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    qv = plan.tree[info[to.F_BODY], at.MODAL_V]
    c = aw.table[k, to.T_COUPLING : to.T_COUPLING + 6]
    bias = aw.bias[k]
    weight = aw.weight[k]
    modal = plan.modal
    qdd = a[qv : qv + n]
    modes_asked(c, bias, n, angular, linear, qdd)
    count = info[to.F_COUNT]
    held, stiff = aw.load[k, 1], aw.stiff[k]
    y = (angular[0], angular[1], angular[2], linear[0], linear[1], linear[2])
    for s in range(count):
        for i in range(6 * s, 6 * s + 6):
            t = held[i]
            for j in range(6):
                t += stiff[i, j] * y[j]
            aw.load[k, 2, i] = t
        slot = info[to.F_FIRST] + s
        o = _modes_at(plan, aw, slot)
        wrench = load6(aw.load[k, 2], 6 * s)
        turn = rotate_back(load9(aw.interface[slot], to.I_TURN), (wrench[0], wrench[1], wrench[2]))
        subtract_frame_forces(modal, o, n, (wrench[3], wrench[4], wrench[5]), turn, qdd)
    for j in range(n):
        qdd[j] *= weight[j]
    for s in range(count):
        slot = info[to.F_FIRST] + s
        row = aw.interface[slot]
        move, theta_rate2 = frame_sums(modal, _modes_at(plan, aw, slot), n, qdd)
        dw = add3(angular, rotate(load9(row, to.I_TURN), theta_rate2))
        d = add3(linear, add3(cross3(angular, load3(row, to.I_P)), move))
        dw = add3(dw, scale3(share, load3(row, to.I_BIAS_ANGULAR)))
        d = add3(d, scale3(share, load3(row, to.I_BIAS_LINEAR)))
        store3(row, to.I_ANGULAR, dw)
        store3(row, to.I_LINEAR, d)
