"""How far loops are open, as the start measures it: by the constraint rows, by whole angles where those fall back.

Rows of aligned axes and of bodies that do not turn are sines of angles.  Beyond a right angle a sine falls again and
would call a joint closed that is turned over; there the angle itself is what is open.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import rotation_vector
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.row_slopes import RowSlopes
from flexmbd.multibody.plan.scene_matrices import constraint_slopes, constraint_values, row_sizes

FloatArray = NDArray[np.float64]

#: The rows that turn a body's z onto another's: x . z' and y . z', the turns about y and, backwards, about x.
_ALIGNING = (2, 5)


def loop_gaps(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """(m,) gaps at configuration x (nx,), over the machine's extent, or rad."""
    gaps = constraint_values(scene, work, x, np.zeros(scene.nv))[0] / row_sizes(scene)
    for rows, _, angles, _ in _far_turned(scene, work):
        gaps[rows] = angles
    return gaps


def loop_slopes(scene: CompiledScene, work: Work, x: FloatArray) -> RowSlopes:
    """Rates of ``loop_gaps`` (m,) per unit of each velocity; none of rows that hold velocities alone."""
    slopes = constraint_slopes(scene, work, x).over(row_sizes(scene))
    holds = constraint_rows(scene.plan).holds_position
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
    table = constraint_rows(scene.plan)
    index = table.index
    unturned = table.kind == kinds.ROW_AXIS
    aligned = (table.kind == kinds.ROW_DIRECTION) & np.isin(index, _ALIGNING)
    pairs: dict[tuple[int, int], list[int]] = {}
    for k in np.flatnonzero(unturned | aligned):
        pairs.setdefault((int(table.f[k]), int(table.g[k])), []).append(int(k))
    for frames, own in pairs.items():
        R = np.reshape(relative_motion(scene.plan, work, *frames)[1], (3, 3))
        rows = np.array([k for k in own if unturned[k]])
        if len(rows) and np.trace(R) < 1.0:
            theta = np.array(rotation_vector(tuple(R.ravel())))
            yield rows, frames, theta[index[rows]], _rates_of_rotation_vector(theta)[index[rows]]
        rows = np.array([k for k in own if aligned[k]])
        if len(rows) and R[2, 2] < 0.0:
            # the shortest turn of z onto z'; opposed, any about an axis across them
            across = np.hypot(R[0, 2], R[1, 2])
            way = R[:2, 2] / across if across > 0.0 else np.array([1.0, 0.0])
            angle = np.arctan2(across, R[2, 2])
            part = np.searchsorted(_ALIGNING, index[rows])
            yield rows, frames, angle * way[part], np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])[part]


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
