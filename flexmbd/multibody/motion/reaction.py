"""Reactions of joints over a trajectory, for joints carried by coordinates and by constraints alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.protocol import Joint, step_turn
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.reactions import row_reactions, tree_reactions
from flexmbd.multibody.kernels.reading.tree import joint_frame, outboard
from flexmbd.multibody.motion.machine import Machine
from flexmbd.multibody.motion.moving_frames import MovingFrames

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointForces:
    """Forces on a frame's body at points of some rows, in inertial axes: row (k,), point (k, 3) m, force (k, 3) N.

    ``frame``: row of ``Plan.frames``.
    """

    body: Body
    frame: int
    row: NDArray[np.int64]
    point: FloatArray
    force: FloatArray


def reactions(
    scene: Machine,
    connection: Connection,
    t: FloatArray,
    x: FloatArray,
    v: FloatArray,
    a: FloatArray,
    multipliers: FloatArray,
    *,
    beside: Sequence[PointForces] = (),
) -> FloatArray:
    """(nt, 6) force (N) and moment (N m) that the parent exerts on the child through a joint.

    The moment is about the origin of the child's frame, both in that frame's axes.

    ``beside``: forces that act beside those of the scene, as the impulses of hard contacts over their steps, which the
    multipliers know.

    Raises:
        SceneError: the joint is not of this scene, or a user's function of force failed, which is asked anew.
    """
    refuse_other(connection, Connection, "what is asked for", wanted="a joint, as scene.connect(...) gives it")
    out: FloatArray = np.zeros((len(t), 6))
    scene.forget_failure()
    series = (t, x, v, a, multipliers, np.zeros(scene.nv), out)
    work = new_work(scene.plan)
    rows = scene.index.links.get(connection)
    turn = connection.joint.turn
    if rows is not None:
        branch = next(b for b in scene.topology.branches if b.connection is connection)
        outer = scene.index.bodies[branch.outer.body]
        # the last step ends on the child's frame, or begins there where the branch is reversed
        step = len(rows) - 1
        f = joint_frame(scene.plan, rows[step], on_parent=branch.reversed)
        tree_reactions(scene.plan, work, outer, f, *series)
        turn = turn @ step_turn(connection.joint.steps[step], branch.reversed)
        sign = -1.0 if branch.reversed else 1.0
        out *= sign
    elif connection in scene.index.closures:
        f, g = scene.index.closures[connection]
        row_reactions(scene.plan, work, f, g, *series)
    else:
        raise SceneError(f"joint {connection.name!r} has no reaction in this trajectory; it is of another scene")
    scene.refuse_failed(work)
    found = np.hstack([out[:, :3] @ turn.T, out[:, 3:] @ turn.T])
    if rows is not None and scene.wrench_sources:
        found -= sign * _given_wrenches(scene, connection.child, outer, t, x, v)
    if rows is not None and beside:
        found -= sign * _point_wrenches(scene, connection.child, outer, x, beside)
    return found


def outboard_load(scene: Machine, connection: Connection, x: FloatArray, forces: Sequence[PointForces]) -> FloatArray:
    """(nt, 6) what forces do to all that a joint of the tree carries, about its child's frame and in its axes.

    Of the child's side, or the opposite of what they do on the other side, where the tree goes from child to parent.
    """
    branch = next(b for b in scene.topology.branches if b.connection is connection)
    sign = -1.0 if branch.reversed else 1.0
    outer = scene.index.bodies[branch.outer.body]
    return sign * _point_wrenches(scene, connection.child, outer, x, forces)


def _point_wrenches(
    scene: Machine, frame: Frame, root: int, x: FloatArray, forces: Sequence[PointForces]
) -> FloatArray:
    """(nt, 6) what forces do to body ``root`` and all outboard of it, about a frame and in its axes."""
    carried = outboard(scene.plan, root)
    frames, rest = MovingFrames(scene), np.zeros(scene.nv)
    sums: FloatArray = np.zeros((len(x), 6))
    for one in forces:
        if scene.index.bodies[one.body] not in carried:
            continue
        for k in np.unique(one.row):
            here = one.row == k
            frames.move(x[k], rest, rest)
            at = frames.motion(frame)
            force = one.force[here].sum(axis=0)
            moment = np.cross(one.point[here] - at.p, one.force[here]).sum(axis=0)
            sums[k] += np.concatenate([at.R.T @ force, at.R.T @ moment])
    return sums


def _given_wrenches(
    scene: Machine, frame: Frame, root: int, t: FloatArray, x: FloatArray, v: FloatArray
) -> FloatArray:
    """(nt, 6) what ``scene.wrench_sources`` do to body ``root`` and all outboard of it, about a frame and in its axes.

    The plan has them as generalised forces alone, which do not determine the joints' reactions.
    """
    carried = outboard(scene.plan, root)
    frames, rest = MovingFrames(scene), np.zeros(scene.nv)
    sums: FloatArray = np.zeros((len(t), 6))
    for k in range(len(t)):
        frames.move(x[k], v[k], rest)
        here = frames.motion(frame)
        for source in scene.wrench_sources:
            for place, force, torque in source.wrenches(float(t[k]), x[k], v[k]):
                if scene.index.bodies[place.body] in carried:
                    push: FloatArray = np.asarray(force, dtype=np.float64)
                    arm: FloatArray = frames.motion(place).p - here.p
                    moment = np.asarray(torque, dtype=np.float64) + np.cross(arm, push)
                    sums[k] += np.concatenate([here.R.T @ push, here.R.T @ moment])
    return sums


def coordinate_force(joint: Joint, reaction: FloatArray) -> FloatArray:
    """(nt,) what reactions (nt, 6) do on the coordinate of a joint that has only one (N m or N)."""
    (step,) = joint.steps
    axis = (joint.turn @ step_turn(step, False))[:, 2]
    turn, _, _, slide = step.pair.numbers[0]
    return turn * (reaction[:, 3:] @ axis) + slide * (reaction[:, :3] @ axis)
