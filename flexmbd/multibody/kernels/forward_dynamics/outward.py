"""The outward passes of the articulated-body recursion: velocities first, accelerations last."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, cross3, rotate, rotate_back, scale3, sub3
from flexmbd.multibody.kernels.algebra.spatial import put3, put9, row3, row6, row9, turn
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.flexible import accelerate_modes, deform_interface, prepare_body
from flexmbd.multibody.kernels.forward_dynamics.multi_dof_joints import accelerate_multi_dof_joint, set_motion_subspace
from flexmbd.multibody.kernels.physics.joint_elimination import coordinate_acceleration
from flexmbd.multibody.kernels.physics.joints import joint_motion, joint_pose


@kernel
def propagate_velocities(plan, aw, x, v, a):
    """Velocities and bias accelerations of all bodies, outwards."""
    link = aw.link
    constant = aw.constant
    row = aw.row
    w = (0.0, 0.0, 0.0)
    for i in range(link.shape[0]):
        parent = link[i, to.PARENT]
        if parent < 0:
            w = (0.0, 0.0, 0.0)
        elif parent != i - 1:
            w = row3(row, parent, to.R_SPIN)
        if link[i, to.FORM] == to.PLAIN:
            angle = x[link[i, to.JOINT_X]]
            c = math.cos(angle)
            s = math.sin(angle)
            bias = turn(c, -s, cross3(w, cross3(w, row3(constant, i, to.C_P))))
            w = turn(c, -s, w)
            w = (w[0], w[1], w[2] + v[link[i, to.JOINT_V]])
            row[i, to.R_COS] = c
            row[i, to.R_SIN] = s
            put3(row, i, to.R_SPIN, w)
            put3(row, i, to.R_BIAS, bias)
        else:
            w = _propagate_velocity(plan, aw, i, x, v, a, w)


@kernel
def _propagate_velocity(plan, aw, i, x, v, a, w):  # noqa: PLR0915  one step
    """The step outwards for any form: return the body's angular velocity in its frame of reference."""
    link = aw.link
    constant = aw.constant
    row = aw.row
    pose = aw.pose
    spin = constant[i, to.C_TURN]
    slide = constant[i, to.C_SHIFT]
    position = rate = rate2 = 0.0
    if spin != 0.0 or slide != 0.0:
        position = x[link[i, to.JOINT_X]]
        rate = v[link[i, to.JOINT_V]]
        if link[i, to.FREEDOMS] == 0:
            rate2 = a[link[i, to.JOINT_V]]
    c = 1.0
    s = 0.0
    if spin != 0.0:
        c = math.cos(spin * position)
        s = math.sin(spin * position)
    p_dot = (0.0, 0.0, slide * rate)
    relative = (0.0, 0.0, spin * rate)
    r = row3(constant, i, to.C_P)
    if link[i, to.FORM] <= to.ALIGNED:
        r = (r[0], r[1], r[2] + slide * position)
        bias = turn(c, -s, cross3(w, add3(cross3(w, r), scale3(2.0, p_dot))))
        w = turn(c, -s, w)
    else:
        R = row9(aw.axes, i, to.X_R)
        slot = link[i, to.INTERFACE]
        if slot >= 0:
            w = deform_interface(plan, aw, slot, x, v, w)
            R = row9(aw.interface, slot, to.I_R)
            r = (0.0, 0.0, 0.0)
        p = (0.0, 0.0, slide * position)
        R_FG = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
        if link[i, to.FORM] == to.MULTI_DOF:
            turns = plan.tree[i, at.JOINT_TURN]
            adds = link[i, to.ADDS]
            o = plan.tree[i, at.JOINT_DATA]
            p, R_FG = joint_pose(turns, adds, plan.data, o, x, link[i, to.JOINT_X])
            p_dot, relative = joint_motion(turns, adds, plan.data, o, v, link[i, to.JOINT_V])
            set_motion_subspace(aw.subspace[link[i, to.SUBSPACE], 0], adds, plan.data, o, R_FG)
        R_AG = compose(R, R_FG)
        r = add3(r, rotate(R, p))
        bias = rotate_back(R_AG, cross3(w, add3(cross3(w, r), scale3(2.0, rotate(R, p_dot)))))
        w = rotate_back(R_AG, w)
        put9(pose, i, to.P_R, R_AG)
    put3(pose, i, to.P_P, r)
    put3(pose, i, to.P_BIAS, add3(cross3(w, relative), (0.0, 0.0, spin * rate2)))
    w = add3(w, relative)
    row[i, to.R_COS] = c
    row[i, to.R_SIN] = s
    put3(row, i, to.R_BIAS, (bias[0], bias[1], bias[2] + slide * rate2))
    if link[i, to.FLEX] >= 0:
        w = rotate(row9(aw.axes, i, to.X_OWN_R), w)
        own = row3(aw.axes, i, to.X_OWN_P)
        put3(pose, i, to.P_OWN_BIAS, scale3(-1.0, cross3(w, cross3(w, own))))
        prepare_body(plan, aw, link[i, to.FLEX], x, v, w)
    put3(row, i, to.R_SPIN, w)
    for k in range(to.N_GATHERED):
        aw.gathered[i, k] = 0.0
    return w


@kernel
def propagate_accelerations(plan, aw, start, v, share, out):
    """Accelerations of all bodies, outwards from the ground's (``start``); ``out`` (nv,) gets the coordinates'.

    ``share``: of the bias accelerations that ``propagate_velocities`` left for v, one for forward dynamics, else zero.
    """
    link = aw.link
    constant = aw.constant
    row = aw.row
    dw = (0.0, 0.0, 0.0)
    acc = start
    for i in range(link.shape[0]):
        parent = link[i, to.PARENT]
        if parent < 0:
            dw = (0.0, 0.0, 0.0)
            acc = start
        elif parent != i - 1:
            dw = row3(aw.pose, parent, to.P_ANGULAR)
            acc = row3(aw.pose, parent, to.P_LINEAR)
        if link[i, to.FORM] == to.PLAIN:
            c = row[i, to.R_COS]
            s = row[i, to.R_SIN]
            o = link[i, to.JOINT_V]
            acc = turn(c, -s, add3(acc, cross3(dw, row3(constant, i, to.C_P))))
            dw = turn(c, -s, dw)
            rate = share * v[o]
            acc = add3(acc, scale3(share, row3(row, i, to.R_BIAS)))
            dw = (dw[0] + row[i, to.R_SPIN + 1] * rate, dw[1] - row[i, to.R_SPIN] * rate, dw[2])
            t = coordinate_acceleration(row6(row, i, to.R_U), row[i, to.R_D], row[i, to.R_FORCE], dw, acc)
            out[o] = t
            dw = (dw[0], dw[1], dw[2] + t)
        else:
            dw, acc = _propagate_acceleration(plan, aw, i, dw, acc, share, out)


@kernel
def _propagate_acceleration(plan, aw, i, dw, acc, share, out):
    """The step outwards for any form: return the accelerations of the body's origin."""
    link = aw.link
    row = aw.row
    pose = aw.pose
    if link[i, to.INTERFACE] >= 0:
        dw = row3(aw.interface, link[i, to.INTERFACE], to.I_ANGULAR)
        acc = row3(aw.interface, link[i, to.INTERFACE], to.I_LINEAR)
    acc = add3(acc, cross3(dw, row3(pose, i, to.P_P)))
    if link[i, to.FORM] <= to.ALIGNED:
        c = row[i, to.R_COS]
        s = row[i, to.R_SIN]
        acc = turn(c, -s, acc)
        dw = turn(c, -s, dw)
    else:
        R_AG = row9(pose, i, to.P_R)
        acc = rotate_back(R_AG, acc)
        dw = rotate_back(R_AG, dw)
    dw = add3(dw, scale3(share, row3(pose, i, to.P_BIAS)))
    acc = add3(acc, scale3(share, row3(row, i, to.R_BIAS)))
    if link[i, to.FREEDOMS] > 0:
        o = link[i, to.JOINT_V]
        if link[i, to.FORM] == to.MULTI_DOF:
            dw, acc = accelerate_multi_dof_joint(aw, link[i], dw, acc, out)
        else:
            t = coordinate_acceleration(row6(row, i, to.R_U), row[i, to.R_D], row[i, to.R_FORCE], dw, acc)
            out[o] = t
            dw = (dw[0], dw[1], dw[2] + aw.constant[i, to.C_TURN] * t)
            acc = (acc[0], acc[1], acc[2] + aw.constant[i, to.C_SHIFT] * t)
    if link[i, to.FLEX] >= 0:
        own_R = row9(aw.axes, i, to.X_OWN_R)
        dw = rotate(own_R, dw)
        acc = sub3(rotate(own_R, acc), cross3(dw, row3(aw.axes, i, to.X_OWN_P)))
        acc = add3(acc, scale3(share, row3(pose, i, to.P_OWN_BIAS)))
        accelerate_modes(plan, aw, link[i, to.FLEX], dw, acc, share, out)
    put3(pose, i, to.P_ANGULAR, dw)
    put3(pose, i, to.P_LINEAR, acc)
    return dw, acc
