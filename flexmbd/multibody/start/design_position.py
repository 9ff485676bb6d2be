"""Which way a machine is put together: the way that it is drawn, with all joint coordinates at zero.

Where joints are set, the loops close in several ways as a rule: a crank at 2 rad has its slider on either side of its
axle.  The drawing says which: the joints that nobody set close it, by the nearest way, and from that assembly the set
joints move to where they were set while the others follow and keep the loops closed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.strides import stride_along
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.least_change import least_change
from flexmbd.multibody.start.loop_closing import CLOSED, close_rigidly
from flexmbd.multibody.start.loop_gaps import loop_gaps, loop_slopes
from flexmbd.multibody.start.placement import place_flying
from flexmbd.multibody.start.report import coordinate_values
from flexmbd.round_off import EPSILON

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BENT = 0.1  # of the machine's extent: what modes, which are small deformations, may have to close of the drawing
_STRIDE = 0.1  # rad, or shares of the machine's extent, that set joints are tried to move first
_ASTRAY = 0.1  # of what a stride moves: by how much more the loops may turn it aside from where the rates lead


def assemble_from_design(scene: CompiledScene, work: Work, x: FloatArray, held: Mask) -> FloatArray:
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
    for slots in scene.index.modes.values():
        led[slots.v], design[slots.x] = False, x[slots.x]
    way = np.where(led, coordinate_values(scene, x) - coordinate_values(scene, design), 0.0)
    hinges = [joint.v.start for joint in tree_joints(scene.plan) if joint.is_hinge]
    way[hinges] -= 2.0 * np.pi * np.round(way[hinges] / (2.0 * np.pi))  # whole turns of a hinge are none
    place_flying(scene, work, design, np.zeros(scene.nv))
    if not way.any():
        return x
    assembly, _ = close_rigidly(scene, work, design, led)
    left = _open(scene, work, assembly)
    if left > (_BENT if scene.index.modes else CLOSED):
        return x
    # what rigid motions cannot close in the drawing, they cannot elsewhere
    reached = _advance_set_joints(scene, work, assembly, way, led, bound=2.0 * max(CLOSED, left))
    return x if reached is None else _joined(scene, reached, x, led)


def _advance_set_joints(
    scene: CompiledScene, work: Work, x: FloatArray, way: FloatArray, led: Mask, *, bound: float
) -> FloatArray | None:
    """Where the other joints are once the set ones have gone their way (nv,) from x (nx,); None: it is barred.

    A stride goes where the loops' rates lead.  Where the loops, closed again, turn it aside by more than a little it
    is halved, for it may have come to another way of assembly; no stride passes a dead centre of the others.
    """
    size = coordinate_sizes(scene)
    whole = float(np.abs(way / size).max())
    first = min(1.0, _STRIDE / whole)  # of the way
    if not first > EPSILON:  # strides are lost in the rounding of where it leads
        return None

    def attempt(done: float, ahead: float) -> float | None:
        nonlocal x
        step = (ahead - done) * _rates(scene, work, x, way, led)
        there = np.empty_like(x)
        retract(scene.plan, x, step, there)
        reached, correction = close_rigidly(scene, work, there, led)
        aside = float(np.abs(correction / size).max() / np.abs(step / size).max())
        if not (_open(scene, work, reached) <= bound and aside <= _ASTRAY):
            return None
        x = reached
        return 2.0 if aside <= 0.25 * _ASTRAY else 1.0

    return x if stride_along(attempt, 0.0, 1.0, first=first, least=CLOSED / whole) == 1.0 else None


def _rates(scene: CompiledScene, work: Work, x: FloatArray, way: FloatArray, led: Mask) -> FloatArray:
    """(nv,) rates of all joints that keep the loops as open as they are, where set ones have those of ``way`` (nv,)."""
    slopes = loop_slopes(scene, work, x)
    size, rigid = coordinate_sizes(scene), ~led
    rigid[np.setdiff1d(np.arange(scene.nv), scene.plan.free)] = False
    for slots in scene.index.modes.values():
        rigid[slots.v] = False
    rest = np.zeros(scene.nv)
    return way + least_change(
        slopes, slopes.times(way), size=size, movable=rigid, cost=rest, before=rest, blurred=_open(scene, work, x)
    )


def _open(scene: CompiledScene, work: Work, x: FloatArray) -> float:
    return float(np.abs(loop_gaps(scene, work, x)).max(initial=0.0))


def _joined(scene: CompiledScene, x: FloatArray, other: FloatArray, mask: Mask) -> FloatArray:
    """x, but the other's coordinates of the joints that ``mask`` (nv,) names."""
    joined = x.copy()
    for joint in tree_joints(scene.plan):
        if mask[joint.v].any():
            joined[joint.x] = other[joint.x]
    return joined
