"""A machine as simple shapes that move: what a film shows of bodies that have no surface.

A rigid body is drawn as sticks between the frames that joints hold it by and a ball at its centre
of mass; a revolute joint as a pin, a prismatic one as a rail and a sliding block, a spherical one
as a ball; what is fixed to the ground is grey.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.skin import surface_of

FloatArray = NDArray[np.float64]

GROUND = "#a8a8a8"
JOINT = "#2b2b2b"
BODIES = ("#4c72b0", "#dd8452", "#55a868", "#8172b3", "#c44e52", "#937860", "#64b5cd", "#ccb974")


class Shape(enum.Enum):
    """Unit shapes: radius 1 (a box: half sides 1); the cylinder runs from z = 0 to 1."""

    CYLINDER = enum.auto()
    BALL = enum.auto()
    BOX = enum.auto()


@dataclass(frozen=True, eq=False)
class Primitive:
    """A unit shape that moves.

    Attributes:
        shape: which of them.
        colour: as a hexadecimal text.
        pose: (nt, 4, 4) from the unit shape to inertial axes, scaling included (m).
    """

    shape: Shape
    colour: str
    pose: FloatArray

    def reach(self) -> FloatArray:
        """(k, 3) m, points between which it stays at all instants."""
        low = 0.0 if self.shape is Shape.CYLINDER else -1.0
        corners = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [low, 1.0], [1.0])).reshape(4, -1)
        return (self.pose @ corners)[:, :3].transpose(0, 2, 1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame on its way: p (nt, 3) m and R (nt, 3, 3), both in the inertial frame."""

    p: FloatArray
    R: FloatArray


@dataclass(frozen=True, eq=False)
class Sketch:
    """The machine at the instants of a film.

    Attributes:
        primitives: what moves rigidly.
        bodies: pose of each body frame.
        colours: colour of each body, by its name.
        places: (k, 3) m, where frames and centres of mass are met over all instants.
        size: m, the radius of a stick.
    """

    primitives: tuple[Primitive, ...]
    bodies: IdentityMap[Body, Pose]
    colours: Mapping[str, str]
    places: FloatArray
    size: float


def sketch(trajectory: RecordedMotion, times: FloatArray, *, skinned: Sequence[Body]) -> Sketch:
    """Draw the machine at ``times`` (nt,); bodies in ``skinned`` get no sticks, but their joints.

    Not collective.
    """
    joints = _joints(trajectory)
    frames = _frames(trajectory, joints)
    poses = IdentityMap(
        (f, Pose(trajectory.position(f, t=times), trajectory.rotation(f, t=times)))
        for held in frames.values()
        for f in held
    )
    bodies = IdentityMap((body, _body_pose(trajectory, body, times)) for body in trajectory.bodies.values())
    coms = IdentityMap((body, pose.p + pose.R @ (body.moments()[0] / body.mass)) for body, pose in bodies.items())
    places = np.concatenate([pose.p for pose in poses.values()] + list(coms.values()))
    size = 0.009 * (float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0)
    heaviest = max(body.mass for body in trajectory.bodies.values())
    primitives: list[Primitive] = []
    colours = {}
    for k, (name, body) in enumerate(trajectory.bodies.items()):
        colours[name] = BODIES[k % len(BODIES)]
        if any(body is other for other in skinned):
            continue
        com = coms[body]
        tops = [poses[f].p for f in frames.get(body, ())]
        for a, b in _sticks(tops, com, size):
            primitives.append(cylinder(a, b, size, colours[name]))
        radius = 2.4 * size * max(0.5, (body.mass / heaviest) ** (1 / 3))
        primitives.append(ball(com, radius, colours[name]))
    for joint in joints:
        primitives.extend(_joint_primitives(joint, poses, size, colours))
    return Sketch(tuple(primitives), bodies, colours, places, size)


def cylinder(a: FloatArray, b: FloatArray, radius: float, colour: str) -> Primitive:
    """A round stick from a to b, each (nt, 3) m."""
    z = b - a
    length = np.linalg.norm(z, axis=1, keepdims=True)
    z = z / np.where(length > 0.0, length, 1.0)
    helper = np.eye(3)[np.argmin(np.abs(z), axis=1)]
    x = np.cross(helper, z)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    x = x / np.where(norm > 0.0, norm, 1.0)
    columns = np.stack([radius * x, radius * np.cross(z, x), length * z], axis=2)
    return Primitive(Shape.CYLINDER, colour, _matrix(a, columns))


def ball(p: FloatArray, radius: float, colour: str) -> Primitive:
    """A ball at p (nt, 3) m."""
    return Primitive(Shape.BALL, colour, _matrix(p, np.broadcast_to(radius * np.eye(3), (len(p), 3, 3))))


def box(pose: Pose, half: Sequence[float], colour: str) -> Primitive:
    """A box with half sides ``half`` (m) along the axes of a frame."""
    return Primitive(Shape.BOX, colour, _matrix(pose.p, pose.R * np.asarray(half)))


def _matrix(p: FloatArray, columns: FloatArray) -> FloatArray:
    matrix = np.zeros((len(p), 4, 4))
    matrix[:, :3, :3] = columns
    matrix[:, :3, 3] = p
    matrix[:, 3, 3] = 1.0
    return matrix


def _joints(trajectory: RecordedMotion) -> list[Connection]:
    """Joints that hold something: those of the tree, then those that close loops."""
    topology = trajectory.scene.topology
    along = [b.connection for b in topology.branches if b.connection is not None]
    return [c for c in (*along, *topology.closures) if not any(len(s.pair.angular) == 6 for s in c.joint.steps)]


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
                Frame(body, i.p_BI_B, i.R_BI, i.modes, i.name) for i in record.interfaces
            )
    return frames


def _body_pose(trajectory: RecordedMotion, body: Body, times: FloatArray) -> Pose:
    frame = Frame(body, np.zeros(3), np.eye(3), None, body.name)
    return Pose(trajectory.position(frame, t=times), trajectory.rotation(frame, t=times))


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


def _joint_primitives(
    joint: Connection, poses: IdentityMap[Frame, Pose], size: float, colours: Mapping[str, str]
) -> Iterator[Primitive]:
    ends = [joint.parent, joint.child]
    if ends[1].body.name not in colours:  # what is on the ground carries the other
        ends.reverse()
    grounded = ends[0].body.name not in colours
    steps = joint.joint.steps
    turn = joint.joint.turn
    parent, child = (Pose(poses[f].p, poses[f].R @ turn) for f in ends)
    pair = steps[0].pair if len(steps) == 1 else None
    single = pair is not None and len(pair.angular) == 1
    axis = child.R[:, :, 2]
    if pair is not None and single and pair.turning == kinds.TURN_ABOUT_Z:
        reach = 2.7 * size + max(_thickness(f, turn[:, 2]) for f in ends)
        yield cylinder(child.p - reach * axis, child.p + reach * axis, 1.1 * size, JOINT)
        if grounded:
            depth = 0.5 * size * axis
            yield cylinder(child.p - depth, child.p + depth, 2.8 * size, GROUND)
    elif single:
        yield box(child, (2.2 * size, 2.2 * size, 3.6 * size), colours[ends[1].body.name])
        travel = np.einsum("ki,ki->k", child.p - parent.p, parent.R[:, :, 2])
        low, high = travel.min() - 6.0 * size, travel.max() + 6.0 * size
        a, b = (parent.p + s * parent.R[:, :, 2] for s in (low, high))
        yield cylinder(a, b, 0.45 * size, GROUND if grounded else JOINT)
    elif pair is None or len(pair.angular) > 0:
        yield ball(child.p, 1.5 * size, JOINT)
    elif grounded:
        yield box(child, (2.0 * size,) * 3, GROUND)


def _thickness(frame: Frame, axis: FloatArray) -> float:
    """How far (m) a body's surface reaches along a joint's axis near the joint."""
    surface = surface_of(frame.body)
    if surface is None:
        return 0.0
    away = surface.x - frame.p_BF_B
    distance = np.linalg.norm(away, axis=1)
    near = away[distance <= 1.5 * distance.min()]
    return float(np.abs(near @ (frame.R_BF @ axis)).max())
