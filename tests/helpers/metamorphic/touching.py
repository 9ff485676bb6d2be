"""Shapes that touch, as descriptions, and how they are drawn: their gap or depth at the start is what is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from drawing_parts import grid, mark_on, rotation, size
from hypothesis import strategies as st
from random_machine import Mark, Pose

from flexmbd import contact

FloatArray = np.ndarray


@dataclass(frozen=True, eq=False)
class Round:
    """A shape by its kind and its lengths (m); ``place`` (m) is a point of its surface, ``normal`` leads out of it."""

    kind: str
    lengths: tuple[float, ...]
    place: tuple[float, float, float]
    normal: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def build(self, frame):
        return _SHAPES[self.kind](frame, *self.lengths)

    def in_units(self, u):
        lengths, place = (tuple(u.length * value for value in values) for values in (self.lengths, self.place))
        return replace(self, lengths=lengths, place=place)


def _cam(frame, reach, rise):
    angle = 2.0 * np.pi * np.arange(24) / 24
    radii = reach + rise * np.cos(angle)
    return contact.Profile(frame, np.stack([radii * np.cos(angle), radii * np.sin(angle)], axis=1), spline=True)


def _cushion(frame, *half):
    """An octahedron with curved sides, each of sixteen triangles."""
    corners = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    faces = [(a, b, 4) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    faces += [(b, a, 5) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    points, triangles, known = [], [], {}

    def number(p):
        p = p / np.linalg.norm(p)
        key = tuple(np.round(p, 9) + 0.0)
        if key not in known:
            known[key] = len(points)
            points.append(p)
        return known[key]

    def halved(a, b, c, times):
        if times == 0:
            triangles.append([number(a), number(b), number(c)])
            return
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        for one in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)):
            halved(*one, times - 1)

    for face in faces:
        a, b, c = corners[list(face)]
        halved(a, b, c, 2)
    return contact.TriangleSurface(frame, np.array(points) * np.array(half), triangles)


_SHAPES = {
    "half space": lambda frame: contact.HalfSpace(frame, "x"),
    "hollow sphere": contact.HollowSphere,
    "hollow cylinder": contact.HollowCylinder,
    "cylinder": contact.Cylinder,
    "sphere": contact.Sphere,
    "vertex": contact.Vertex,
    "capsule": contact.Capsule,
    "box": lambda frame, *sides: contact.Box(frame, sides),
    "profile": _cam,
    "surface": _cushion,
}


@dataclass(frozen=True, eq=False)
class Touch:
    """Two shapes that touch; ``friction``: mu, stiffness (N/m), damping (N s/m) and load (N), or None.

    ``hard``: by impulses, of the stiffness, the speed and friction's other numbers nothing is then known.
    """

    first: Mark
    second: Mark
    shapes: tuple[Round, Round]
    stiffness: float
    exponent: float
    restitution: float
    speed: float
    friction: tuple[float, float, float, float] | None
    hard: bool = False

    links = ()

    @property
    def marks(self):
        return self.first, self.second

    def on(self, marks, links):
        return replace(self, first=marks[0], second=marks[1])

    def swapped(self):
        """Named the other way round."""
        return replace(self, first=self.second, second=self.first, shapes=self.shapes[::-1])

    def put(self, scene, frames):
        """Let them touch in a System."""
        one, other = (shape.build(frame) for shape, frame in zip(self.shapes, frames, strict=True))
        if self.hard:
            mu = 0.0 if self.friction is None else self.friction[0]
            return scene.touch(one, other, contact.Hard(restitution=self.restitution, mu=mu))
        law = contact.PowerLaw(k=self.stiffness, p=self.exponent, restitution=self.restitution, speed=self.speed)
        rough = None if self.friction is None else contact.Friction(*self.friction)
        return scene.touch(one, other, law, friction=rough)

    def in_units(self, u):
        damping = u.mass / u.time
        rough = self.friction
        if rough is not None:
            rough = rough[0], rough[1] * damping / u.time, rough[2] * damping, rough[3] * u.force
        return replace(
            self,
            first=self.first.in_units(u),
            second=self.second.in_units(u),
            shapes=tuple(shape.in_units(u) for shape in self.shapes),
            stiffness=self.stiffness * u.force / u.length**self.exponent,
            speed=self.speed * u.speed,
            friction=rough,
        )


def touches(draw, machine, *, rough):
    """Two shapes, one of a part, as far from each other as is drawn, or pressed by as much; ``rough``: with friction.

    Their bristle is as stiff as the surfaces are.
    """
    parts = list(machine.parts)
    one = draw(st.sampled_from(parts))
    other = draw(st.sampled_from([None, *(part for part in parts if part is not one)]))
    mark, radius = mark_on(draw, one), 0.125 * draw(size)
    kind = draw(st.sampled_from(["box", *(kind for kind in _SHAPES if kind != "vertex")]))
    gap = draw(st.sampled_from([-(2.0**-8), 2.0**-8, 2.0**-5]))
    seen = machine.pose(mark)
    if kind == "half space" and draw(st.booleans()):
        shape, shapes = _boxed(draw, machine, mark)
        here, out = shape
    else:
        shapes = _rounded(draw, kind, radius)
        here, out = seen.p, None
    R = draw(rotation)
    if out is not None:
        R = _with_first(out, R)
    base = Pose(np.zeros(3), np.eye(3)) if other is None else machine.part(other.name).pose
    there = shapes[1]
    reach = gap + (shapes[0].lengths[0] if shapes[0].kind == "sphere" else 0.0)
    p = here - R @ (np.array(there.place) + reach * np.array(there.normal))
    R_in, p_in, _ = base.seen(Pose(p, R))
    place = Mark("ground" if other is None else other.name, p_in, R_in)
    k = 2.0 ** draw(st.integers(10, 14))
    exponent = draw(st.sampled_from([1.0, 1.5]))
    if exponent > 1.0:
        k = 16.0 * k
    friction = None
    if rough:
        friction = 0.5 * draw(size), (k if exponent == 1.0 else 0.25 * k), 16.0 * draw(size), 8.0
    return Touch(mark, place, shapes, k, exponent, draw(st.sampled_from([1.0, 0.5])), 1.0, friction)


def _rounded(draw, kind, radius):
    """A sphere, or a vertex, and a shape of a kind that it touches, larger than it where it is hollow."""
    first = Round("vertex", (), (0.0, 0.0, 0.0))
    if kind == "sphere" or draw(st.booleans()):
        first = Round("sphere", (radius,), (radius, 0.0, 0.0))
    broad, along = 0.125 + 0.25 * draw(size), 0.0625 * draw(grid)
    inside = (-1.0, 0.0, 0.0)
    if kind == "half space":
        return first, Round(kind, (), (0.0, along, 0.0))
    if kind in ("hollow sphere", "hollow cylinder"):
        wide = 0.25 + broad
        return first, Round(kind, (wide,), (wide, 0.0, along if kind == "hollow cylinder" else 0.0), inside)
    if kind == "capsule":
        return first, Round(kind, (broad, 0.5), (broad, 0.0, along))
    if kind == "box":
        return first, Round(kind, (2.0 * broad, 0.5, 0.75), (broad, along, 0.5 * along))
    if kind == "profile":
        return first, Round(kind, (broad, 0.125 * broad), (1.125 * broad, 0.0, along))
    if kind == "surface":
        return first, Round(kind, (broad, 0.75 * broad, 0.875 * broad), (broad, 0.0, 0.0))
    return first, Round(kind, (broad,), (broad, 0.0, along if kind == "cylinder" else 0.0))


def _boxed(draw, machine, mark):
    """A box and a half space below its lowest corner: that corner's place and the half space's normal."""
    sides = 0.125 + 0.25 * np.array([draw(size) for _ in range(3)])
    pose = machine.pose(mark)
    tilted = np.array([1.0, 0.25 + 0.25 * draw(size), 0.25 + 0.25 * draw(size)])
    normal = pose.R @ (tilted / np.linalg.norm(tilted))
    corner = pose.p - pose.R @ (0.5 * sides)
    shapes = Round("box", tuple(map(float, sides)), (0.0, 0.0, 0.0)), Round("half space", (), (0.0, 0.0, 0.0))
    return (corner, normal), shapes


def _with_first(axis, R):
    """Axes whose first one is given."""
    second = np.cross(axis, R[:, int(np.argmin(np.abs(axis @ R)))])
    second /= np.linalg.norm(second)
    return np.stack([axis, second, np.cross(axis, second)], axis=1)
