"""Rigid bodies that fly by themselves: their angular momentum in the inertial frame through a step, to round-off.

In half a step's turn by h/2 w the body's own momentum I w turns back by as much: from the step's begin to its middle,
where impulses act, that is explicit, and from there to the end, where w is that of the end, it is solved for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import (
    cross3,
    dot3,
    exp_rotation,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.row_blocks import row_bodies
from flexmbd.round_off import EQUAL, ROUND_OFF

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class FreeSpins(ArrayStruct):
    """Of k such bodies.

    Attributes:
        first: (k,) where each one's angular velocity begins in v.
        inertia, inverse: (k, 9) kg m^2 about the centre of mass, in the axes of the angular velocity.
    """

    first: IntArray
    inertia: FloatArray
    inverse: FloatArray


def new_free_spins(plan: Plan) -> FreeSpins:
    """Those of a plan: on a free joint of the ground at their centre of mass, without children, modes and loops."""
    tree: Any = plan.tree.tolist()
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    held = {row[at.PARENT] for row in tree} | {b for row in plan.rows for b in row_bodies(plan, row)}
    first, inertias = [], []
    for b, row in enumerate(tree):
        free = row[at.JOINT_TURN] == kinds.TURN_BALL and row[at.JOINT_ADDS] == 3
        if row[at.PARENT] >= 0 or not free or row[at.FLEX] >= 0 or b in held or row[at.JOINT_V] in driven:
            continue
        mass, moment, second = _about(plan.rigid[b], plan.frames[row[at.FRAME_CHILD]])
        if np.linalg.norm(moment) > EQUAL * np.sqrt(mass * np.trace(second)):
            continue
        inertia = np.trace(second) * np.eye(3) - second
        if np.linalg.eigvalsh(inertia)[0] > EQUAL * np.trace(inertia):
            first.append(row[at.JOINT_V] + 3)
            inertias.append(inertia)
    own = np.array(inertias).reshape(-1, 3, 3)
    return FreeSpins(np.array(first, np.int64), own.reshape(-1, 9), np.linalg.inv(own).reshape(-1, 9))


def _about(rigid: FloatArray, frame: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Mass, first and second moments of a row of ``Plan.rigid`` about a frame and in its axes."""
    p, R = frame[at.FRAME_P : at.FRAME_P + 3], frame[at.FRAME_R : at.FRAME_R + 9].reshape(3, 3)
    mass, moment = rigid[at.MASS], rigid[at.FIRST_MOMENT : at.FIRST_MOMENT + 3]
    second = rigid[at.SECOND_MOMENT + np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]
    second = second - np.outer(moment, p) - np.outer(p, moment) + mass * np.outer(p, p)
    return float(mass), R.T @ (moment - mass * p), R.T @ second @ R


@kernel
def to_middle(spins, h, v):
    """Take the angular velocities in v from a step's begin to what their momenta are in the middle."""
    for i in range(spins.first.shape[0]):
        o = spins.first[i]
        w = load3(v, o)
        momentum = rotate(load9(spins.inertia[i], 0), w)
        turned = rotate_back(exp_rotation(scale3(0.5 * h, w)), momentum)
        store3(v, o, rotate(load9(spins.inverse[i], 0), turned))


@kernel
def without_gyration(spins, v, a):
    """Add to the accelerations in a what the bodies' own gyroscopic moments at v took from them."""
    for i in range(spins.first.shape[0]):
        o = spins.first[i]
        w = load3(v, o)
        moment = cross3(w, rotate(load9(spins.inertia[i], 0), w))
        more = rotate(load9(spins.inverse[i], 0), moment)
        store3(a, o, sub3(load3(a, o), scale3(-1.0, more)))


@kernel
def to_end(spins, h, v):
    """Take the angular velocities in v from the middle of a step to its end; False where h turns too far for it."""
    for i in range(spins.first.shape[0]):
        o = spins.first[i]
        w = load3(v, o)
        momentum, before = rotate(load9(spins.inertia[i], 0), w), np.inf
        for _ in range(_ITERATIONS):
            turned = rotate_back(exp_rotation(scale3(0.5 * h, w)), momentum)
            found = rotate(load9(spins.inverse[i], 0), turned)
            step = sub3(found, w)
            change, size = dot3(step, step), dot3(found, found)
            w = found
            if change <= ROUND_OFF * ROUND_OFF * size or not change < before:
                break
            before = change
        if not change <= EQUAL * EQUAL * size:
            return False
        store3(v, o, w)
    return True
