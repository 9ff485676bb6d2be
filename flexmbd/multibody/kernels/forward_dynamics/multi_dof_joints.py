"""Joints of several coordinates in the articulated-body recursion.

S is the motion subspace of the joint, the motion of G per unit of each velocity, I the articulated inertia of the
child and D = S^T I S = L L^T.  Eliminating the joint leaves I - I S D^-1 S^T I and the bias force for the parent
(Featherstone 2008, section 7.3).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, rotate, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.algebra.spatial import load6, store6, subtract_outer, symmetric_times
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.physics.joints import joint_column


@kernel
def set_motion_subspace(S, adds, data, o, R_FG):
    """Write the motion subspace S of a joint of several coordinates: motion of G (angular, linear; G's axes).

    Its columns of a ball do not change: they stand there since ``new_articulated_work``.
    """
    for k in range(adds):
        angular, linear = joint_column(adds, data, o, k)
        linear = rotate_back(R_FG, linear)
        for i in range(3):
            S[i, k] = angular[i]
            S[3 + i, k] = linear[i]


@kernel
def eliminate_multi_dof_joint(aw, link, a, b, m, torque, force):
    """Eliminate a joint of several coordinates from the articulated inertia (a, b, m) and the bias force.

    D = S^T I S = L L^T; Q = L^-1 S^T I takes the place of U^T.
    """
    n = link[to.FREEDOMS]
    if link[to.ADDS] == 0:
        _factor_spherical(aw, link, a, b, torque)
    else:
        _factor_joint_inertia(aw, link, a, b, m, torque, force)
    if link[to.PARENT] < 0:
        return a, b, m, torque, force
    Q = aw.subspace[link[to.SUBSPACE], 1]
    joint_force = aw.force[link[to.SUBSPACE]]
    for j in range(n):
        q = load6(Q[j], 0)
        a, b, m = subtract_outer(a, b, m, q, q)
        torque = add3(torque, scale3(joint_force[j], (q[0], q[1], q[2])))
        force = add3(force, scale3(joint_force[j], (q[3], q[4], q[5])))
    return a, b, m, torque, force


@kernel
def _factor_joint_inertia(aw, link, a, b, m, torque, force):
    """L, Q and L^-1 u of a joint of several coordinates."""
    S, Q, D = aw.subspace[link[to.SUBSPACE], 0], aw.subspace[link[to.SUBSPACE], 1], aw.subspace[link[to.SUBSPACE], 2]
    joint_force = aw.force[link[to.SUBSPACE]]
    n = link[to.FREEDOMS]
    o = link[to.JOINT_V]
    for j in range(n):
        sw = (S[0, j], S[1, j], S[2, j])
        sv = (S[3, j], S[4, j], S[5, j])
        un = add3(symmetric_times(a, sw), rotate(b, sv))
        uf = add3(rotate_back(b, sw), symmetric_times(m, sv))
        store3(Q[j], 0, un)
        store3(Q[j], 3, uf)
        joint_force[j] = -aw.required[o + j]
        for i in range(3):
            joint_force[j] -= S[i, j] * torque[i] + S[3 + i, j] * force[i]
    for j in range(n):
        for k in range(j + 1):
            t = 0.0
            for i in range(6):
                t += S[i, j] * Q[k, i]
            D[j, k] = t
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
        t = joint_force[j]
        for k in range(j):
            t -= D[j, k] * joint_force[k]
        joint_force[j] = t / D[j, j]


@kernel
def _factor_spherical(aw, link, a, b, torque):
    """``_factor_joint_inertia`` for a spherical joint, unrolled: D, Q and what is left.

    S is the identity over zero, so that D = A and Q = L^-1 (A, B) = (L^T, L^-1 B).
    """
    Q, D = aw.subspace[link[to.SUBSPACE], 1], aw.subspace[link[to.SUBSPACE], 2]
    joint_force = aw.force[link[to.SUBSPACE]]
    o = link[to.JOINT_V]
    l00 = math.sqrt(a[0])
    l10 = a[1] / l00
    l20 = a[2] / l00
    l11 = math.sqrt(a[3] - l10 * l10)
    l21 = (a[4] - l20 * l10) / l11
    l22 = math.sqrt(a[5] - l20 * l20 - l21 * l21)
    D[0, 0] = l00
    D[1, 0] = l10
    D[1, 1] = l11
    D[2, 0] = l20
    D[2, 1] = l21
    D[2, 2] = l22
    r0 = scale3(1.0 / l00, (b[0], b[1], b[2]))
    r1 = scale3(1.0 / l11, sub3((b[3], b[4], b[5]), scale3(l10, r0)))
    r2 = sub3((b[6], b[7], b[8]), add3(scale3(l20, r0), scale3(l21, r1)))
    r2 = scale3(1.0 / l22, r2)
    store6(Q[0], 0, (l00, l10, l20, r0[0], r0[1], r0[2]))
    store6(Q[1], 0, (0.0, l11, l21, r1[0], r1[1], r1[2]))
    store6(Q[2], 0, (0.0, 0.0, l22, r2[0], r2[1], r2[2]))
    t0 = (-aw.required[o] - torque[0]) / l00
    t1 = (-aw.required[o + 1] - torque[1] - l10 * t0) / l11
    joint_force[0] = t0
    joint_force[1] = t1
    joint_force[2] = (-aw.required[o + 2] - torque[2] - l20 * t0 - l21 * t1) / l22


@kernel
def _accelerate_spherical(aw, link, dw, acc, out):
    """``accelerate_multi_dof_joint`` for a spherical joint, unrolled; returns the angular acceleration of G."""
    Q, D = aw.subspace[link[to.SUBSPACE], 1], aw.subspace[link[to.SUBSPACE], 2]
    joint_force = aw.force[link[to.SUBSPACE]]
    o = link[to.JOINT_V]
    t0 = joint_force[0] - dot3(load3(Q[0], 0), dw) - dot3(load3(Q[0], 3), acc)
    t1 = joint_force[1] - dot3(load3(Q[1], 0), dw) - dot3(load3(Q[1], 3), acc)
    t2 = joint_force[2] - dot3(load3(Q[2], 0), dw) - dot3(load3(Q[2], 3), acc)
    t2 = t2 / D[2, 2]
    t1 = (t1 - D[2, 1] * t2) / D[1, 1]
    t0 = (t0 - D[1, 0] * t1 - D[2, 0] * t2) / D[0, 0]
    out[o] = t0
    out[o + 1] = t1
    out[o + 2] = t2
    return add3(dw, (t0, t1, t2))


@kernel
def eliminate_joint_forces(aw, link, rhs, torque, force):
    """The wrench that a joint of several coordinates passes to its parent, ``rhs`` (nv,) acting on the joint."""
    S, Q, D = aw.subspace[link[to.SUBSPACE], 0], aw.subspace[link[to.SUBSPACE], 1], aw.subspace[link[to.SUBSPACE], 2]
    joint_force = aw.force[link[to.SUBSPACE]]
    for j in range(link[to.FREEDOMS]):
        t = rhs[link[to.JOINT_V] + j]
        for i in range(3):
            t -= S[i, j] * torque[i] + S[3 + i, j] * force[i]
        joint_force[j] = t
    for j in range(link[to.FREEDOMS]):
        t = joint_force[j]
        for k in range(j):
            t -= D[j, k] * joint_force[k]
        joint_force[j] = t / D[j, j]
        torque = add3(torque, scale3(joint_force[j], load3(Q[j], 0)))
        force = add3(force, scale3(joint_force[j], load3(Q[j], 3)))
    return torque, force


@kernel
def accelerate_multi_dof_joint(aw, link, dw, acc, out):
    """Accelerations of a joint of several coordinates, written to ``out``; those of G with them."""
    S, Q, D = aw.subspace[link[to.SUBSPACE], 0], aw.subspace[link[to.SUBSPACE], 1], aw.subspace[link[to.SUBSPACE], 2]
    n = link[to.FREEDOMS]
    if link[to.ADDS] == 0:
        return _accelerate_spherical(aw, link, dw, acc, out), acc
    joint_force = aw.force[link[to.SUBSPACE]]
    o = link[to.JOINT_V]
    for j in range(n - 1, -1, -1):
        t = joint_force[j]
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
