"""A reduced body in the articulated-body recursion: its modes are eliminated, never factored.

Their mass is the identity.  With y the acceleration of B, f the wrenches that children require at deforming frames and
b the modal bias forces: qdd = -(C^T y + Gamma^T f + b), where the rows of Gamma are a frame's motion per unit of each
mode; `interface_elimination` finds f.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
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
from flexmbd.multibody.kernels.algebra.spatial import load6, skew, store6, sub6, sub9
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import TUPLE3, deferred_kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.face import deform_face
from flexmbd.multibody.kernels.forward_dynamics.interface_elimination import (
    add_child_inertia,
    child_bias_wrench,
    interface_modes,
    interface_wrenches,
)
from flexmbd.multibody.kernels.forward_dynamics.modes import (
    free_modal_accelerations,
    modes_schur,
    modes_wrench,
)
from flexmbd.multibody.kernels.physics.elasticity import elastic_forces
from flexmbd.multibody.kernels.physics.frame_modes import add_frame_forces, modal_sum
from flexmbd.multibody.kernels.physics.gyroscopic import rotor_forces
from flexmbd.multibody.kernels.physics.modal_moments import COUPLING
from flexmbd.multibody.kernels.physics.reduced_inertia import add_velocity_forces, deform_body


@kernel
def left_jacobian_matrix(theta):
    """J_l(theta) as nine entries."""
    x = left_jacobian(theta, (1.0, 0.0, 0.0))
    y = left_jacobian(theta, (0.0, 1.0, 0.0))
    z = left_jacobian(theta, (0.0, 0.0, 1.0))
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])


@deferred_kernel(TUPLE3)
def deform_interface(plan, aw, slot, x, v, w):
    """Write pose and bias accelerations of an interface; return its angular velocity, in B.

    ``w`` is that of B.  The frame is as in ``recursion.deform_frame``.
    """
    f = aw.interface_frame[slot]
    if plan.frame_of[f, at.FRAME_STRAIN] >= 0:
        return deform_face(plan, aw, slot, x, v, w)
    fixed = plan.frames[f]
    row = aw.interface[slot]
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    o = plan.frame_of[f, at.FRAME_MODES]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    move, theta = modal_sum(plan.modal, o, n, x[qx : qx + n])
    rate, theta_rate = modal_sum(plan.modal, o, n, v[qv : qv + n])
    turning = left_jacobian_matrix(theta)
    spin = rotate(turning, theta_rate)
    p = add3(load3(fixed, at.FRAME_P), move)
    store3(row, to.I_P, p)
    store9(row, to.I_R, compose(exp_rotation(theta), load9(fixed, at.FRAME_R)))
    store9(row, to.I_TURN, turning)
    store3(row, to.I_BIAS_ANGULAR, add3(left_jacobian_rate(theta, theta_rate), cross3(w, spin)))
    store3(row, to.I_BIAS_LINEAR, cross3(w, add3(cross3(w, p), scale3(2.0, rate))))
    return add3(w, spin)


@deferred_kernel()
def prepare_body(plan, aw, k, x, v, w):
    """Write the rigid inertia, coupling and bias forces of flexible body k.

    Bias forces are those that the motion requires at y = 0 and qdd = 0 with B rotating at w: centrifugal,
    Coriolis, elastic and viscous forces.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    flex = plan.flex[info[to.F_FLEX]]
    tree = plan.tree[info[to.F_BODY]]
    qv = tree[at.MODAL_V]
    q = x[tree[at.MODAL_X] : tree[at.MODAL_X] + n]
    qd = v[qv : qv + n]
    bias = aw.bias[k]
    table = aw.table[k]
    for j in range(n):
        bias[j] = aw.required[qv + j]
    elastic_forces(plan.modal, flex, q, qd, aw.modal_acceleration[k], bias)
    i = info[to.F_BODY]
    spins = w[0] != 0.0 or w[1] != 0.0 or w[2] != 0.0
    second, first = deform_body(plan, i, q, qd, spins, table)
    torque = (0.0, 0.0, 0.0)
    force = torque
    if spins:
        torque, force = add_velocity_forces(plan, i, w, qd, second, first, table, bias)
    if flex[at.GYROSCOPIC] >= 0:
        torque = add3(torque, rotor_forces(plan.modal, flex, w, q, qd, bias))
    row = aw.body[k]
    xx, xy, xz, yy, yz, zz = second
    store6(row, to.B_INERTIA, (yy + zz, -xy, -xz, xx + zz, -yz, xx + yy))
    store3(row, to.B_FIRST, first)
    store3(row, to.B_TORQUE, torque)
    store3(row, to.B_FORCE, force)


@kernel
def eliminate_modes(plan, aw, k):
    """Blocks A, B, M of flexible body k about B with its modes eliminated (a, b, m)."""
    info = aw.flex[k]
    row = aw.body[k]
    coupling = aw.table[k, COUPLING : COUPLING + 6]
    a, b, m = modes_schur(coupling, info[to.F_MODES])
    mass = aw.constant[info[to.F_BODY], to.C_MASS]
    a = sub6(load6(row, to.B_INERTIA), a)
    b = sub9(skew(load3(row, to.B_FIRST)), b)
    m = sub6((mass, 0.0, 0.0, mass, 0.0, mass), m)
    if info[to.F_COUNT] > 0:
        return add_child_inertia(aw, k, a, b, m)
    return a, b, m


@kernel
def modal_wrench(plan, aw, k, share):
    """(torque, force) about B that body k requires at y = 0, by its modal forces and children.

    ``share``: of the children's bias accelerations, zero for a solve with the factors.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    bias = aw.bias[k]
    torque, force = modes_wrench(aw.table[k, COUPLING : COUPLING + 6], bias, n)
    if info[to.F_COUNT] > 0:
        more_torque, more_force = child_bias_wrench(aw, k, share)
        torque = add3(torque, more_torque)
        force = add3(force, more_force)
    return torque, force


@deferred_kernel()
def accelerate_modes(plan, aw, k, angular, linear, share, a):
    """Write the modal accelerations of body k, and the accelerations of its interfaces."""
    info = aw.flex[k]
    n = info[to.F_MODES]
    qv = plan.tree[info[to.F_BODY], at.MODAL_V]
    modal = aw.interface_rows
    qdd = a[qv : qv + n]
    free_modal_accelerations(aw.table[k, COUPLING : COUPLING + 6], aw.bias[k], n, angular, linear, qdd)
    count = info[to.F_COUNT]
    if count == 0:
        return
    interface_wrenches(aw, k, angular, linear)
    for s in range(count):
        slot = info[to.F_FIRST] + s
        row = aw.interface[slot]
        wrench = load6(aw.load[k, 2], 6 * s)
        turn = rotate_back(load9(row, to.I_TURN), (-wrench[0], -wrench[1], -wrench[2]))
        force = (-wrench[3], -wrench[4], -wrench[5])
        add_frame_forces(modal, interface_modes(aw, slot), n, force, turn, qdd)
    for s in range(count):
        slot = info[to.F_FIRST] + s
        row = aw.interface[slot]
        shift, theta_rate2 = modal_sum(modal, interface_modes(aw, slot), n, qdd)
        dw = add3(angular, rotate(load9(row, to.I_TURN), theta_rate2))
        d = add3(linear, add3(cross3(angular, load3(row, to.I_P)), shift))
        dw = add3(dw, scale3(share, load3(row, to.I_BIAS_ANGULAR)))
        d = add3(d, scale3(share, load3(row, to.I_BIAS_LINEAR)))
        store3(row, to.I_ANGULAR, dw)
        store3(row, to.I_LINEAR, d)
