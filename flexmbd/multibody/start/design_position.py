"""Which way a machine is put together: the way that it is in its design position, all joint coordinates at zero.

Where joints are set, the loops close in several ways as a rule: a crank at 2 rad has its slider on either side of its
axle.  If the design position is an assembly, but for what less than a stride closes (centres of meshed bores, figures
of two digits), the set joints move from there to where they were set, the others follow and keep the loops closed, and
so the machine comes to be as its drawing turned that far.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import layout as at
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.loop_closing import CLOSED, close_rigidly
from flexmbd.multibody.start.loop_gaps import loop_gaps
from flexmbd.multibody.start.placement import place_flying
from flexmbd.multibody.start.report import coordinate_values

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STRIDE = 0.1  # rad, or shares of the machine's extent, that set joints move at a time


def led_from_design(scene: CompiledScene, work: Work, x: FloatArray, held: Mask) -> FloatArray:
    """The configuration (nx,) to which the set joints lead from the design position; x where there is no such way.

    Args:
        scene: the scene.
        work: scratch; ``work.time`` holds the functions of time at the start.
        x: (nx,) wanted configuration, all joints where they were set, or where motions have them.
        held: (nv,) tangent directions of coordinates set by the user.
    """
    if not len(scene.plan.rows) or scene.interiors is not None or _open(scene, work, x) <= CLOSED:
        return x  # bodies with history are put where their own interior has them
    led = np.ones(scene.nv, bool)
    led[scene.plan.free] = False
    led |= held
    design = _joined(scene, scene.start.copy(), x, ~led)
    for slots in scene.modal_slots.values():
        led[slots.v], design[slots.x] = False, x[slots.x]
    way = np.where(led, coordinate_values(scene, x) - coordinate_values(scene, design), 0.0)
    hinges = scene.plan.tree[scene.plan.tree[:, at.JOINT] == kinds.REVOLUTE, at.JOINT_V].astype(int)
    way[hinges] -= 2.0 * np.pi * np.round(way[hinges] / (2.0 * np.pi))  # whole turns of a hinge are none
    place_flying(scene, work, design, np.zeros(scene.nv))
    if not way.any():
        return x
    reached = design
    if _open(scene, work, design) > CLOSED:
        reached = close_rigidly(scene, work, design, led)
        moved = coordinate_values(scene, reached) - coordinate_values(scene, design)
        if np.abs(moved / coordinate_sizes(scene)).max() > _STRIDE:
            return x
    left = _open(scene, work, reached)  # what rigid motions cannot close in the drawing, they cannot elsewhere
    if left > _STRIDE:
        return x
    strides = int(np.ceil(np.abs(way / coordinate_sizes(scene)).max() / _STRIDE))
    for _ in range(strides):
        ahead = np.empty_like(x)
        retract(scene.plan, reached, way / strides, ahead)
        reached = close_rigidly(scene, work, ahead, led)
        if _open(scene, work, reached) > 2.0 * max(CLOSED, left):
            return x
    return _joined(scene, reached, x, led)


def _open(scene: CompiledScene, work: Work, x: FloatArray) -> float:
    return float(np.abs(loop_gaps(scene, work, x)).max(initial=0.0))


def _joined(scene: CompiledScene, x: FloatArray, other: FloatArray, mask: Mask) -> FloatArray:
    """x, but the other's coordinates of the joints that ``mask`` (nv,) names."""
    joined = x.copy()
    for row in scene.plan.tree:
        i, k = int(row[at.JOINT_X]), int(row[at.JOINT_V])
        n = {kinds.FREE: 7, kinds.SPHERICAL: 4, kinds.FIXED: 0}.get(int(row[at.JOINT]), 1)
        if n and mask[k]:
            joined[i : i + n] = other[i : i + n]
    return joined
