"""How far loops are open, as the start measures it: by the constraint rows, by whole angles where those fall back.

Rows of aligned axes and of bodies that do not turn are sines of angles.  Beyond a right angle a sine falls again and
would call a joint closed that is turned over; there the angle itself is what is open.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import rotation_vector
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.row_slopes import RowSlopes
from flexmbd.multibody.plan.row_structure import ALIGNING
from flexmbd.multibody.plan.scene_matrices import constraint_slopes, constraint_values, row_sizes

FloatArray = NDArray[np.float64]


def loop_gaps(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """(m,) gaps at configuration x (nx,), over the machine's extent, or rad."""
    gaps = constraint_values(scene, work, x, np.zeros(scene.nv))[0] / row_sizes(scene)
    for rows, _, angles, _ in _far_turned(scene, work):
        gaps[rows] = angles
    return gaps


def loop_slopes(scene: CompiledScene, work: Work, x: FloatArray) -> RowSlopes:
    """Rates of ``loop_gaps`` (m,) per unit of each velocity; none of rows that hold velocities alone."""
    slopes = constraint_slopes(scene, work, x).over(row_sizes(scene))
    holds = scene.row_structure.table.holds_position
    for block, part in slopes:
        part[~holds[block.rows]] = 0.0
    forward_kinematics(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
    turned = list(_far_turned(scene, work))
    block_of = {int(row): k for k, block in enumerate(slopes.blocks) for row in block.rows} if turned else {}
    for rows, frames, _, per_spin in turned:
        block, part = slopes.blocks[block_of[int(rows[0])]], slopes.parts[block_of[int(rows[0])]]
        part[np.searchsorted(block.rows, rows)] = per_spin @ _spins(scene, work, x, frames, block.velocities)
    return slopes


def _far_turned(
    scene: CompiledScene, work: Work
) -> Iterator[tuple[NDArray[np.int64], tuple[int, int], FloatArray, FloatArray]]:
    """Of each pair of frames turned by more than a right angle against each other, as ``forward_kinematics`` left them.

    Its rows (k,), frames F and G, gaps (k,) (rad) and (k, 3) their rates per unit of G's angular velocity
    against F in F's axes.
    """
    index = scene.row_structure.table.index
    for frames, rows, aligned in scene.row_structure.turned_pairs:
        turn = relative_motion(scene.plan, work, *frames)[1]
        if len(rows) and turn[0] + turn[4] + turn[8] < 1.0:
            theta = np.array(rotation_vector(turn))
            yield rows, frames, theta[index[rows]], _rates_of_rotation_vector(theta)[index[rows]]
        if len(aligned) and turn[8] < 0.0:
            # the shortest turn of z onto z'; opposed, any about an axis across them
            R = np.reshape(turn, (3, 3))
            across = np.hypot(R[0, 2], R[1, 2])
            way = R[:2, 2] / across if across > 0.0 else np.array([1.0, 0.0])
            angle = np.arctan2(across, R[2, 2])
            part = np.searchsorted(ALIGNING, index[aligned])
            yield aligned, frames, angle * way[part], np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])[part]


def _rates_of_rotation_vector(theta: FloatArray) -> FloatArray:
    """(3, 3) its rates per unit of an angular velocity in fixed axes; of an angle off zero (Bullo and Murray 1995)."""
    cross, square = np.cross(np.eye(3), theta), float(theta @ theta)
    half = 0.5 * np.sqrt(square)
    slopes: FloatArray = np.eye(3) - 0.5 * cross + (1.0 - half / np.tan(half)) / square * cross @ cross
    return slopes


def _spins(
    scene: CompiledScene, work: Work, x: FloatArray, frames: tuple[int, int], velocities: NDArray[np.int64]
) -> FloatArray:
    """(3, n) angular velocity of the second frame row against the first, in its axes, per unit of each velocity."""
    spins = np.zeros((3, len(velocities)))
    unit, rest = np.zeros((2, scene.nv))
    for n, k in enumerate(velocities):
        unit[k] = 1.0
        forward_kinematics(scene.plan, work, x, unit, rest)
        spins[:, n] = relative_motion(scene.plan, work, *frames)[3]
        unit[k] = 0.0
    return spins
