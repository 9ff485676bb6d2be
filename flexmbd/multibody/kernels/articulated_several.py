"""Joints of several coordinates, spherical and free ones, in the articulated-body recursion.

With S the motion of G per unit of each velocity, I the articulated inertia of the child and
D = S^T I S = L L^T: of inertia and wrench the joint passes on what does not move it.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels import articulated_layout as to
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.so3 import add3, load3, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.spatial import load6, subtract_outer, symmetric_times


@kernel
def set_subspace(S, freedoms, R_FG):
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


@kernel
def yield_several(aw, link, a, b, m, torque, force):
    """Eliminate a joint of several coordinates: what it passes on of inertia and asked wrench.

    D = S^T I S = L L^T; Q = L^-1 S^T I takes the place of U^T.
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
        a, b, m = subtract_outer(a, b, m, q, q)
        torque = add3(torque, scale3(left[j], (q[0], q[1], q[2])))
        force = add3(force, scale3(left[j], (q[3], q[4], q[5])))
    return a, b, m, torque, force


@kernel
def pass_several(aw, link, rhs, torque, force):
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


@kernel
def accelerate_several(aw, link, dw, acc, out):
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
