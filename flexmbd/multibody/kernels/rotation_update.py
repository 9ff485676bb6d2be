"""Three ways to turn a quaternion by a local vector, each with its own inverse differential.

A local vector u (3,) stands for the rotation vector of the turn (exponential map), for twice the
Rodrigues vector (Cayley transform), or for twice the vector part of the turn's unit quaternion
(quaternion update).  All agree up to |u|^3, so each carries a method of any order once du/dt is taken
through its own differential (theory: seed 2 eq. 8.26-8.29 and the note on Cayley after it).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Plan
from flexmbd.multibody.kernels.so3 import (
    add3,
    cross3,
    dot3,
    left_jacobian_inverse,
    load3,
    quaternion_product,
    scale3,
    store3,
)

# Ways to turn.
EXPONENTIAL, CAYLEY, QUATERNION = range(3)


def quaternion_slots(plan: Plan) -> NDArray[np.int64]:
    """(k, 2) offsets in x and in v of each quaternion and of its angular velocity (body axes)."""
    found = []
    for row in plan.tree:
        if row[at.JOINT] == at.SPHERICAL:
            found.append((row[at.JOINT_X], row[at.JOINT_V]))
        elif row[at.JOINT] == at.FREE:
            found.append((row[at.JOINT_X] + 3, row[at.JOINT_V] + 3))
    return np.array(found, np.int64).reshape(-1, 2)


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
def move(plan, quaternions, way, x, u, out):
    """out = x moved by the local coordinates u (nv,); what is no quaternion adds."""
    retract(plan, x, u, out)
    if way == EXPONENTIAL:
        return
    for i in range(quaternions.shape[0]):
        o = quaternions[i, 0]
        turn = load3(u, quaternions[i, 1])
        scalar = 1.0
        if way == QUATERNION:
            scalar = math.sqrt(max(0.0, 1.0 - 0.25 * dot3(turn, turn)))
        turned = quaternion_product(
            (x[o], x[o + 1], x[o + 2], x[o + 3]), (scalar, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
        )
        out[o] = turned[0]
        store3(out, o + 1, (turned[1], turned[2], turned[3]))


@kernel
def local_rates(quaternions, way, u, v, out):
    """out = du/dt of the local coordinates u for velocities v."""
    for k in range(v.shape[0]):
        out[k] = v[k]
    for i in range(quaternions.shape[0]):
        o = quaternions[i, 1]
        store3(out, o, local_rate(way, load3(u, o), load3(v, o)))
