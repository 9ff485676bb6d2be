"""What a unit displacement or rotation of a frame does to the nodes on it, at a step's end or at rest."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]

#: Of a frame's unit motion: displacement and acceleration of the interface nodes (n, 3), its rotation, shift (3,).
UnitMotion: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def unit_motion(
    bonds: BondedNodes, arms: FloatArray, motion: FrameMotion, j: int, per_x: float, per_v: float
) -> UnitMotion:
    """What a unit displacement or rotation of a frame does to its nodes.

    Returns:
        (interface nodes, 3) their displacement and acceleration; (3,) the frame's rotation and shift.
    """
    k, axis = divmod(j, 6)
    mine = bonds.frame_of == k
    dx, da = np.zeros((2, len(arms), 3))
    shift, turn = np.zeros((2, 3))
    if axis < 3:
        shift[axis] = 1.0
        dx[mine], da[mine] = shift, shift / per_x
        return dx, da, turn, shift
    turn[axis - 3] = 1.0
    arm, w, alpha = arms[mine], motion.w[k], motion.alpha[k]
    moved, dw = crossed(turn, arm), per_v / per_x * turn
    dx[mine] = moved
    if bonds.averaged[mine].any():
        # they go by the scheme as all free nodes do
        da[mine] = moved / per_x
        return dx, da, turn, shift
    da[mine] = (
        moved / per_x
        + crossed(alpha, moved)
        + crossed(dw, crossed(w, arm))
        + crossed(w, crossed(dw, arm))
        + crossed(w, crossed(w, moved))
    )
    return dx, da, turn, shift


def crossed(w: FloatArray, vectors: FloatArray) -> FloatArray:
    """w x each of vectors (n, 3); numpy's own takes several times as long."""
    return np.asarray(vectors @ np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]]))
