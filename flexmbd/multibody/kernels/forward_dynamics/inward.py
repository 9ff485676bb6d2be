"""The inward passes of the articulated-body recursion: articulated inertias and bias forces, or bias forces alone."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate, rotate_back, scale3, sub3
from flexmbd.multibody.kernels.algebra.spatial import (
    add6,
    add9,
    put3,
    put6,
    put9,
    rotate_block,
    rotate_symmetric,
    row3,
    row6,
    row9,
    shift_block,
    shift_symmetric,
    shift_torque,
    skew,
    symmetric_times,
    transpose,
    turn,
    turn_block,
    turn_symmetric,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import INERTIA_AND_WRENCH, WRENCH, deferred_kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.flexible import eliminate_modes, modal_wrench
from flexmbd.multibody.kernels.forward_dynamics.hinge import eliminate_hinge
from flexmbd.multibody.kernels.forward_dynamics.multi_dof_joints import (
    eliminate_joint_forces,
    eliminate_multi_dof_joint,
    size_before_joint,
)
from flexmbd.multibody.kernels.physics.joint_elimination import eliminate_force, eliminate_inertia, screw_column

_ZERO3 = (0.0, 0.0, 0.0)
_ZERO6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ZERO9 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def gather_inertia(plan, work, aw, v, loaded):  # noqa: PLR0915  one pass
    """Articulated inertia and bias force of all bodies, inwards.

    What body i + 1 adds to its parent i stays in registers; other children add theirs in memory.
    """
    link = aw.link
    constant = aw.constant
    row = aw.row
    required = aw.required
    a = _ZERO6
    b = _ZERO9
    m = _ZERO6
    torque = _ZERO3
    force = _ZERO3
    for i in range(link.shape[0] - 1, -1, -1):
        w = row3(row, i, to.R_SPIN)
        if link[i, to.FLEX] < 0:
            mass = constant[i, to.C_MASS]
            first = row3(constant, i, to.C_FIRST)
            inertia = row6(constant, i, to.C_INERTIA)
            torque = add3(torque, cross3(w, symmetric_times(inertia, w)))
            force = add3(force, cross3(w, cross3(w, first)))
            a = add6(a, inertia)
            b = add9(b, skew(first))
            m = (m[0] + mass, m[1], m[2], m[3] + mass, m[4], m[5] + mass)
        if loaded:
            torque, force = _add_load(work, aw, i, torque, force)
        if link[i, to.FORM] == to.PLAIN:
            o = link[i, to.JOINT_V]
            over = 1.0 / a[5]
            joint_force = -required[o] - torque[2]
            put6(row, i, to.R_U, (a[2], a[4], a[5], b[6], b[7], b[8]))
            row[i, to.R_D] = over
            row[i, to.R_FORCE] = joint_force
            if link[i, to.PARENT] >= 0:
                a, b, m, torque, force = eliminate_hinge(
                    row[i, to.R_COS],
                    row[i, to.R_SIN],
                    row3(constant, i, to.C_P),
                    a,
                    b,
                    m,
                    torque,
                    force,
                    joint_force,
                    over,
                    w,
                    v[o],
                    row3(row, i, to.R_BIAS),
                )
            kept = False
        else:
            a, b, m, torque, force = _eliminate_joint(plan, aw, i, a, b, m, torque, force)
            kept = link[i, to.INTERFACE] >= 0
            if kept:
                slot = link[i, to.INTERFACE]
                put6(aw.interface, slot, to.I_A, a)
                put9(aw.interface, slot, to.I_B, b)
                put6(aw.interface, slot, to.I_M, m)
                put3(aw.interface, slot, to.I_TORQUE, torque)
                put3(aw.interface, slot, to.I_FORCE, force)
        parent = link[i, to.PARENT]
        if kept or parent != i - 1 or parent < 0:
            if not kept and parent >= 0:
                target = aw.gathered
                put6(target, parent, to.G_A, add6(row6(target, parent, to.G_A), a))
                put9(target, parent, to.G_B, add9(row9(target, parent, to.G_B), b))
                put6(target, parent, to.G_M, add6(row6(target, parent, to.G_M), m))
                put3(target, parent, to.G_TORQUE, add3(row3(target, parent, to.G_TORQUE), torque))
                put3(target, parent, to.G_FORCE, add3(row3(target, parent, to.G_FORCE), force))
            a = _ZERO6
            b = _ZERO9
            m = _ZERO6
            torque = _ZERO3
            force = _ZERO3


@kernel
def _add_load(work, aw, i, torque, force):
    """Add the wrench of force elements and loops on body i, in the body's frame of reference."""
    applied_force = row3(work.body, i, at.B_F)
    applied_torque = row3(work.body, i, at.B_T)
    if aw.link[i, to.FLEX] < 0:
        own_R = row9(aw.axes, i, to.X_OWN_R)
        applied_torque = sub3(applied_torque, cross3(row3(aw.axes, i, to.X_OWN_P), applied_force))
        applied_torque = rotate_back(own_R, applied_torque)
        applied_force = rotate_back(own_R, applied_force)
    return add3(torque, applied_torque), add3(force, applied_force)


@kernel
def _eliminate_joint(plan, aw, i, a, b, m, torque, force):
    """The inward step for any form: inertia and bias force for the parent, about its origin or deforming frame."""
    link = aw.link
    row = aw.row
    a = add6(a, row6(aw.gathered, i, to.G_A))
    b = add9(b, row9(aw.gathered, i, to.G_B))
    m = add6(m, row6(aw.gathered, i, to.G_M))
    torque = add3(torque, row3(aw.gathered, i, to.G_TORQUE))
    force = add3(force, row3(aw.gathered, i, to.G_FORCE))
    if link[i, to.FLEX] >= 0:
        a, b, m, torque, force = _condense_modes(plan, aw, i, a, b, m, torque, force)
    r = row3(aw.pose, i, to.P_P)
    if link[i, to.INTERFACE] >= 0:
        angular_size, linear_size = size_before_joint(aw, i, a, m)
        aw.interface[link[i, to.INTERFACE], to.I_SCALE] = angular_size
        aw.interface[link[i, to.INTERFACE], to.I_SCALE + 1] = linear_size
    if link[i, to.FORM] == to.MULTI_DOF:
        a, b, m, torque, force = eliminate_multi_dof_joint(aw, link[i], a, b, m, torque, force)
    elif link[i, to.FREEDOMS] > 0:
        a, b, m, torque, force = _eliminate_coordinate(aw, i, a, b, m, torque, force)
    if link[i, to.PARENT] < 0:
        return a, b, m, torque, force
    angular = row3(aw.pose, i, to.P_BIAS)
    linear = row3(row, i, to.R_BIAS)
    torque = add3(torque, add3(symmetric_times(a, angular), rotate(b, linear)))
    force = add3(force, add3(rotate_back(b, angular), symmetric_times(m, linear)))
    if link[i, to.FORM] <= to.ALIGNED:
        c = row[i, to.R_COS]
        s = row[i, to.R_SIN]
        a = turn_symmetric(c, s, a)
        b = turn_block(c, s, b)
        m = turn_symmetric(c, s, m)
        torque = turn(c, s, torque)
        force = turn(c, s, force)
    else:
        R_AG = row9(aw.pose, i, to.P_R)
        a = rotate_symmetric(R_AG, a)
        b = rotate_block(R_AG, b)
        m = rotate_symmetric(R_AG, m)
        torque = rotate(R_AG, torque)
        force = rotate(R_AG, force)
    shifted = shift_block(r, b, m)
    return shift_symmetric(r, a, b, shifted), shifted, m, shift_torque(r, torque, force), force


@kernel
def _eliminate_coordinate(aw, i, a, b, m, torque, force):
    """Eliminate a joint of one coordinate, which turns and slides along z."""
    turn, slide = aw.constant[i, to.C_TURN], aw.constant[i, to.C_SHIFT]
    u = screw_column(a, b, m, turn, slide)
    over = 1.0 / (turn * u[2] + slide * u[5] + aw.constant[i, to.C_SHAFT])
    joint_force = -aw.required[aw.link[i, to.JOINT_V]] - turn * torque[2] - slide * force[2]
    put6(aw.row, i, to.R_U, u)
    aw.row[i, to.R_D] = over
    aw.row[i, to.R_FORCE] = joint_force
    a, b, m = eliminate_inertia(a, b, m, u, over)
    torque, force = eliminate_force(torque, force, u, over * joint_force)
    return a, b, m, torque, force


@deferred_kernel(INERTIA_AND_WRENCH)
def _condense_modes(plan, aw, i, a, b, m, torque, force):
    """Articulated inertia and bias force of flexible body i with its modes eliminated, about G in G's axes.

    The arguments are the sums over children at frames that do not deform, about B.
    """
    k = aw.link[i, to.FLEX]
    own_a, own_b, own_m = eliminate_modes(plan, aw, k)
    modal_torque, modal_force = modal_wrench(plan, aw, k, 1.0)
    a = add6(a, own_a)
    b = add9(b, own_b)
    m = add6(m, own_m)
    bias = row3(aw.pose, i, to.P_OWN_BIAS)
    torque = add3(add3(torque, modal_torque), add3(row3(aw.body, k, to.B_TORQUE), rotate(b, bias)))
    force = add3(add3(force, modal_force), add3(row3(aw.body, k, to.B_FORCE), symmetric_times(m, bias)))
    r = scale3(-1.0, row3(aw.axes, i, to.X_OWN_P))
    back = transpose(row9(aw.axes, i, to.X_OWN_R))
    shifted = shift_block(r, b, m)
    return (
        rotate_symmetric(back, shift_symmetric(r, a, b, shifted)),
        rotate_block(back, shifted),
        rotate_symmetric(back, m),
        rotate(back, shift_torque(r, torque, force)),
        rotate(back, force),
    )


@kernel
def gather_bias_forces(plan, aw, rhs):
    """Bias forces of the generalised forces ``rhs`` (nv,), inwards, with the factors at hand."""
    for i in range(aw.link.shape[0]):
        put6(aw.gathered, i, to.G_TORQUE, _ZERO6)
    for i in range(aw.link.shape[0] - 1, -1, -1):
        propagate_forces(plan, aw, i, rhs)


@kernel
def propagate_forces(plan, aw, i, rhs):
    """The step of ``gather_bias_forces`` at body i, after those of its children."""
    link = aw.link
    row = aw.row
    gathered = aw.gathered
    torque = row3(gathered, i, to.G_TORQUE)
    force = row3(gathered, i, to.G_FORCE)
    if link[i, to.FLEX] >= 0:
        torque, force = _condense_modal_forces(plan, aw, i, rhs, torque, force)
    if link[i, to.FREEDOMS] > 0:
        if link[i, to.FORM] == to.MULTI_DOF:
            torque, force = eliminate_joint_forces(aw, link[i], rhs, torque, force)
        else:
            u = rhs[link[i, to.JOINT_V]]
            u -= aw.constant[i, to.C_TURN] * torque[2] + aw.constant[i, to.C_SHIFT] * force[2]
            row[i, to.R_FORCE] = u
            torque, force = eliminate_force(torque, force, row6(row, i, to.R_U), row[i, to.R_D] * u)
    parent = link[i, to.PARENT]
    if parent >= 0:
        r = row3(aw.constant, i, to.C_P)
        if link[i, to.FORM] != to.PLAIN:
            r = row3(aw.pose, i, to.P_P)
        if link[i, to.FORM] <= to.ALIGNED:
            torque = turn(row[i, to.R_COS], row[i, to.R_SIN], torque)
            force = turn(row[i, to.R_COS], row[i, to.R_SIN], force)
        else:
            R_AG = row9(aw.pose, i, to.P_R)
            torque = rotate(R_AG, torque)
            force = rotate(R_AG, force)
        torque = shift_torque(r, torque, force)
        if link[i, to.INTERFACE] >= 0:
            put3(aw.interface, link[i, to.INTERFACE], to.I_TORQUE, torque)
            put3(aw.interface, link[i, to.INTERFACE], to.I_FORCE, force)
        else:
            put3(gathered, parent, to.G_TORQUE, add3(row3(gathered, parent, to.G_TORQUE), torque))
            put3(gathered, parent, to.G_FORCE, add3(row3(gathered, parent, to.G_FORCE), force))


@deferred_kernel(WRENCH)
def _condense_modal_forces(plan, aw, i, rhs, torque, force):
    """Bias force about G of flexible body i: modal forces of ``rhs`` and wrenches of children, modes eliminated."""
    k = aw.link[i, to.FLEX]
    o = plan.tree[i, at.MODAL_V]
    for j in range(aw.flex[k, to.F_MODES]):
        aw.bias[k, j] = -rhs[o + j]
    modal_torque, modal_force = modal_wrench(plan, aw, k, 0.0)
    torque = add3(torque, modal_torque)
    force = add3(force, modal_force)
    own_R = row9(aw.axes, i, to.X_OWN_R)
    torque = sub3(torque, cross3(row3(aw.axes, i, to.X_OWN_P), force))
    return rotate_back(own_R, torque), rotate_back(own_R, force)
