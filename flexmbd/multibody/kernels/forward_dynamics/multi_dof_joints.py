"""Joints of several coordinates or steps in the articulated-body recursion: motion subspaces, and elimination."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, rotate_back, scale3, store3
from flexmbd.multibody.kernels.algebra.spatial import load6, row3, row6, store6
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.physics.joint_elimination import (
    coordinate_acceleration,
    dot6,
    eliminate_force,
    eliminate_inertia,
    inertia_column,
)
from flexmbd.multibody.kernels.physics.joints import joint_column

# Rows of ArticulatedWork.force, of each coordinate.
FORCE, OVER = 0, 1  # u and 1/D


@kernel
def set_motion_subspace(S, adds, data, o, R_FG):
    """Write the motion subspace of a joint, row k the motion of G (angular, linear; G's axes) per unit of velocity k.

    Rows of a ball do not change: they stand there since ``new_articulated_work``.
    """
    for k in range(adds):
        angular, linear = joint_column(adds, data, o, k)
        store3(S[k], 0, angular)
        store3(S[k], 3, rotate_back(R_FG, linear))


@kernel
def _eliminate(aw, link, k, u, inertia, left, a, b, m, torque, force):
    """Eliminate coordinate k by its U, ``inertia`` D and force u, here ``left``; keep them for what follows."""
    own = aw.force[link[to.SUBSPACE]]
    over = 1.0 / inertia
    store6(aw.subspace[link[to.SUBSPACE], 1, k], 0, u)
    own[OVER, k] = over
    own[FORCE, k] = left
    a, b, m = eliminate_inertia(a, b, m, u, over)
    torque, force = eliminate_force(torque, force, u, over * left)
    return a, b, m, torque, force


@kernel
def eliminate_multi_dof_joint(aw, link, a, b, m, torque, force):
    """Eliminate a joint of several coordinates from the articulated inertia (a, b, m) and the bias force."""
    if link[to.ADDS] == 0:
        return _eliminate_ball(aw, link, a, b, m, torque, force)
    S = aw.subspace[link[to.SUBSPACE], 0]
    for k in range(link[to.FREEDOMS]):
        s = load6(S[k], 0)
        u = inertia_column(a, b, m, s)
        left = -aw.required[link[to.JOINT_V] + k] - dot6(s, torque, force)
        inertia = dot6(s, (u[0], u[1], u[2]), (u[3], u[4], u[5]))
        a, b, m, torque, force = _eliminate(aw, link, k, u, inertia, left, a, b, m, torque, force)
    return a, b, m, torque, force


@kernel
def _eliminate_ball(aw, link, a, b, m, torque, force):
    """``eliminate_multi_dof_joint`` of a ball, unrolled: S is the identity over zero, so that U is a row of (A, B)."""
    o = link[to.JOINT_V]
    u = (a[0], a[1], a[2], b[0], b[1], b[2])
    left = -aw.required[o] - torque[0]
    a, b, m, torque, force = _eliminate(aw, link, 0, u, a[0], left, a, b, m, torque, force)
    u = (a[1], a[3], a[4], b[3], b[4], b[5])
    left = -aw.required[o + 1] - torque[1]
    a, b, m, torque, force = _eliminate(aw, link, 1, u, a[3], left, a, b, m, torque, force)
    u = (a[2], a[4], a[5], b[6], b[7], b[8])
    left = -aw.required[o + 2] - torque[2]
    return _eliminate(aw, link, 2, u, a[5], left, a, b, m, torque, force)


@kernel
def eliminate_joint_forces(aw, link, rhs, torque, force):
    """The wrench that a joint of several coordinates passes to its parent, ``rhs`` (nv,) acting on the joint."""
    S, U = aw.subspace[link[to.SUBSPACE], 0], aw.subspace[link[to.SUBSPACE], 1]
    own = aw.force[link[to.SUBSPACE]]
    for k in range(link[to.FREEDOMS]):
        left = rhs[link[to.JOINT_V] + k] - dot6(load6(S[k], 0), torque, force)
        own[FORCE, k] = left
        torque, force = eliminate_force(torque, force, load6(U[k], 0), own[OVER, k] * left)
    return torque, force


@kernel
def _accelerate(aw, link, k, angular, linear, out):
    """Acceleration of coordinate k, written to ``out``, where that of the inner side is (angular, linear)."""
    own = aw.force[link[to.SUBSPACE]]
    u = load6(aw.subspace[link[to.SUBSPACE], 1, k], 0)
    t = coordinate_acceleration(u, own[OVER, k], own[FORCE, k], angular, linear)
    out[link[to.JOINT_V] + k] = t
    return t


@kernel
def accelerate_multi_dof_joint(aw, link, angular, linear, out):
    """Accelerations of a joint of several coordinates, written to ``out``; those of G with them."""
    if link[to.ADDS] == 0:
        z = angular[2] + _accelerate(aw, link, 2, angular, linear, out)
        angular = (angular[0], angular[1], z)
        y = angular[1] + _accelerate(aw, link, 1, angular, linear, out)
        angular = (angular[0], y, z)
        x = angular[0] + _accelerate(aw, link, 0, angular, linear, out)
        return (x, y, z), linear
    S = aw.subspace[link[to.SUBSPACE], 0]
    for k in range(link[to.FREEDOMS] - 1, -1, -1):
        s = load6(S[k], 0)
        t = _accelerate(aw, link, k, angular, linear, out)
        angular = add3(angular, scale3(t, (s[0], s[1], s[2])))
        linear = add3(linear, scale3(t, (s[3], s[4], s[5])))
    return angular, linear


@kernel
def size_before_joint(aw, i, a, m):
    """Sizes (kg m^2, kg) of rotation and translation of all that body i's joint carries, before it is eliminated.

    Round-off is a share of them.  (a, m): of the articulated inertia about G, this step not yet eliminated.  Inner
    links of a joint of several steps have no mass: what the steps after them took away, U D^-1 U^T each, is added
    again, for what is left there may be nothing but its round-off.  About the inner side's origin.
    """
    link, far = aw.link, math.sqrt(dot3(row3(aw.pose, i, to.P_P), row3(aw.pose, i, to.P_P)))
    linear = m[0] + m[3] + m[5]
    angular = a[0] + a[3] + a[5] + far * far * linear
    while link[i, to.FLEX] < 0 and aw.constant[i, to.C_MASS] == 0.0:
        i += 1
        r = row3(aw.constant, i, to.C_P) if link[i, to.FORM] == to.PLAIN else row3(aw.pose, i, to.P_P)
        far += math.sqrt(dot3(r, r))
        for k in range(link[i, to.FREEDOMS]):
            u, over = row6(aw.row, i, to.R_U), aw.row[i, to.R_D]
            if link[i, to.FORM] == to.MULTI_DOF:
                u, over = load6(aw.subspace[link[i, to.SUBSPACE], 1, k], 0), aw.force[link[i, to.SUBSPACE], OVER, k]
            taken = over * (u[3] * u[3] + u[4] * u[4] + u[5] * u[5])
            linear += taken
            angular += over * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) + far * far * taken
    return angular, linear
