"""What acts on a machine, as descriptions: each says what it becomes on other markers, in other units, turned round."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import functions_of_time as of_time
import numpy as np

import flexmbd as fm

if TYPE_CHECKING:
    from random_machine import Mark

FloatArray = np.ndarray



@dataclass(frozen=True, eq=False)
class Push:
    """A force and a torque on a marker, six functions of time."""

    mark: Mark
    components: tuple
    in_frame: bool

    links = ()

    @property
    def marks(self):
        return (self.mark,)

    def on(self, marks, links):
        return replace(self, mark=marks[0])

    def mapped(self, change):
        """With each function of time changed."""
        return replace(self, components=tuple(map(change, self.components)))

    def build(self, frames, joints):
        axes = fm.force.Axes.FRAME if self.in_frame else fm.force.Axes.WORLD
        components = tuple(map(of_time.given, self.components))
        return fm.force.FrameForce(frames[0], components[:3], components[3:], axes)

    def in_units(self, u, turns):
        sizes = [u.force] * 3 + [u.force * u.length] * 3
        pairs = zip(self.components, sizes, strict=True)
        return replace(
            self, mark=self.mark.in_units(u), components=tuple(of_time.in_units(c, s, u.time) for c, s in pairs)
        )


@dataclass(frozen=True, eq=False)
class Spring:
    """From point to point."""

    first: Mark
    second: Mark
    stiffness: float
    length: float
    damping: float

    links = ()

    @property
    def marks(self):
        return self.first, self.second

    def on(self, marks, links):
        return replace(self, first=marks[0], second=marks[1])

    def mapped(self, change):
        return self

    def build(self, frames, joints):
        return fm.force.SpringDamper(*frames, self.stiffness, self.length, self.damping)  # type: ignore[call-arg]

    def in_units(self, u, turns):
        return Spring(
            self.first.in_units(u),
            self.second.in_units(u),
            self.stiffness * u.mass / u.time**2,
            self.length * u.length,
            self.damping * u.mass / u.time,
        )


@dataclass(frozen=True, eq=False)
class Bush:
    """An elastic joint."""

    first: Mark
    second: Mark
    stiffness: FloatArray
    damping: FloatArray

    links = ()

    @property
    def marks(self):
        return self.first, self.second

    def on(self, marks, links):
        return replace(self, first=marks[0], second=marks[1])

    def mapped(self, change):
        return self

    def build(self, frames, joints):
        return fm.force.Bushing(*frames, self.stiffness, self.damping)  # type: ignore[call-arg]

    def in_units(self, u, turns):
        scale = np.concatenate([np.ones(3), np.full(3, u.length)])
        grid = np.outer(scale, scale) * u.mass / u.time
        return Bush(
            self.first.in_units(u), self.second.in_units(u), self.stiffness * grid / u.time, self.damping * grid
        )


@dataclass(frozen=True, eq=False)
class OnCoordinate:
    """What acts on one coordinate of a joint; ``sign`` is -1 where the joint is turned round."""

    link: str
    coordinate: int

    marks = ()

    @property
    def links(self):
        return (self.link,)

    def on(self, marks, links):
        return replace(self, link=links[0])

    def mapped(self, change):
        return self


@dataclass(frozen=True, eq=False)
class CoordinateSpring(OnCoordinate):
    stiffness: float
    rest: float
    damping: float

    def build(self, frames, joints):
        return fm.force.JointSpring(joints[0], self.stiffness, self.rest, self.damping, self.coordinate)

    def in_units(self, u, turns):
        x, f = u.coordinate(turns)
        return replace(
            self, stiffness=self.stiffness * f / x, rest=self.rest * x, damping=self.damping * f / x * u.time
        )

    def negated(self, coordinate):
        return replace(self, rest=-self.rest, coordinate=coordinate)


@dataclass(frozen=True, eq=False)
class CoordinateFriction(OnCoordinate):
    size: float
    speed: float
    viscous: float
    static: float | None = None
    stribeck: float | None = None

    def build(self, frames, joints):
        return fm.force.JointFriction(
            joints[0], self.size, self.speed, self.static, self.stribeck, self.viscous, self.coordinate
        )

    def in_units(self, u, turns):
        x, f = u.coordinate(turns)
        sticks = self.static is not None
        return replace(
            self,
            size=self.size * f,
            speed=self.speed * x / u.time,
            viscous=self.viscous * f / x * u.time,
            static=self.static * f if sticks else None,
            stribeck=self.stribeck * x / u.time if sticks else None,
        )

    def negated(self, coordinate):
        return replace(self, coordinate=coordinate)


@dataclass(frozen=True, eq=False)
class PinFriction(OnCoordinate):
    """Friction that follows the force that a hinge or a slide passes on; ``radius`` (m) of a hinge."""

    coefficient: float
    speed: float
    radius: float | None

    def build(self, frames, joints):
        return fm.force.BearingFriction(joints[0], self.coefficient, self.speed, self.radius)

    def in_units(self, u, turns):
        radius = None if self.radius is None else self.radius * u.length
        return replace(self, speed=self.speed * u.coordinate(turns)[0] / u.time, radius=radius)

    def negated(self, coordinate):
        return replace(self, coordinate=coordinate)


@dataclass(frozen=True, eq=False)
class Motor(OnCoordinate):
    """A given torque or force on a joint of one coordinate."""

    value: Any

    def mapped(self, change):
        return replace(self, value=change(self.value))

    def build(self, frames, joints):
        kind = fm.force.JointTorque if joints[0].joint.angular[0] else fm.force.JointForce
        return kind(joints[0], of_time.given(self.value))

    def in_units(self, u, turns):
        return replace(self, value=of_time.in_units(self.value, u.coordinate(turns)[1], u.time))

    def negated(self, coordinate):
        return replace(self, value=of_time.in_units(self.value, -1.0, 1.0), coordinate=coordinate)
