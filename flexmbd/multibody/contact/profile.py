"""A closed planar curve that is extruded along z: cams, Geneva wheels, ratchets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts load when they are asked for
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers, refuse_no_truth, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.contact.table_shape import TableShape, finite_points, tabulated
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.contact import planar_profile as at
from flexmbd.multibody.kernels.contact import signed_distance as kinds
from flexmbd.round_off import EQUAL, SEVEN_DIGITS

FloatArray = NDArray[np.float64]

_TURN = 0.25  # rad by which a curve's piece turns at most, so that one of its points is nearest
_CHORD = 0.05  # rad of a chord by which it is seen whether the curve crosses itself
_ROWS = 256  # of the chords that are compared with all others at once
_FEWEST = 3  # points of a spline
_MIDDLE = np.array([0.5])  # of a piece, behind which the thickness is looked for
_ALONG = np.array([0.1, 0.3, 0.5, 0.7, 0.9])  # of a piece, before which hollows are looked for


@dataclass(frozen=True, eq=False)
class Profile(TableShape):
    """A closed curve in the frame's xy plane, extruded along z without ends; what it encloses is inside.

    It runs through the points, from the last one back to the first, either way round.  Between two of them it is a
    line, an arc, or a part of a periodic cubic spline, whose curvature is continuous.  A sphere that touches it is as
    well a roller of the same radius with its axis along z.

    Attributes:
        frame: on a body or on the ground.
        points: (n, 2) m, in the frame's axes.
        bulges: (n,) of the arc after each point the tangent of a quarter of its angle, positive to the left, as in DXF
            files: 1 is a half circle anticlockwise, 0 a line; None: lines.
        spline: whether the curve is a spline through the points.

    Raises:
        SceneError: too few points; two neighbours at one place; a curve that crosses, touches or turns back on itself.
    """

    frame: Frame
    points: ArrayLike
    bulges: ArrayLike | None = None
    spline: bool = False

    _kind = kinds.PROFILE

    def __post_init__(self) -> None:
        refuse_other(self.frame, Frame, "the frame of a Profile", wanted="a frame as body.frame()")
        refuse_no_truth(spline=self.spline)
        _ = self.table  # built now: what is wrong is told where it is given

    @property
    def _what(self) -> str:
        return f"Profile on {self.frame.label}"

    def curvatures(self) -> tuple[float, float]:
        """Not one pair: see ``Hertz``."""
        raise SceneError(
            f"{self._what}: its curvature changes along it, and a roller touches it along a line, of which Hertz's law "
            "is not; take PowerLaw, as PowerLaw.bearing(load=..., depth=...)"
        )

    @cached_property
    def _pieces(self) -> list[_Piece]:
        x, bulges = self._given()
        ends = np.roll(x, -1, axis=0)
        lines = zip(x, ends, bulges, strict=True)
        pieces = _spline(x, self._what) if self.spline else [_segment(*one) for one in lines]
        chords = np.concatenate([piece.chords()[:-1] for piece in pieces])
        area = float(_cross(chords, np.roll(chords, -1, 0)).sum())
        if area < 0.0:
            pieces = [piece.reversed() for piece in reversed(pieces)]
        self._refuse_crossing(pieces)
        return pieces

    def _given(self) -> tuple[FloatArray, FloatArray]:
        """The points, the first not again at the end, and the bulges."""
        x = finite_points(self.points, 2, self._what)
        if self.bulges is not None and self.spline:
            raise SceneError(f"{self._what}: bulges are of arcs, and a spline has none; leave one out")
        bulges = np.zeros(len(x)) if self.bulges is None else numbers(self.bulges)
        if bulges.shape != (len(x),) or not np.isfinite(bulges).all():
            raise SceneError(f"{self._what}: bulges must be {len(x)} finite numbers, got {self.bulges!r:.100}")
        size = float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) else 0.0
        if len(x) > 1 and np.linalg.norm(x[0] - x[-1]) <= EQUAL * size:
            x, bulges = x[:-1], bulges[:-1]
        fewest = _FEWEST if self.spline or not bulges.any() else 2
        if len(x) < fewest:
            raise SceneError(f"{self._what}: {len(x)} points enclose nothing; it needs {fewest} or more")
        short = np.flatnonzero(np.linalg.norm(np.roll(x, -1, 0) - x, axis=1) <= EQUAL * size)
        if len(short):
            raise SceneError(f"{self._what}: point {short[0]} and the next one are at one place, {_place(x[short[0]])}")
        return x, bulges

    def _refuse_crossing(self, pieces: list[_Piece]) -> None:
        normals = np.array([piece.normals() for piece in pieces])  # at start and end
        corner = normals[:, 0] + np.roll(normals[:, 1], 1, axis=0)
        back = np.flatnonzero(np.linalg.norm(corner, axis=1) <= SEVEN_DIGITS)
        if len(back):
            raise SceneError(f"{self._what}: the curve turns back on itself at {_place(pieces[back[0]].start)}")
        x = np.concatenate([piece.chords()[:-1] for piece in pieces])
        place = _crossing(x)
        if place is not None:
            raise SceneError(f"{self._what}: the curve crosses or touches itself near {_place(place)}")

    @cached_property
    def table(self) -> SharedNumbers:
        """Its pieces."""
        pieces = self._pieces
        normals = np.array([piece.normals() for piece in pieces])
        corner = normals[:, 0] + np.roll(normals[:, 1], 1, axis=0)
        items = [
            np.array([piece.kind, *begin, *end, *piece.numbers()])
            for piece, begin, end in zip(pieces, corner, np.roll(corner, -1, axis=0), strict=True)
        ]
        boxes = np.array([piece.box() for piece in pieces])
        flat = np.zeros((len(pieces), 1))
        return tabulated(np.hstack([boxes[:, 0], flat]), np.hstack([boxes[:, 1], flat]), items)

    @cached_property
    def hollow(self) -> float:
        """m, the radius of the smallest ball that touches it at two points from outside; infinite: there is none.

        0 where it has a corner that is hollow by more than the kernels tell two points apart.
        """
        normals = np.array([piece.normals() for piece in self._pieces])
        before, after = np.roll(normals[:, 1], 1, axis=0), normals[:, 0]
        if ((_cross(before, after) < 0.0) & (np.sum(before * after, axis=1) < at.APART)).any():
            return 0.0
        x = np.concatenate([piece.at(_ALONG) for piece in self._pieces])
        n = np.concatenate([piece.normals_at(_ALONG) for piece in self._pieces])
        flat = np.zeros((len(x), 1))
        size = float(np.linalg.norm(np.ptp(x, axis=0)))
        radius, _ = self._balls(np.hstack([x, flat]), -np.hstack([n, flat]), self.table)
        return float(radius.min()) if radius.min() < size else np.inf

    def _behind(self) -> tuple[FloatArray, FloatArray, SharedNumbers]:
        x = np.concatenate([piece.at(_MIDDLE) for piece in self._pieces])
        n = np.concatenate([piece.normals_at(_MIDDLE) for piece in self._pieces])
        flat = np.zeros((len(x), 1))
        return np.hstack([x, flat]), np.hstack([n, flat]), self.table


@dataclass(frozen=True, eq=False)
class _Piece:
    """A part of the curve that is smooth.

    Attributes:
        start, end: (2,) m.
    """

    start: FloatArray
    end: FloatArray

    kind = at.LINE

    def numbers(self) -> FloatArray:
        """As ``kernels.contact.planar_profile`` has them."""
        length = np.linalg.norm(self.end - self.start)
        return np.array([*self.start, *((self.end - self.start) / length), length])

    def reversed(self) -> _Piece:
        """The other way."""
        return _Piece(self.end, self.start)

    def at(self, t: FloatArray) -> FloatArray:
        """(n, 2) points at t from 0 to 1."""
        return np.asarray(self.start + t[:, None] * (self.end - self.start))

    def normals_at(self, t: FloatArray) -> FloatArray:
        """(n, 2) unit normals, to the right."""
        return _right(np.tile(self.end - self.start, (len(t), 1)))

    def normals(self) -> FloatArray:
        """(2, 2) at its ends."""
        return self.normals_at(np.array([0.0, 1.0]))

    def turn(self) -> float:
        """rad, of the tangent from start to end, without sign."""
        return 0.0

    def chords(self) -> FloatArray:
        """Ends of chords that are next to it, its own included."""
        count = 1 + int(np.ceil(self.turn() / _CHORD))
        x = self.at(np.linspace(0.0, 1.0, count + 1, dtype=np.float64))
        x[0], x[-1] = self.start, self.end
        return x

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner of a box around it."""
        return np.minimum(self.start, self.end), np.maximum(self.start, self.end)


@dataclass(frozen=True, eq=False)
class _Arc(_Piece):
    """An arc.

    Attributes:
        bulge: tangent of a quarter of its angle.
    """

    bulge: float

    kind = at.ARC

    def _circle(self) -> tuple[FloatArray, float, float, float]:
        """Centre, radius, angle at the start, angle swept."""
        chord, b = self.end - self.start, self.bulge
        left = np.array([-chord[1], chord[0]])
        centre = 0.5 * (self.start + self.end) + left * (1.0 - b * b) / (4.0 * b)
        radius = float(np.linalg.norm(chord)) * (1.0 + b * b) / (4.0 * abs(b))
        first = self.start - centre
        return centre, radius, float(np.arctan2(first[1], first[0])), 4.0 * float(np.arctan(b))

    def numbers(self) -> FloatArray:
        """As ``kernels.contact.planar_profile`` has them."""
        centre, radius, first, swept = self._circle()
        middle, half, turn = first + 0.5 * swept, 0.5 * abs(swept), np.sign(swept)
        return np.array([*centre, radius, middle, half, turn, *self.start, *self.end])

    def reversed(self) -> _Arc:
        """The other way."""
        return _Arc(self.end, self.start, -self.bulge)

    def at(self, t: FloatArray) -> FloatArray:
        """(n, 2) points at t from 0 to 1."""
        centre, radius, first, swept = self._circle()
        angle = first + t * swept
        return np.asarray(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    def normals_at(self, t: FloatArray) -> FloatArray:
        """(n, 2) unit normals, to the right."""
        _, _, first, swept = self._circle()
        angle = first + t * swept
        return np.asarray(np.sign(swept) * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    def turn(self) -> float:
        """Its angle."""
        return abs(self._circle()[3])

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Around its ends and those of the circle's points farthest along the axes that are on it."""
        centre, radius, first, swept = self._circle()
        low, high = (first, first + swept) if swept > 0.0 else (first + swept, first)
        quarters = 0.5 * np.pi * np.arange(np.ceil(low / (0.5 * np.pi)), np.floor(high / (0.5 * np.pi)) + 1)
        far = centre + radius * np.stack([np.cos(quarters), np.sin(quarters)], axis=1)
        x = np.vstack([self.start, self.end, far])
        return x.min(axis=0), x.max(axis=0)


@dataclass(frozen=True, eq=False)
class _Curve(_Piece):
    """A part of a spline.

    Attributes:
        control: (4, 2) m, Bezier's control points.
    """

    control: FloatArray

    kind = at.CURVE

    @classmethod
    def of(cls, control: FloatArray) -> _Curve:
        """The cubic of these control points."""
        return cls(control[0], control[3], control)

    def numbers(self) -> FloatArray:
        """As ``kernels.contact.planar_profile`` has them."""
        a, b, c, d = self.control
        quartic = np.array([a, (a + 3.0 * b) / 4.0, (b + c) / 2.0, (3.0 * c + d) / 4.0, d])
        return np.hstack([quartic, np.zeros((5, 1))]).ravel()

    def reversed(self) -> _Curve:
        """The other way."""
        return _Curve.of(self.control[::-1])

    def at(self, t: FloatArray) -> FloatArray:
        """(n, 2) points at t from 0 to 1."""
        s = 1.0 - t
        return np.asarray(np.stack([s**3, 3.0 * s * s * t, 3.0 * s * t * t, t**3], axis=1) @ self.control)

    def normals_at(self, t: FloatArray) -> FloatArray:
        """(n, 2) unit normals, to the right."""
        s, legs = 1.0 - t, np.diff(self.control, axis=0)
        return _right(np.stack([s * s, 2.0 * s * t, t * t], axis=1) @ legs)

    def turn(self) -> float:
        """Of its control polygon, which turns at least as much."""
        legs = np.diff(self.control, axis=0)
        return float(np.abs(np.arctan2(_cross(legs[:-1], legs[1:]), np.sum(legs[:-1] * legs[1:], axis=1))).sum())

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Around its control points."""
        return self.control.min(axis=0), self.control.max(axis=0)

    def halves(self) -> tuple[_Curve, _Curve]:
        """Its two halves, by de Casteljau's scheme."""
        rows = [self.control]
        for _ in range(3):
            rows.append(0.5 * (rows[-1][:-1] + rows[-1][1:]))
        return (
            _Curve.of(np.array([row[0] for row in rows])),
            _Curve.of(np.array([row[-1] for row in reversed(rows)])),
        )


def _segment(start: FloatArray, end: FloatArray, bulge: float) -> _Piece:
    return _Piece(start, end) if bulge == 0.0 else _Arc(start, end, float(bulge))


def _spline(x: FloatArray, what: str) -> list[_Piece]:
    """The periodic cubic spline through the points by the length of chords, in pieces that turn little."""
    closed = np.vstack([x, x[:1]])
    chords = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    rates = scipy.interpolate.CubicSpline(knots, closed, bc_type="periodic")(knots, 1)
    waiting = [
        _Curve.of(np.array([a, a + h / 3.0 * ra, b - h / 3.0 * rb, b]))
        for a, b, ra, rb, h in zip(closed[:-1], closed[1:], rates[:-1], rates[1:], chords, strict=True)
    ][::-1]
    pieces: list[_Piece] = []
    while waiting:
        piece = waiting.pop()
        if not piece.turn() > _TURN:
            pieces.append(piece)
        elif np.linalg.norm(np.ptp(piece.control, axis=0)) > SEVEN_DIGITS * knots[-1]:
            waiting += reversed(piece.halves())
        else:
            raise SceneError(f"{what}: the spline has a cusp at {_place(piece.start)}; give more points there")
    return pieces


def _crossing(x: FloatArray) -> FloatArray | None:
    """A place (2,) at which the closed polygon of points (n, 2) crosses or touches itself; None: nowhere."""
    n, y = len(x), np.roll(x, -1, axis=0)
    low, high = np.minimum(x, y), np.maximum(x, y)
    for first in range(0, n, _ROWS):
        i = np.arange(first, min(first + _ROWS, n))
        near = (low[i, None] <= high[None]).all(axis=2) & (low[None] <= high[i, None]).all(axis=2)
        a, b = np.nonzero(near)
        a = a + first
        apart = (b - a) % n
        kept = (a < b) & (apart != 1) & (apart != n - 1)
        a, b = a[kept], b[kept]
        sides = [np.sign(_cross(y[p] - x[p], one[q] - x[p])) for p, q in ((a, b), (b, a)) for one in (x, y)]
        crossed = np.flatnonzero((sides[0] * sides[1] <= 0.0) & (sides[2] * sides[3] <= 0.0))
        if len(crossed):
            return np.asarray(0.5 * (x[a[crossed[0]]] + y[a[crossed[0]]]))
    return None


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _right(tangents: FloatArray) -> FloatArray:
    """Unit vectors to the right of tangents (n, 2)."""
    n = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    return np.asarray(n / np.linalg.norm(n, axis=1)[:, None])


def _place(x: FloatArray) -> str:
    return f"({x[0]:.6g}, {x[1]:.6g}) m"
