"""A machine as a description, complete and frozen: what a transformation changes and a System is built from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import functions_of_time as of_time
import joint_motion
import numpy as np
from beam_records import Beam
from mesh_records import Meshed

import flexmbd as fm

FloatArray = np.ndarray


@dataclass(frozen=True)
class Units:
    """What one metre, kilogram and second are in the new units."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def speed(self):
        return self.length / self.time

    @property
    def force(self):
        return self.mass * self.length / self.time**2

    def coordinate(self, angular):
        """Of a joint coordinate, and of the force on it."""
        return (1.0, self.force * self.length) if angular else (self.length, self.force)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is, p (3,) and R (3, 3), and how it moves, v and w (3,); in inertial axes."""

    p: FloatArray
    R: FloatArray
    v: FloatArray = field(default_factory=lambda: np.zeros(3))
    w: FloatArray = field(default_factory=lambda: np.zeros(3))

    def after(self, p, R):
        """A frame fixed in this one, at p with axes R."""
        arm = self.R @ p
        return Pose(self.p + arm, self.R @ R, self.v + np.cross(self.w, arm), self.w)

    def moved(self, R, p, twist):
        """A frame at p with axes R that moves against this one with a twist (6,), all in this one's axes."""
        arm = self.R @ p
        v = self.v + np.cross(self.w, arm) + self.R @ twist[3:]
        return Pose(self.p + arm, self.R @ R, v, self.w + self.R @ twist[:3])

    def seen(self, other):
        """R, p and twist (6,) of another frame, seen from this one."""
        d = other.p - self.p
        v = other.v - self.v - np.cross(self.w, d)
        return self.R.T @ other.R, self.R.T @ d, np.concatenate([self.R.T @ (other.w - self.w), self.R.T @ v])

    def carrying(self, p, R):
        """The frame in which this one is fixed at p with axes R."""
        return self.after(-(R.T @ p), R.T)

    def in_units(self, u):
        return Pose(self.p * u.length, self.R, self.v * u.speed, self.w / u.time)


@dataclass(frozen=True, eq=False)
class Mark:
    """A marker at p with axes R on a part, or the part's interface that lies there."""

    part: str
    p: FloatArray = field(default_factory=lambda: np.zeros(3))
    R: FloatArray = field(default_factory=lambda: np.eye(3))
    interface: str | None = None

    def in_units(self, u):
        return replace(self, p=self.p * u.length)


# ------------------------------------------------------------------------------------------------------------- parts


@dataclass(frozen=True, eq=False)
class Rigid:
    mass: float
    com: FloatArray
    inertia: FloatArray

    def build(self):
        return fm.RigidBody(self.mass, self.inertia, tuple(map(float, self.com)))

    def in_units(self, u):
        return Rigid(self.mass * u.mass, self.com * u.length, self.inertia * u.mass * u.length**2)


@dataclass(frozen=True, eq=False)
class Pseudo:
    """A box, pseudo-rigid."""

    density: float
    sides: FloatArray
    E: float
    nu: float
    damping: float

    def build(self):
        solid = fm.Solid.box(self.sides, density=self.density)
        return fm.PseudoRigidBody(solid, fm.StVenantKirchhoff(self.E, self.nu), damping=self.damping)

    def in_units(self, u):
        pressure = u.force / u.length**2
        return replace(
            self, density=self.density * u.mass / u.length**3, sides=self.sides * u.length, E=self.E * pressure
        )


@dataclass(frozen=True, eq=False)
class Part:
    """A body, and where its frame is at the start; of an elastic one undeformed."""

    name: str
    body: Rigid | Pseudo | Beam | Meshed
    pose: Pose

    @property
    def deforms(self):
        return not isinstance(self.body, Rigid)

    @property
    def reduced(self):
        """Whether it is held by its interfaces "a" and "b" alone."""
        return isinstance(self.body, (Beam, Meshed))

    def in_units(self, u):
        return Part(self.name, self.body.in_units(u), self.pose.in_units(u))


# ------------------------------------------------------------------------------------------------------------- links


@dataclass(frozen=True, eq=False)
class Link:
    """A joint.  ``swapped``: its reaction is asked of the other end than in the machine it comes from."""

    name: str
    joint: Any
    parent: Mark
    child: Mark
    way: fm.Way | None = None
    motion: Any = None
    swapped: bool = False

    @property
    def turns(self):
        return self.joint.angular

    def in_units(self, u):
        joint = self.joint
        if isinstance(joint, fm.joint.Screw):
            joint = replace(joint, pitch=joint.pitch * u.length)
        elif isinstance(joint, fm.joint.Distance):
            joint = fm.joint.Distance(joint.length * u.length)
        elif isinstance(joint, fm.joint.RollingDisc):
            joint = fm.joint.RollingDisc(joint.radius * u.length)
        motion = self.motion
        if motion is not None:
            motion = of_time.in_units(motion, u.coordinate(self.turns[0])[0], u.time)
        return replace(
            self, joint=joint, parent=self.parent.in_units(u), child=self.child.in_units(u), motion=motion
        )


@dataclass(frozen=True, eq=False)
class Gear:
    """The second link's angle, or its displacement (a rack), moves by ratio times the first one's angle."""

    first: str
    second: str
    ratio: float
    rack: bool = False

    def build(self, joints):
        kind = fm.joint.RackAndPinion if self.rack else fm.joint.Gear
        return kind(joints[self.first], joints[self.second], self.ratio)

    def in_units(self, u):
        return replace(self, ratio=self.ratio * u.length) if self.rack else self


# ----------------------------------------------------------------------------------------------------------- machine


@dataclass(frozen=True, eq=False)
class Machine:
    """Parts, links and loads; all parts' poses fulfil all links.

    Attributes:
        probes: markers whose motion is compared.
        start, duration: s.
        integrator: of the motion.
    """

    parts: tuple[Part, ...]
    links: tuple[Link, ...]
    loads: tuple
    gravity: FloatArray
    probes: dict[str, Mark]
    start: float = 0.0
    duration: float = 0.1
    integrator: Any = "auto"
    gears: tuple[Gear, ...] = ()
    touches: tuple = ()

    def part(self, name):
        return next(part for part in self.parts if part.name == name)

    def link(self, name):
        return next(link for link in self.links if link.name == name)

    def pose(self, mark):
        """Where a marker is at the start."""
        if mark.part == "ground":
            return Pose(mark.p, mark.R)
        return self.part(mark.part).pose.after(mark.p, mark.R)

    def joint_state(self, link):
        """Coordinates and velocities of a link at the start."""
        R, p, twist = self.pose(link.parent).seen(self.pose(link.child))
        return joint_motion.coordinates_of(link.joint, R, p), joint_motion.rates_of(link.joint, R, p, twist)

    def turns(self, load):
        """Whether the coordinate that a load acts on is an angle."""
        return self.link(load.links[0]).turns[load.coordinate] if load.links else False

    @property
    def extent(self):
        """The largest distance (m) of a marker from the ground's origin, or from another."""
        points = [self.pose(m).p for link in self.links for m in (link.parent, link.child)]
        points += [self.pose(m).p for m in self.probes.values()]
        return max(float(np.linalg.norm(a - b)) for a in points for b in points)

    @property
    def deforms(self):
        return any(part.deforms for part in self.parts)

    @property
    def has_hard_contacts(self):
        return any(touch.hard for touch in self.touches)

    def __str__(self):
        lines = [f"gravity {self.gravity}, {self.start} s and {self.duration} s from there"]
        lines += [f"  {part.name}: {part.body}" for part in self.parts]
        for link in self.links:
            position, rate = (np.round(values, 4).tolist() for values in self.joint_state(link))
            way = "" if link.way is None else f" by {link.way.name.lower()}"
            motion = "" if link.motion is None else f", prescribed {link.motion}"
            lines.append(f"  {link.name}: {link.joint}{way}{motion}, at {position}, {rate}")
            lines += [f"    {mark}" for mark in (link.parent, link.child)]
        lines += [f"  {load}" for load in (*self.loads, *self.gears, *self.touches)]
        return "\n".join(lines)

    __repr__ = __str__


@dataclass(frozen=True, eq=False)
class Built:
    """A System and how the description's names are called in it."""

    scene: fm.System
    bodies: dict
    joints: dict

    def frame(self, mark):
        body = self.bodies[mark.part]
        return body.frame(mark.interface) if mark.interface else body.frame(mark.p, R=mark.R)


def _rounded(link, position, digits):
    """Coordinates of so many digits, a quaternion scaled to one."""
    rounded = np.round(position, digits)
    if len(position) > len(link.turns):
        rounded[-4:] /= np.linalg.norm(rounded[-4:])
    return rounded


def build(machine, *, rough=None):
    """The System of a description, each joint given its coordinates and velocities.

    Args:
        machine: the description.
        rough: digits to which coordinates of the tree's joints are rounded, the others' left out; None: exact.
    """
    scene = fm.System(gravity=tuple(map(float, machine.gravity)))
    bodies = {part.name: scene.add(part.body.build(), name=part.name) for part in machine.parts}
    built = Built(scene, {**bodies, "ground": scene.ground}, {})
    for link in machine.links:
        ends = built.frame(link.parent), built.frame(link.child)
        joint = scene.connect(link.joint, *ends, name=link.name, way=link.way)
        built.joints[link.name] = joint
        if link.motion is not None:
            joint.prescribe(of_time.given(link.motion, motion=True))
        elif link.joint.velocity_names and (rough is None or not link.name.startswith("loop")):
            position, velocity = machine.joint_state(link)
            joint.position = position if rough is None else _rounded(link, position, rough)
            joint.velocity = velocity
    for load in machine.loads:
        frames, joints = map(built.frame, load.marks), [built.joints[name] for name in load.links]
        scene.add_force(load.build(tuple(frames), joints))
    for touch in machine.touches:
        touch.put(scene, tuple(map(built.frame, touch.marks)))
    for gear in machine.gears:
        scene.couple(gear.build(built.joints))
    return built
