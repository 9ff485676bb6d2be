"""Shapes that touch, each on the frame of a body or of the ground; what touches them is a sphere or a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.contact.polytopes import Polytope, hull, polytope
from flexmbd.multibody.contact.profile import Profile
from flexmbd.multibody.contact.table_shape import LoneShape
from flexmbd.multibody.contact.triangle_surface import TriangleSurface
from flexmbd.multibody.kernels.contact import signed_distance as kinds
from flexmbd.rotation import Axis, z_onto

FloatArray = NDArray[np.float64]

_CROWN = 1e-4  # of the radius: how plane the faces of discs are, as turned parts


class TouchedShape(Protocol):
    """A shape that spheres and points touch."""

    @property
    def frame(self) -> Frame:
        """Where it is."""

    def numbers(self) -> FloatArray:
        """(4,) its kind and sizes (``kernels.contact.signed_distance``)."""

    def curvatures(self) -> tuple[float, float]:
        """Its two principal curvatures (1/m) where a sphere touches it, positive where it is convex."""


@dataclass(frozen=True, eq=False)
class _Round:
    """A shape that a radius tells."""

    frame: Frame
    radius: float
    _kind: ClassVar[int]

    def __post_init__(self) -> None:
        _check(self, radius=self.radius)

    def numbers(self) -> FloatArray:
        """Kind and radius."""
        return np.array([self._kind, self.radius, 0.0, 0.0])


class Sphere(_Round):
    """A ball about the frame's origin.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
    """

    _kind = kinds.SPHERE

    def curvatures(self) -> tuple[float, float]:
        """Both 1 / radius."""
        return 1.0 / self.radius, 1.0 / self.radius


class HollowSphere(_Round):
    """A spherical hollow about the frame's origin: what touches it is inside.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
    """

    _kind = kinds.HOLLOW_SPHERE

    def curvatures(self) -> tuple[float, float]:
        """Both -1 / radius."""
        return -1.0 / self.radius, -1.0 / self.radius


class Cylinder(_Round):
    """A round cylinder without ends along the frame's z axis.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
    """

    _kind = kinds.CYLINDER

    def curvatures(self) -> tuple[float, float]:
        """Round and straight."""
        return 1.0 / self.radius, 0.0


class HollowCylinder(_Round):
    """A round bore without ends along the frame's z axis: what touches it is inside.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
    """

    _kind = kinds.HOLLOW_CYLINDER

    def curvatures(self) -> tuple[float, float]:
        """Round and straight."""
        return -1.0 / self.radius, 0.0


@dataclass(frozen=True, eq=False)
class Disc(LoneShape):
    """A disc, a wheel, a coin, a round bar with ends: a cylinder about the frame's z axis, its middle at the origin.

    A half space is touched by the lowest point of each face, which is a little crowned, as no face is quite plane:
    where it lies flat it bears in its middle, and a tilt of some ``crown`` / ``radius`` brings the point to the rim.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
        thickness: m along z; 0: a disc that is thin beside all that it touches.
        rounding: m, the radius that its edges are rounded with, at most half the thickness and less than the radius.
        crown: m, how much higher a face is in its middle than at its rim, before half spaces; None: a ten-thousandth of
            the rim's radius.  A thin disc is as much thicker.
    """

    frame: Frame
    radius: float
    thickness: float = 0.0
    rounding: float = 0.0
    crown: float | None = None

    def __post_init__(self) -> None:
        _check(self, radius=self.radius)
        what = f"a Disc on {self.frame.label}"
        for name, value in (("thickness", self.thickness), ("rounding", self.rounding)):
            if not (is_number(value) and 0.0 <= value < np.inf):
                raise SceneError(f"{name} of {what} must be a length (m), 0 or more, got {value!r}")
        if self.rounding > 0.5 * self.thickness or self.rounding >= self.radius:
            raise SceneError(
                f"rounding of {what}, {self.rounding:g} m, is at most half its thickness, {0.5 * self.thickness:g} m, "
                f"and less than its radius, {self.radius:g} m; of a rod with round ends take a Capsule"
            )
        a, half = self.rim
        if self.crown is not None and not (is_number(self.crown) and 0.0 < self.crown <= (half or a)):
            raise SceneError(
                f"crown of {what} must be a length (m), more than 0 and at most {half or a:g} m, got {self.crown!r}"
            )

    @property
    def rim(self) -> tuple[float, float]:
        """m, radius of the circles about which its edges are round, and how far from the middle plane they are."""
        return self.radius - self.rounding, 0.5 * self.thickness - self.rounding

    @property
    def crowned(self) -> float:
        """m, its crown."""
        a, half = self.rim
        return min(_CROWN * a, half or a) if self.crown is None else self.crown

    def numbers(self) -> FloatArray:
        """Kind, radius and half the thickness of its core, and the rounding."""
        return np.array([kinds.DISC, *self.rim, self.rounding])

    def curvatures(self) -> tuple[float, float]:
        """Not one pair: see ``Hertz``."""
        raise SceneError(
            f"Disc on {self.frame.label}: its side, its faces and its edges have curvatures of their own, and Hertz's "
            "law has one; take PowerLaw, as PowerLaw.bearing(load=..., depth=...)"
        )


@dataclass(frozen=True, eq=False)
class Vertex:
    """A point, as a corner or the end of a rod; it touches what is no point.

    Attributes:
        frame: its origin is the point.
    """

    frame: Frame

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, eq=False)
class Capsule:
    """A round rod with round ends along the frame's z axis, its middle at the frame's origin.

    Attributes:
        frame: on a body or on the ground.
        radius: m.
        length: m, between the centres of its ends.
    """

    frame: Frame
    radius: float
    length: float

    def __post_init__(self) -> None:
        _check(self, radius=self.radius, length=self.length)

    def numbers(self) -> FloatArray:
        """Kind, radius, half the length."""
        return np.array([kinds.CAPSULE, self.radius, 0.5 * self.length, 0.0])

    def curvatures(self) -> tuple[float, float]:
        """Of its side, round and straight."""
        return 1.0 / self.radius, 0.0


@dataclass(frozen=True, eq=False)
class Box:
    """A box, its middle at the frame's origin, its sides along the frame's axes.

    Attributes:
        frame: on a body or on the ground.
        sides: (3,) m.
    """

    frame: Frame
    sides: ArrayLike

    def __post_init__(self) -> None:
        sides = numbers(self.sides)
        if sides.shape != (3,):
            raise SceneError(f"a Box has three sides (m), got {self.sides!r}")
        _check(self, **{f"sides[{k}]": float(side) for k, side in enumerate(np.asarray(sides).ravel())})

    def numbers(self) -> FloatArray:
        """Kind and half the sides."""
        return np.array([kinds.BOX, *(0.5 * numbers(self.sides))])

    def curvatures(self) -> tuple[float, float]:
        """Of its faces: none."""
        return 0.0, 0.0


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """All that is behind a plane through the frame's origin.

    Attributes:
        frame: on a body or on the ground.
        normal: out of it, in the frame's axes: "x", "y", "z" or a vector (3,).
    """

    frame: Frame
    normal: Axis = "z"

    def __post_init__(self) -> None:
        _check(self)
        z_onto(self.normal)

    def numbers(self) -> FloatArray:
        """Kind and unit normal."""
        return np.array([kinds.HALF_SPACE, *z_onto(self.normal)[:, 2]])

    def curvatures(self) -> tuple[float, float]:
        """None."""
        return 0.0, 0.0


@dataclass(frozen=True, eq=False)
class ConvexPolytope:
    """The convex hull of some points, or a polytope of stated faces, which must be closed, convex and turned outwards.

    Neighbouring faces in one plane, to a millionth of its size, are one.

    Attributes:
        frame: on a body or on the ground.
        vertices: (v, 3) m, in the frame's axes.
        faces: vertices of each face by their numbers, counterclockwise as seen from outside; None: those of the hull.
        polytope: what is made of them.
    """

    frame: Frame
    vertices: ArrayLike
    faces: Sequence[Sequence[int]] | None = None
    polytope: Polytope = field(init=False)

    def __post_init__(self) -> None:
        _check(self)
        what = f"ConvexPolytope on {self.frame.label}"
        made = hull(self.vertices, what=what) if self.faces is None else polytope(self.vertices, self.faces, what=what)
        object.__setattr__(self, "polytope", made)


TouchShape: TypeAlias = (
    Sphere | HollowSphere | Cylinder | HollowCylinder | Disc | Vertex | Capsule | Box | HalfSpace | ConvexPolytope
    | Profile | TriangleSurface
)  # fmt: skip
SHAPES = (
    Sphere, HollowSphere, Cylinder, HollowCylinder, Disc, Vertex, Capsule, Box, HalfSpace, ConvexPolytope, Profile,
    TriangleSurface,
)  # fmt: skip


def corners(box: Box) -> FloatArray:
    """(8, 3) m its corners, in its frame's axes."""
    signs = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return 0.5 * numbers(box.sides) * np.array(signs)


def ends(capsule: Capsule) -> FloatArray:
    """(2, 3) m the centres of its two round ends, in its frame's axes."""
    half = 0.5 * capsule.length
    return np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])


def _check(shape: TouchShape | _Round, **sizes: float) -> None:
    what = type(shape).__name__
    refuse_other(shape.frame, Frame, f"the frame of a {what}", wanted="a frame as body.frame()")
    for name, value in sizes.items():
        if not (is_number(value) and 0.0 < value < np.inf):
            raise SceneError(f"{name} of a {what} on {shape.frame.label} must be positive (m), got {value!r}")
