"""Which bodies of a plan can never need gyroscopic terms, decided from the joints that lead to them."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.round_off import EPSILON

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Directions that differ by no more (rad), and products of inertia that are no larger a share of the moments, are
#: those of a plane: what is left out then is below round-off.
_ROUND_OFF = 5.0 * EPSILON

_AXIS = np.array([0.0, 0.0, 1.0])


def classify_rotations(tree: IntArray, axes: Sequence[FloatArray | None], rigid: FloatArray) -> IntArray:
    """(bodies,) ``kinds.NONROTATING`` to ``FREE_ROTATION`` of each row of ``tree``; ``axes`` by ``turning_axes``."""
    return np.array([how_turning(row, axes[i], rigid[i]) for i, row in enumerate(tree)], np.int64)


def turning_axes(tree: IntArray, frames: FloatArray, frame_of: IntArray) -> list[FloatArray | None]:
    """The axis (3,), in the body, about which each link's frame turns: zeros where it never does, None if about any.

    A frame turns about one axis n of its body if its joint is a hinge about n on a parent that turns about n as well
    or not at all, or a slide on a parent that turns about n; n then is fixed in body and space.  What stands on a
    frame that deforms may turn any way.  Columns are those of ``Plan``.
    """
    axes: list[FloatArray | None] = []
    for row in tree:
        axes.append(_axis(row, frames, frame_of, axes))
    return axes


def how_turning(row: IntArray, axis: FloatArray | None, rigid: FloatArray) -> int:
    """How the link of a row of ``Plan.tree`` turns that turns about ``axis`` and has the mass integrals ``rigid``."""
    if axis is None:
        return kinds.FREE_ROTATION
    if not axis.any():
        return kinds.NONROTATING
    if row[at.FLEX] >= 0:
        return kinds.FREE_ROTATION
    return kinds.BALANCED_ROTATION if _is_balanced(rigid, axis) else kinds.PLANAR_ROTATION


def _axis(row: IntArray, frames: FloatArray, frame_of: IntArray, axes: list[FloatArray | None]) -> FloatArray | None:
    """The unit axis, in the body, about which its frame turns; zeros where it never does, None if about any."""
    f = row[at.FRAME_PARENT]
    parent = np.zeros(3) if row[at.PARENT] < 0 else axes[row[at.PARENT]]
    if parent is None or frame_of[f, at.FRAME_MODES] >= 0:
        return None
    before = _rotation(frames[f]).T @ parent  # in F
    after = _rotation(frames[row[at.FRAME_CHILD]])
    if row[at.JOINT_TURN] == kinds.TURN_NONE:
        return after @ before
    if row[at.JOINT_TURN] == kinds.TURN_ABOUT_Z and np.hypot(before[0], before[1]) <= 4.0 * _ROUND_OFF:
        return after @ _AXIS
    return None


def _rotation(frame: FloatArray) -> FloatArray:
    return frame[at.FRAME_R :].reshape(3, 3)


def _is_balanced(rigid: FloatArray, axis: FloatArray) -> bool:
    """Whether w x (J w) about the body's origin vanishes for w along ``axis``."""
    xx, xy, xz, yy, yz, zz = map(float, rigid[at.SECOND_MOMENT :])
    x, y, z = map(float, axis)
    # J = trace(S) - S with the second moment S, so that n x (J n) = -n x (S n)
    u, v, w = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
    return hypot(y * w - z * v, z * u - x * w, x * v - y * u) <= _ROUND_OFF * (xx + yy + zz)
