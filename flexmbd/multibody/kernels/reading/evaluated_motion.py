"""Readers of the motion that ``recursion.forward_kinematics`` has left in the work arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion

FloatArray = NDArray[np.float64]


class RigidMotion(NamedTuple):
    """Place and motion of a body or a frame, all in inertial axes.

    Attributes:
        p: (3,) m, its origin.
        R: (3, 3) rotation from its axes.
        v, w: (3,) velocity of its origin (m/s) and angular velocity (rad/s).
    """

    p: FloatArray
    R: FloatArray
    v: FloatArray
    w: FloatArray


def body_motion(work: Work, row: int) -> RigidMotion:
    """Of the link in ``row``."""
    body = work.body[row]
    R = body[at.B_R : at.B_R + 9].reshape(3, 3).copy()
    v, w = (R @ body[o : o + 3] for o in (at.B_V, at.B_W))
    return RigidMotion(body[at.B_P : at.B_P + 3].copy(), R, v, w)


def world_motion(plan: Plan, work: Work, frame: int) -> RigidMotion:
    """Of the frame in row ``frame`` of ``plan.frames``."""
    p, R, v, w, *_ = frame_motion(plan, work, frame)
    turn = np.array(R).reshape(3, 3)
    return RigidMotion(np.array(p), turn, turn @ v, turn @ w)


@entry_kernel
def world_places(plan, work, out):
    """The origins (frames, 3) of all frames of the plan, in inertial axes."""
    for k in range(plan.frames.shape[0]):
        p = frame_motion(plan, work, k)[0]
        for c in range(3):
            out[k, c] = p[c]


def frame_in_body(work: Work, frame: int) -> tuple[FloatArray, FloatArray]:
    """p_BF_B (3,) and R_BF (3, 3) of a frame in its deformed body."""
    row = work.frame[frame]
    return row[at.F_P : at.F_P + 3].copy(), row[at.F_R : at.F_R + 9].reshape(3, 3).copy()


def joint_turn(work: Work, row: int) -> FloatArray:
    """(3, 3) R_FG of the inboard joint of a link."""
    return work.body[row, at.B_JOINT_R : at.B_JOINT_R + 9].reshape(3, 3).copy()


def required_wrenches(work: Work) -> FloatArray:
    """(links, 6) force (N) and moment (N m) about each link's origin, in its axes, that the motion requires; a view."""
    return work.body[:, at.B_F : at.B_T + 3]


@kernel
def farthest_place(plan, work):
    """The largest component of a body's place (m) that ``work`` has."""
    place = 0.0
    for i in range(plan.tree.shape[0]):
        for c in range(3):
            place = max(place, abs(work.body[i, at.B_P + c]))
    return place
