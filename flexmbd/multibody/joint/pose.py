"""Where a joint's coordinates put its frames, outside the kernels: for the start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.joint.protocol import Joint, step_slices
from flexmbd.multibody.kernels.physics.joints import joint_motion, joint_pose
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]


def joint_state(
    joint: Joint, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """p_FG_F, R_FG, the rate of p_FG_F and w_FG_F of the joint's turned frames, at coordinates and velocities.

    A joint of constraints alone lays G on F at rest.
    """
    p, rate, spin = np.zeros((3, 3))
    R: FloatArray = np.eye(3)
    x, v = (np.array(values, dtype=np.float64) for values in (position, velocity))
    for step, (in_x, in_v) in zip(joint.steps, step_slices(joint.steps), strict=True):
        turn = z_onto(step.axis)
        pair = (step.pair.turning, len(step.pair.columns), step.pair.numbers.ravel(), 0)
        p_step, R_step = joint_pose(*pair, x, in_x.start)
        linear, angular = joint_motion(*pair, v, in_v.start)
        arm = R @ turn @ p_step
        rate += np.cross(spin, arm) + R @ turn @ linear
        p += arm
        R = R @ turn @ np.reshape(R_step, (3, 3))
        spin += R @ angular
        R = R @ turn.T
    return p, R, rate, spin
