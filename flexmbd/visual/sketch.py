"""Symbols for bodies without a shape or surface, and for joints.

A body is drawn as sticks between the frames that joints hold it by and a ball at its centre
of mass; a revolute joint as a pin, a prismatic one as a rail and a sliding block, a spherical one
as a ball; what is fixed to the ground is grey.  All are scaled by the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame, interface_frame
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.multibody.bodies.solid import unit_ball, unit_tube
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.visual.palette import GROUND, JOINT
from flexmbd.visual.part import RigidPart, body_pose, frame_axes, pose_matrix
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.skin import surface_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Of the axes of a frame: x, y and z.
AXES = ("#c44e52", "#55a868", "#4c72b0")

_SHARE = 0.009  # of the scene's extent that is a stick's radius


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame on its way: p (nt, 3) m and R (nt, 3, 3), both in the inertial frame."""

    p: FloatArray
    R: FloatArray


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A machine's frames at the instants of a picture.

    Attributes:
        joints: those that hold something.
        frames: of each body, those that joints hold and all interfaces.
        poses: of all frames.
        bodies: (nt, 4, 4) of each body's axes.
        coms: (nt, 3) m, the centre of mass of each body.
        places: (k, 3) m, where frames and centres of mass are met over all instants.
    """

    joints: list[Connection]
    frames: IdentityMap[Body, list[Frame]]
    poses: IdentityMap[Frame, Pose]
    bodies: IdentityMap[Body, FloatArray]
    coms: IdentityMap[Body, FloatArray]
    places: FloatArray


def skeleton(motion: RecordedMotion, times: FloatArray) -> Skeleton:
    """The frames of a machine at ``times`` (nt,) s. Not collective."""
    joints = _joints(motion)
    frames = _frames(motion, joints)
    poses = IdentityMap(
        (f, Pose(motion.position(f, t=times), frame_axes(motion, f, times))) for held in frames.values() for f in held
    )
    bodies = IdentityMap((body, body_pose(motion, body, times)) for body in motion.bodies.values())
    coms = IdentityMap(
        (body, pose[:, :3, 3] + pose[:, :3, :3] @ (body.moments()[0] / body.mass)) for body, pose in bodies.items()
    )
    met = [*(pose.p for pose in poses.values()), *coms.values()]
    places = np.concatenate(met) if met else np.zeros((1, 3))
    return Skeleton(joints, frames, poses, bodies, coms, places)


def stick_radius(places: FloatArray) -> float:
    """m, by the extent of what is drawn (k, 3)."""
    return _SHARE * (float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0)


def symbols(
    motion: RecordedMotion,
    bones: Skeleton,
    size: float,
    *,
    colours: Mapping[str, str],
    shown: Sequence[Body],
    frames: bool = False,
) -> Iterator[RigidPart]:
    """The symbols of bodies that are not ``shown`` otherwise, and of joints where one of their bodies is not.

    Args:
        motion: of the machine.
        bones: its frames.
        size: m, the radius of a stick.
        colours: of the bodies, by name.
        shown: bodies that have shapes or surfaces.
        frames: whether the axes of all frames are drawn.
    """
    heaviest = max((body.mass for body in motion.bodies.values()), default=0.0)
    covered: IdentityMap[Body, None] = IdentityMap((body, None) for body in shown)
    for name, body in motion.bodies.items():
        if body in covered:
            continue
        com = bones.coms[body]
        tops = [bones.poses[f].p for f in bones.frames.get(body, ())]
        for a, b in _sticks(tops, com, size):
            yield cylinder(a, b, size, colours[name], name)
        radius = 2.4 * size * max(0.5, (body.mass / heaviest) ** (1 / 3))
        yield ball(com, radius, colours[name], name)
    for joint in bones.joints:
        yield from _joint_symbols(joint, bones.poses, size, colours, covered)
    if frames:
        for frame, pose in bones.poses.items():
            for axis, colour in enumerate(AXES):
                yield cylinder(pose.p, pose.p + 8.0 * size * pose.R[:, :, axis], 0.35 * size, colour, frame.label)


def cylinder(a: FloatArray, b: FloatArray, radius: float, colour: str, label: str) -> RigidPart:
    """A round stick from a to b, each (nt, 3) m."""
    z = b - a
    length = np.linalg.norm(z, axis=1, keepdims=True)
    z = z / np.where(length > 0.0, length, 1.0)
    helper = np.eye(3)[np.argmin(np.abs(z), axis=1)]
    x = np.cross(helper, z)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    x = x / np.where(norm > 0.0, norm, 1.0)
    columns = np.stack([radius * x, radius * np.cross(z, x), length * z], axis=2)
    return RigidPart(label, colour, *unit_cylinder(), pose_matrix(a, columns))


def ball(p: FloatArray, radius: float, colour: str, label: str) -> RigidPart:
    """A ball at p (nt, 3) m."""
    pose = pose_matrix(p, np.broadcast_to(radius * np.eye(3), (len(p), 3, 3)))
    return RigidPart(label, colour, *small_ball(), pose)


def box(pose: Pose, half: Sequence[float], colour: str, label: str) -> RigidPart:
    """A box with half sides ``half`` (m) along the axes of a frame."""
    return RigidPart(label, colour, *unit_box(), pose_matrix(pose.p, pose.R * np.asarray(half)))


@cache
def unit_cylinder() -> tuple[FloatArray, IntArray]:
    """Points and triangles, of radius 1, from z = 0 to 1; fewer than shapes have, for there are many."""
    x, triangles = unit_tube(sides=20)
    return x + np.array([0.0, 0.0, 0.5]), triangles


@cache
def small_ball() -> tuple[FloatArray, IntArray]:
    """Points and triangles, of radius 1."""
    return unit_ball(10, 20)


@cache
def unit_box() -> tuple[FloatArray, IntArray]:
    """Points and triangles, of half sides 1."""
    box = Shape.box((2.0, 2.0, 2.0))
    return box.points, box.triangles


def _joints(trajectory: RecordedMotion) -> list[Connection]:
    """Joints that hold something: those of the tree, then those that close loops."""
    topology = trajectory.scene.topology
    along = [b.connection for b in topology.branches if b.connection is not None]
    return [c for c in (*along, *topology.closures) if c.rows]


def _frames(trajectory: RecordedMotion, joints: Sequence[Connection]) -> IdentityMap[Body, list[Frame]]:
    """The frames of each body: those of joints, and all interfaces."""
    frames: IdentityMap[Body, list[Frame]] = IdentityMap()
    for joint in joints:
        for frame in (joint.parent, joint.child):
            frames.setdefault(frame.body, []).append(frame)
    for body in trajectory.bodies.values():
        record = body.reduced()
        if record is not None:
            frames.setdefault(body, []).extend(
                interface_frame(body, record, interface, interface.name) for interface in record.interfaces
            )
    return frames


def _sticks(
    tops: Sequence[FloatArray], com: FloatArray, size: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Ends of a body's sticks: between two frames, else from each frame to the frames' middle.

    A centre of mass that lies beside them gets a stick of its own.
    """
    apart: list[FloatArray] = []
    for top in tops:
        if all(np.linalg.norm(top[0] - other[0]) > 0.1 * size for other in apart):
            apart.append(top)
    middle = sum(apart[1:], start=apart[0]) / len(apart) if apart else com
    if len(apart) == 2:
        yield apart[0], apart[1]
    elif len(apart) > 2:
        for top in apart:
            yield top, middle
    foot = middle
    if len(apart) == 2:
        a, d = apart[0][0], apart[1][0] - apart[0][0]
        s = float(np.clip((com[0] - a) @ d / (d @ d), 0.0, 1.0))
        foot = (1.0 - s) * apart[0] + s * apart[1]
    if np.linalg.norm(com[0] - foot[0]) > size:
        yield foot, com


def _joint_symbols(
    joint: Connection,
    poses: IdentityMap[Frame, Pose],
    size: float,
    colours: Mapping[str, str],
    covered: IdentityMap[Body, None],
) -> Iterator[RigidPart]:
    ends = [joint.parent, joint.child]
    if ends[1].body.name not in colours:  # what is on the ground carries the other
        ends.reverse()
    grounded = ends[0].body.name not in colours
    if all(f.body.shape is not None or f.body.name not in colours for f in ends):
        return  # whoever gave shapes to both has drawn what holds them
    steps = joint.joint.steps
    turn = joint.joint.turn
    parent, child = (Pose(poses[f].p, poses[f].R @ turn) for f in ends)
    pair = steps[0].pair if len(steps) == 1 else None
    single = pair is not None and len(pair.angular) == 1
    axis = child.R[:, :, 2]
    if pair is not None and single and pair.turning == kinds.TURN_ABOUT_Z:
        reach = 2.7 * size + max(_thickness(f, turn[:, 2]) for f in ends)
        yield cylinder(child.p - reach * axis, child.p + reach * axis, 1.1 * size, JOINT, joint.name)
        if grounded:
            depth = 0.5 * size * axis
            yield cylinder(child.p - depth, child.p + depth, 2.8 * size, GROUND, joint.name)
    elif single:
        if ends[1].body not in covered:
            half = (2.2 * size, 2.2 * size, 3.6 * size)
            yield box(child, half, colours[ends[1].body.name], ends[1].body.name)
        travel = np.einsum("ki,ki->k", child.p - parent.p, parent.R[:, :, 2])
        low, high = travel.min() - 6.0 * size, travel.max() + 6.0 * size
        a, b = (parent.p + s * parent.R[:, :, 2] for s in (low, high))
        yield cylinder(a, b, 0.45 * size, GROUND if grounded else JOINT, joint.name)
    elif pair is None or pair.turning != kinds.TURN_NONE:
        yield ball(child.p, 1.5 * size, JOINT, joint.name)
    elif grounded:
        yield box(child, (2.0 * size,) * 3, GROUND, joint.name)


def _thickness(frame: Frame, axis: FloatArray) -> float:
    """How far (m) what is drawn of a body reaches along a joint's axis near the joint."""
    x = _outline_points(frame.body)
    if x is None:
        return 0.0
    away = x - frame.p_BF_B
    distance = np.linalg.norm(away, axis=1)
    near = away[distance <= 1.5 * distance.min()]
    return float(np.abs(near @ (frame.R_BF @ axis)).max())


def _outline_points(body: Body) -> FloatArray | None:
    if body.shape is not None:
        return body.shape.points
    surface = surface_of(body)
    return None if surface is None else surface.x
