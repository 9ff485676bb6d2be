"""Three ways to turn a quaternion by a local vector, each with its own inverse differential.

A local vector u (3,) stands for the rotation vector of the turn (exponential map), for twice the
Rodrigues vector (Cayley transform), or for twice the vector part of the turn's unit quaternion
(quaternion update).  All agree up to |u|^3, so each carries a method of any order once du/dt is taken
through its own differential (Zienkiewicz, Taylor & Fox, eq. 8.26-8.29).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    left_jacobian_inverse,
    load3,
    quaternion_exp,
    quaternion_product,
    scale3,
    store3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import kernel

IntArray = NDArray[np.int64]

# Ways to turn.
EXPONENTIAL, CAYLEY, QUATERNION = range(3)


def coordinate_slots(plan: Plan) -> tuple[IntArray, IntArray]:
    """(k, 2) offsets in x and in v of coordinates that add, and of quaternions with their spins (body axes)."""
    found = []
    rows: Any = plan.tree.tolist()
    for row in rows:
        if row[at.JOINT_TURN] == kinds.TURN_BALL:
            found.append((row[at.JOINT_X] + row[at.JOINT_ADDS], row[at.JOINT_V] + row[at.JOINT_ADDS]))
    nv = len(plan.free) + len(plan.driven)
    quaternions = np.array(found, np.int64).reshape(-1, 2)
    if not found:
        return np.repeat(np.arange(nv)[:, None], 2, axis=1), quaternions
    in_x = np.setdiff1d(np.arange(nv + len(found)), (quaternions[:, :1] + np.arange(4)).ravel())
    in_v = np.setdiff1d(np.arange(nv), (quaternions[:, 1:] + np.arange(3)).ravel())
    return np.stack([in_x, in_v], axis=1).astype(np.int64), quaternions


@kernel
def local_rate(way, u, w):
    """du/dt of the local vector u where the turned frame's angular velocity is w, in its own axes."""
    if way == CAYLEY:
        return add3(w, add3(scale3(0.5, cross3(u, w)), scale3(0.25 * dot3(u, w), u)))
    if way == QUATERNION:
        scalar = math.sqrt(max(0.0, 1.0 - 0.25 * dot3(u, u)))
        return add3(scale3(scalar, w), scale3(0.5, cross3(u, w)))
    return left_jacobian_inverse(scale3(-1.0, u), w)


@kernel
def from_local_coordinates(plain, quaternions, way, x, u, out):
    """out = x moved by the local coordinates u (nv,); what is no quaternion adds, and what elements remember stays.

    ``plain``, ``quaternions``: ``coordinate_slots``.
    """
    for i in range(plain.shape[0]):
        out[plain[i, 0]] = x[plain[i, 0]] + u[plain[i, 1]]
    for i in range(quaternions.shape[0]):
        o = quaternions[i, 0]
        v = load3(u, quaternions[i, 1])
        if way == EXPONENTIAL:
            turn = quaternion_exp(v)
        else:
            scalar = 1.0 if way == CAYLEY else math.sqrt(max(0.0, 1.0 - 0.25 * dot3(v, v)))
            turn = (scalar, 0.5 * v[0], 0.5 * v[1], 0.5 * v[2])
        turned = quaternion_product((x[o], x[o + 1], x[o + 2], x[o + 3]), turn)
        out[o] = turned[0]
        store3(out, o + 1, (turned[1], turned[2], turned[3]))
    for k in range(plain.shape[0] + 4 * quaternions.shape[0], x.shape[0]):
        out[k] = x[k]


@kernel
def to_local_rates(quaternions, way, u, rates):
    """Turn the velocities ``rates`` (nv,) into rates of the local coordinates u; what adds stays."""
    for i in range(quaternions.shape[0]):
        o = quaternions[i, 1]
        store3(rates, o, local_rate(way, load3(u, o), load3(rates, o)))
