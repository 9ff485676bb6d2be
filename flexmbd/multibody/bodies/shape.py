"""Shapes of bodies: closed surfaces of triangles in body axes, for pictures, and for the mass of what they enclose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers, refuse_other
from flexmbd.multibody.bodies.closed_surface import whole_rows
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.multibody.bodies.triangle_file import read_triangles
from flexmbd.portraits import portraits
from flexmbd.rotation import Axis, check_rotation, z_onto

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ORIGIN = (0.0, 0.0, 0.0)
_TILES = 8  # along each side of a floor
_FLOOR = ("#d9dde1", "#c4cad0")
_SPOKES = 6


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface in the axes of the body that it belongs to.

    Shapes add up to one of several parts: ``Shape.box(...) + Shape.sphere(...)``.  A shape says nothing about a body's
    mass unless that is asked of it: ``shape.solid(density=7850.0)``, ``RigidBody.from_shape(shape, density=7850.0)``.

    Attributes:
        points: (n, 3) m, in body axes.
        triangles: (t, 3) rows of points, oriented outwards.
        colour: "#rrggbb", or None for the one that a picture gives the body.
        unit: the solid of density 1 kg/m^3 inside, where it is known in closed form; None where the surface tells it.
        parts: the shapes that it is put together of; () of a single one.

    Raises:
        SceneError: arrays that do not fit, or a colour of another form.
    """

    points: FloatArray
    triangles: IntArray
    colour: str | None = field(default=None, kw_only=True)
    unit: Solid | None = field(default=None, kw_only=True)
    parts: tuple[Shape, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        x, rows = numbers(self.points), np.asarray(self.triangles)
        if x.ndim != 2 or x.shape[1] != 3 or len(x) == 0 or not np.isfinite(x).all():
            raise SceneError(f"points of a shape must be finite numbers of shape (n, 3) (m), got shape {x.shape}")
        if rows.ndim != 2 or rows.shape[1:] != (3,) or len(rows) == 0 or not np.issubdtype(rows.dtype, np.integer):
            raise SceneError(f"triangles must be whole numbers of shape (t, 3), t > 0, got {rows.dtype} {rows.shape}")
        if rows.min() < 0 or rows.max() >= len(x):
            raise SceneError(f"triangles must name points 0 to {len(x) - 1}, got {rows.min()} to {rows.max()}")
        if self.colour is not None and not _is_colour(self.colour):
            raise SceneError(f'the colour of a shape is a text as "#4c72b0", got {self.colour!r}')
        object.__setattr__(self, "points", x)
        object.__setattr__(self, "triangles", rows.astype(np.int64))

    def __repr__(self) -> str:
        """How large it is."""
        size = " x ".join(f"{side:.4g}" for side in np.ptp(self.points, axis=0))
        return f"<Shape of {len(self.triangles)} triangles, {size} m>"

    @classmethod
    def box(
        cls, sides: ArrayLike, *, at: ArrayLike = _ORIGIN, R: ArrayLike | None = None, colour: str | None = None
    ) -> Shape:
        """A box of sides (3,) m along the axes, its middle ``at`` (3,) m, turned by ``R`` (3, 3) about it."""
        return cls._of(Solid.box(sides, density=1.0), at, R, colour)

    @classmethod
    def sphere(cls, radius: float, *, at: ArrayLike = _ORIGIN, colour: str | None = None) -> Shape:
        """A ball of this radius (m) about ``at`` (3,) m."""
        r = _length(radius, "radius of a sphere")
        return cls._of(Solid.ellipsoid((r, r, r), density=1.0), at, None, colour)

    @classmethod
    def cylinder(
        cls,
        radius: float,
        length: float,
        *,
        axis: Axis = "z",
        at: ArrayLike = _ORIGIN,
        bore: float = 0.0,
        colour: str | None = None,
    ) -> Shape:
        """A round cylinder or, with a ``bore`` (m, its radius), a tube.

        Args:
            radius: m.
            length: m, along the axis.
            axis: "x", "y", "z" or a vector (3,).
            at: (3,) m, its middle.
            bore: m, inner radius, less than the outer one.
            colour: as "#4c72b0".
        """
        return cls._of(Solid.cylinder(radius, length, bore=bore, density=1.0), at, z_onto(axis), colour)

    @classmethod
    def rod(cls, start: ArrayLike, end: ArrayLike, radius: float, *, colour: str | None = None) -> Shape:
        """A round rod from one point (3,) m to another."""
        a, b = _place(start, "start of a rod"), _place(end, "end of a rod")
        length = float(np.linalg.norm(b - a))
        if not length > 0.0:
            raise SceneError(f"a rod needs two ends that differ, got {start!r} twice")
        x, y, z = map(float, b - a)
        return cls.cylinder(radius, length, axis=(x, y, z), at=0.5 * (a + b), colour=colour)

    @classmethod
    def wheel(
        cls, radius: float, width: float, *, axis: Axis = "y", at: ArrayLike = _ORIGIN, colour: str | None = None
    ) -> Shape:
        """A spoked wheel: rim, hub and six spokes, so that a picture shows how far it has turned.

        Args:
            radius: m.
            width: m, along the axis.
            axis: "x", "y", "z" or a vector (3,).
            at: (3,) m, its centre.
            colour: as "#4c72b0".
        """
        r, w = _length(radius, "radius of a wheel"), _length(width, "width of a wheel")
        inner, hub = 0.78 * r, 0.2 * r
        parts = [cls.cylinder(r, w, bore=inner, colour=colour), cls.cylinder(hub, 1.1 * w, colour=colour)]
        for angle in 2.0 * np.pi * np.arange(_SPOKES) / _SPOKES:
            e = np.array([np.cos(angle), np.sin(angle), 0.0])
            turn = np.column_stack([e, np.cross((0.0, 0.0, 1.0), e), (0.0, 0.0, 1.0)])
            sides = (inner - hub, 0.1 * r, 0.4 * w)
            parts.append(cls.box(sides, at=0.5 * (inner + hub) * e, R=turn, colour=colour))
        return cls._together(parts).moved(at, R=z_onto(axis))

    @classmethod
    def floor(cls, size: ArrayLike, *, normal: Axis = "z", at: ArrayLike = _ORIGIN, colour: str | None = None) -> Shape:
        """A flat floor of tiles, size (2,) m, about ``at`` (3,) m; for the ground.  It encloses no volume."""
        sides = numbers(size)
        if sides.shape != (2,) or not np.isfinite(sides).all() or not (sides > 0.0).all():
            raise SceneError(f"the size of a floor is two positive numbers (m), got {size!r}")
        grid = np.linspace(-0.5, 0.5, _TILES + 1)
        x = np.array([[a * sides[0], b * sides[1], 0.0] for a in grid for b in grid])
        i, j = np.meshgrid(np.arange(_TILES), np.arange(_TILES), indexing="ij")
        a, row = (i * (_TILES + 1) + j).ravel(), _TILES + 1
        tiles = np.stack([a, a + row, a + row + 1, a, a + row + 1, a + 1], axis=1).reshape(-1, 2, 3)
        dark = ((i + j) % 2).ravel() == 1
        light, shade = (colour, colour) if colour is not None else _FLOOR
        parts = [cls(x, tiles[which].reshape(-1, 3), colour=one) for which, one in ((~dark, light), (dark, shade))]
        return cls._together(parts).moved(at, R=z_onto(normal))

    @classmethod
    def of_solid(cls, solid: Solid, *, colour: str | None = None) -> Shape:
        """The surface of a solid, as ``flexmbd.continuum`` makes it of a mesh.

        Raises:
            SceneError: the solid is known by its mass integrals alone.
        """
        refuse_other(solid, Solid, "solid", wanted="a Solid")
        if solid.outline is None:
            raise SceneError("the solid is known by its mass integrals alone: it has no outline to be shown by")
        return cls(solid.outline.x, solid.outline.triangles, colour=colour, unit=solid.scaled(1.0 / solid.density))

    @classmethod
    def from_surface(cls, points: ArrayLike, triangles: ArrayLike, *, colour: str | None = None) -> Shape:
        """Any surface of triangles: points (n, 3) m and rows (t, 3) of them."""
        return cls(numbers(points), whole_rows(triangles), colour=colour)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        scale: float = 1.0,
        at: ArrayLike = _ORIGIN,
        R: ArrayLike | None = None,
        colour: str | None = None,
    ) -> Shape:
        """The surface in an .stl, .obj, .ply or .vtp file; read by pyvista. Not collective.

        Args:
            path: of the file.
            scale: m per unit of the file, 1e-3 for one in mm.
            at: (3,) m, where the file's origin is in body axes.
            R: (3, 3) from the file's axes to the body's.
            colour: as "#4c72b0".

        Raises:
            SceneError: the file is missing, of another kind, or holds no triangles; or pyvista is not installed.
        """
        points, triangles = read_triangles(path)
        return cls(_length(scale, "scale of a shape") * points, triangles, colour=colour).moved(at, R=R)

    def moved(self, at: ArrayLike = _ORIGIN, *, R: ArrayLike | None = None) -> Shape:
        """The shape turned by ``R`` (3, 3) about the body's origin, then shifted by ``at`` (3,) m."""
        p = _place(at, "place of a shape")
        turn = np.eye(3) if R is None else check_rotation(R, "rotation of a shape")
        return replace(
            self,
            points=self.points @ turn.T + p,
            unit=None if self.unit is None else self.unit.moved(p, turn),
            parts=tuple(part.moved(p, R=turn) for part in self.parts),
        )

    def __add__(self, other: Shape) -> Shape:
        """Both together."""
        refuse_other(other, Shape, "what is added to a shape", wanted="a Shape")
        return self._together([*self.pieces(), *other.pieces()])

    def pieces(self) -> tuple[Shape, ...]:
        """The single shapes that it consists of."""
        return self.parts or (self,)

    def solid(self, *, density: float) -> Solid:
        """The solid that it encloses, of this density (kg/m^3); of several parts the sum, overlaps counted twice.

        Raises:
            SceneError: a part is not closed, or encloses no volume; the message names edges.
        """
        solids = [one._enclosed(density) for one in self.pieces()]
        return solids[0] if len(solids) == 1 else Solid.together(solids)

    def _enclosed(self, density: float) -> Solid:
        if self.unit is not None:
            return self.unit.scaled(density)
        return Solid.from_surface(self.points, self.triangles, density=density)

    @classmethod
    def _of(cls, solid: Solid, at: ArrayLike, R: ArrayLike | None, colour: str | None) -> Shape:
        if solid.outline is None:
            raise SceneError("the solid has no outline to be shown by")
        return cls(solid.outline.x, solid.outline.triangles, colour=colour, unit=solid).moved(at, R=R)

    def show(
        self, *, path: str | Path | None = None, size: tuple[int, int] = (1280, 720), view: ArrayLike | None = None
    ) -> Path | None:
        """Show the shape in a window or a notebook; or write it to ``path``, a .png. Not collective.

        Raises:
            PictureError: there is no display, or the file cannot be written.
        """
        return portraits().present(portraits().shape_scene(self), path=path, size=size, view=view)

    @classmethod
    def _together(cls, parts: Sequence[Shape]) -> Shape:
        starts = np.cumsum([0, *(len(part.points) for part in parts)])
        rows = [part.triangles + start for part, start in zip(parts, starts, strict=False)]
        return cls(np.vstack([part.points for part in parts]), np.vstack(rows), parts=tuple(parts))


def refuse_no_shape(name: str, value: object, owner: str) -> None:
    """Raise SceneError where an attribute of a body called "shape" is given something else."""
    if name == "shape" and value is not None:
        refuse_other(value, Shape, f"the shape of {owner}", wanted="a Shape as fm.Shape.box((0.1, 0.1, 0.1))")


def _is_colour(text: object) -> bool:
    digits = set("0123456789abcdefABCDEF")
    return isinstance(text, str) and len(text) == 7 and text[0] == "#" and set(text[1:]) <= digits


def _place(values: ArrayLike, what: str) -> FloatArray:
    p = numbers(values)
    if p.shape != (3,) or not np.isfinite(p).all():
        raise SceneError(f"the {what} must be three finite numbers (m), got {values!r}")
    return p


def _length(value: float, what: str) -> float:
    if not (is_number(value) and 0.0 < value < np.inf):
        raise SceneError(f"the {what} must be positive (m), got {value!r}")
    return float(value)
