"""A solid as a homogeneous motion knows it: mass, volume, centre and the second moments of mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers, shaped_numbers
from flexmbd.multibody.bodies.closed_surface import enclosed_moments, outward
from flexmbd.overflow import looked_at
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RINGS, _AROUND = 18, 36  # of the triangles that show a ball
_SIDES = 60  # of the polygon that shows a cylinder


@dataclass(frozen=True, eq=False)
class Outline:
    """A solid's surface, for pictures.

    Attributes:
        points: (n, 3) before scaling; solids of one kind share them.
        triangles: (t, 3) rows of points, oriented outwards.
        scale: (3,) m along the axes.
    """

    points: FloatArray
    triangles: IntArray
    scale: FloatArray

    __repr__ = brief

    @property
    def x(self) -> FloatArray:
        """(n, 3) m."""
        return self.points * self.scale


@dataclass(frozen=True, eq=False)
class Solid:
    """The mass integrals of a solid body (Zienkiewicz, Taylor & Fox, eq. 8.16, 8.20).

    Attributes:
        mass: kg, positive.
        volume: m^3, positive.
        com: (3,) m, centre of mass, in the axes that the solid was given in.
        second: (3, 3) kg m^2, integral of density times (x - com)(x - com)^T (Euler's tensor), in those axes.
        outline: what pictures show of it, in those axes; None where it is not known.

    Raises:
        SceneError: numbers that no solid has, each named.
    """

    mass: float
    volume: float
    com: FloatArray
    second: FloatArray
    outline: Outline | None = field(default=None, kw_only=True)

    __repr__ = brief

    def __post_init__(self) -> None:
        com, second = numbers(self.com).copy(), numbers(self.second).copy()
        faults = [
            f"{name} must be positive, got {value}"
            for name, value in (("mass", self.mass), ("volume", self.volume))
            if not (is_number(value) and value > 0.0)
        ]
        if com.shape != (3,) or not np.isfinite(com).all():
            faults.append(f"com must be three finite numbers (m), got {self.com!r}")
        if second.shape != (3, 3) or not np.isfinite(second).all():
            faults.append(f"second must be finite numbers of shape (3, 3), got {self.second!r}")
        elif abs(second - second.T).max() > EQUAL * abs(second).max():
            faults.append("second must be symmetric")
        elif np.linalg.eigvalsh(second)[0] <= EQUAL * abs(second).max():
            faults.append(f"second must be positive definite, its eigenvalues are {np.linalg.eigvalsh(second)}")
        if faults:
            raise SceneError("solid: " + "; ".join(faults))
        for name, value in (("com", com), ("second", second)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    @looked_at()
    def box(cls, sides: ArrayLike, *, density: float) -> Solid:
        """A box about the origin: sides (3,) m along the axes, density kg/m^3."""
        a = _lengths(sides, "sides of a box")
        return cls._even(float(a.prod()), a * a / 12.0, density, Outline(*_unit_box(), a))

    @classmethod
    @looked_at()
    def ellipsoid(cls, semi_axes: ArrayLike, *, density: float) -> Solid:
        """An ellipsoid about the origin: semi-axes (3,) m along the axes, density kg/m^3."""
        a = _lengths(semi_axes, "semi-axes of an ellipsoid")
        volume = 4.0 / 3.0 * np.pi * float(a.prod())
        return cls._even(volume, a * a / 5.0, density, Outline(*unit_ball(), a))

    @classmethod
    @looked_at()
    def cylinder(cls, radius: float, length: float, *, density: float, bore: float = 0.0) -> Solid:
        """A round cylinder along z about the origin, or a tube: radius, length and inner radius m, density kg/m^3."""
        r, h, inner = (float(one) if is_number(one) else np.nan for one in (radius, length, bore))
        if not (np.isfinite([r, h, inner]).all() and r > inner >= 0.0 and h > 0.0):
            raise SceneError(
                "a cylinder wants a positive length and a radius that exceeds its bore, not negative (m), "
                f"got radius {radius!r}, length {length!r}, bore {bore!r}"
            )
        across = (r * r + inner * inner) / 4.0  # infinite where r**2 would raise an OverflowError
        volume = np.pi * (r * r - inner * inner) * h
        points, triangles = unit_tube(inner / r)
        outline = Outline(points, triangles, np.array([r, r, h]))
        return cls._even(volume, (across, across, h * h / 12.0), density, outline)

    @classmethod
    @checked()
    @looked_at()
    def together(cls, solids: Sequence[Solid]) -> Solid:
        """Several solids as one; where they overlap the mass counts twice.  It has no outline.

        Raises:
            SceneError: there are none.
        """
        if not solids:
            raise SceneError("no solids to put together")
        mass = sum(one.mass for one in solids)
        com, second = np.zeros(3), np.zeros((3, 3))
        for one in solids:
            com += one.mass / mass * one.com
        for one in solids:
            second += one.second + one.mass * np.outer(one.com - com, one.com - com)
        return cls(mass, sum(one.volume for one in solids), com, second)

    @classmethod
    @looked_at()
    def from_surface(cls, points: ArrayLike, triangles: ArrayLike, *, density: float) -> Solid:
        """The solid inside a closed surface of flat triangles; see ``closed_surface.outward``.

        Args:
            points: (n, 3) m.
            triangles: (t, 3) rows of points.
            density: kg/m^3.

        Raises:
            SceneError: the surface is open, its triangles disagree which side is out, or it encloses no volume.
        """
        density = _positive(density)
        x, corners = outward(points, triangles)
        volume, centre, second = enclosed_moments(x, corners)
        return cls(density * volume, volume, centre, density * second, outline=Outline(x, corners, np.ones(3)))

    @classmethod
    def _even(cls, volume: float, squares: ArrayLike, density: float, outline: Outline) -> Solid:
        mass = _positive(density) * volume
        return cls(mass, volume, np.zeros(3), mass * np.diag(squares), outline=outline)

    @property
    def density(self) -> float:
        """kg/m^3, in the mean."""
        return self.mass / self.volume

    @checked()
    @looked_at()
    def scaled(self, factor: float) -> Solid:
        """The same solid, ``factor`` times as dense."""
        return replace(self, mass=_positive(factor) * self.mass, second=factor * self.second)

    @looked_at()
    def moved(self, p: FloatArray, R: FloatArray) -> Solid:
        """The solid turned by R (3, 3) about the origin, then shifted by p (3,) m; without its outline.

        Raises:
            SceneError: p or R is of another shape, or not finite.
        """
        place, turn = shaped_numbers(p, (3,), "p"), shaped_numbers(R, (3, 3), "R")
        return Solid(self.mass, self.volume, turn @ self.com + place, _symmetric(turn @ self.second @ turn.T))

    @cached_property
    def inertia(self) -> FloatArray:
        """(3, 3) kg m^2 about the centre of mass (eq. 8.19)."""
        return np.trace(self.second) * np.eye(3) - self.second


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal moments (3,) of an inertia (3, 3), ascending, and the rotation from their axes to its own.

    The third axis is the first times the second; of the others the largest component is positive.
    """
    moments, axes = np.linalg.eigh(inertia)
    for k in range(2):
        axes[:, k] *= np.sign(axes[np.argmax(abs(axes[:, k])), k])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


@cache
def _unit_box() -> tuple[FloatArray, IntArray]:
    """Points and triangles of a box of sides one."""
    points = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, np.array([corners for a, b, c, d in sides for corners in ((a, b, c), (a, c, d))])


@cache
def unit_ball(rings: int = _RINGS, around: int = _AROUND) -> tuple[FloatArray, IntArray]:
    """Points and triangles of a ball of radius one: rings about z, and two poles."""
    down, round_ = np.pi * np.arange(1, rings) / rings, 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(round_), np.sin(round_), np.zeros(around)], axis=1)
    places = np.sin(down)[:, None, None] * ring + np.cos(down)[:, None, None] * [0.0, 0.0, 1.0]
    points = np.vstack([places.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    rows = np.arange((rings - 1) * around).reshape(rings - 1, around)
    after = np.roll(rows, -1, axis=1)
    top, bottom = np.full(around, rows.size), np.full(around, rows.size + 1)
    bands = [
        (top, rows[0], after[0]),
        (rows[:-1], rows[1:], after[1:]),
        (rows[:-1], after[1:], after[:-1]),
        (bottom, after[-1], rows[-1]),
    ]
    return points, np.vstack([np.stack([part.ravel() for part in band], axis=1) for band in bands])


@cache
def unit_tube(bore: float = 0.0, sides: int = _SIDES) -> tuple[FloatArray, IntArray]:
    """Points and triangles of a tube of outer radius and length one about the origin along z; bore 0: a cylinder."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1)
    up = np.array([0.0, 0.0, 0.5])
    here = np.arange(sides)
    after = np.roll(here, -1)
    low, high = here, here + sides
    faces = [(low, after, high), (after, after + sides, high)]
    if bore == 0.0:
        points = np.vstack([ring - up, ring + up, [-up, up]])
        foot, head = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
        faces += [(foot, after, low), (head, high, after + sides)]
    else:
        points = np.vstack([ring - up, ring + up, bore * ring - up, bore * ring + up])
        n = 2 * sides
        faces += [(low + n, high + n, after + n), (after + n, high + n, after + high[0] + n)]
        faces += [(low, low + n, after), (after, low + n, after + n)]
        faces += [(high, after + sides, high + n), (after + sides, after + sides + n, high + n)]
    return points, np.vstack([np.stack(part, axis=1) for part in faces])


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.T)


def _lengths(values: ArrayLike, what: str) -> FloatArray:
    a = numbers(values)
    if a.shape != (3,) or not np.isfinite(a).all() or (a <= 0.0).any():
        raise SceneError(f"{what} must be three positive numbers (m), got {values!r}")
    return a


def _positive(density: float) -> float:
    if not (is_number(density) and density > 0.0):
        raise SceneError(f"density must be positive (kg/m^3), got {density}")
    return float(density)
