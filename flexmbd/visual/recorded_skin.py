"""The surface of a body with history in a film: deforming, coloured by a field of its recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.interiors.observed import InteriorMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_QUANTITIES = {"von_mises": ("von Mises stress", "Pa"), "contact_pressure": ("contact pressure", "Pa")}


@checked(error=PictureError)
@dataclass(frozen=True)
class Look:
    """How a film shows a body with history.

    Attributes:
        colour: the field that colours it; of a vector or tensor its length (Frobenius norm).
        mirror: axes, as "xy": the body is a half, quarter or eighth, and shown with its images in the inertial planes
            through the origin that are normal to them.

    Raises:
        PictureError: other axes.
    """

    colour: str = "von_mises"
    mirror: str = ""

    def __post_init__(self) -> None:
        if set(self.mirror) - set("xyz") or len(set(self.mirror)) < len(self.mirror):
            raise PictureError(f"a body is mirrored along axes out of 'xyz', got {self.mirror!r}")


@runtime_checkable
class FieldSeries(Protocol):
    """Fields of a body with history over time; a `BodyRecording` is one."""

    @property
    def body(self) -> ContinuumBody | None:
        """Whose they are."""

    @property
    def name(self) -> str:
        """Of the body."""

    @property
    def t(self) -> FloatArray:
        """(nt,) s, the instants."""

    @property
    def mesh(self) -> InteriorMesh:
        """The undeformed nodes, and the surface."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields."""

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """(nt, 3) m and (nt, 3, 3): the body axes."""

    def values(self, field: str, /) -> FloatArray:
        """(nt, nodes) or (nt, nodes, m), a field at all nodes and instants."""


@dataclass(frozen=True, eq=False)
class RecordedSkin:
    """The surface of a recorded body in inertial axes, linear between the instants.

    Attributes:
        label: the body's name.
        covers: the rigid bodies of its frames.
        quantity: what the colours mean and its SI unit.
        x: (v, 3) m, undeformed vertices.
        triangle: (t, 3) vertices, oriented outwards.
        instants: (ni,) s.
        times: (nt,) s, of the pictures.
        places: (ni, v, 3) m, single precision.
        rigid: (ni, v, 3) m, where they would be undeformed, single precision.
        amplification: factor on the deformation in ``places``.
        colours: (ni, v), single precision.
    """

    label: str
    covers: tuple[Body, ...]
    quantity: tuple[str, str]
    x: FloatArray
    triangle: IntArray
    instants: FloatArray
    times: FloatArray
    places: NDArray[np.float32]
    rigid: NDArray[np.float32]
    amplification: float
    colours: NDArray[np.float32]
    colour = None
    turns = True

    @property
    def pose(self) -> FloatArray:
        """(nt, 4, 4): its axes are inertial ones."""
        return np.broadcast_to(np.eye(4), (len(self.times), 4, 4))

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the vertices over all instants."""
        return np.array([self.places.min(axis=(0, 1)), self.places.max(axis=(0, 1))], dtype=np.float64)

    @property
    def largest(self) -> float:
        """The largest value on the surface over all instants."""
        return float(self.colours.max())

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The vertices (v, 3) m and their values (v,) at picture k."""
        return self._now(self.places, k), self._now(self.colours, k)

    def displacement(self, k: int) -> FloatArray:
        """(v, 3) m against the body's axes at picture k, not amplified."""
        moved = self._now(self.places, k) - self._now(self.rigid, k)
        return np.asarray(moved / self.amplification) if self.amplification else np.zeros_like(moved)

    def _now(self, part: NDArray[np.float32], k: int) -> FloatArray:
        row, share = _between(self.instants, float(self.times[k]))
        after = min(row + 1, len(self.instants) - 1)
        return np.asarray((1.0 - share) * part[row] + share * part[after], dtype=np.float64)


def recorded_skin(series: FieldSeries, times: FloatArray, look: Look, *, amplification: float) -> RecordedSkin:
    """The surface of a body at the pictures' times (nt,) s.

    Raises:
        PictureError: the body has no field of that name.
    """
    if look.colour not in series.fields:
        raise PictureError(
            f"body {series.name!r} cannot be coloured by {look.colour!r}; its fields are {', '.join(series.fields)}"
        )
    mesh, (p, R) = series.mesh, series.pose()
    shown, triangle = np.unique(mesh.triangle, return_inverse=True)
    triangle = triangle.reshape(-1, 3)
    moved, rigid = series.values("position")[:, shown], p[:, None] + mesh.x[shown] @ R.transpose(0, 2, 1)
    places = rigid + amplification * (moved - rigid)
    values = series.values(look.colour)[:, shown]
    if values.ndim > 2:
        values = np.linalg.norm(values, axis=2)
    x = mesh.x[shown] @ R[0].T + p[0]
    for axis in look.mirror:
        _, rigid, _ = _mirrored(x, rigid, triangle, "xyz".index(axis))
        x, places, triangle = _mirrored(x, places, triangle, "xyz".index(axis))
        values = np.hstack([values, values])
    body = series.body
    return RecordedSkin(
        label=series.name,
        covers=() if body is None else body.parts,
        quantity=_QUANTITIES.get(look.colour, (look.colour.replace("_", " "), "")),
        x=x,
        triangle=triangle,
        instants=series.t,
        times=times,
        places=places.astype(np.float32),
        rigid=rigid.astype(np.float32),
        amplification=amplification,
        colours=values.astype(np.float32),
    )


def look_of(looks: Mapping[ContinuumBody, Look], series: FieldSeries) -> Look:
    """The look of a body; the default one where none is given."""
    return next((look for body, look in looks.items() if body is series.body), Look())


def refuse_unknown(looks: Mapping[ContinuumBody, Look], recordings: Sequence[FieldSeries]) -> None:
    """Raise PictureError where a body was given a look and not recorded."""
    for body in looks:
        if not any(body is one.body for one in recordings):
            raise PictureError(
                f"body {body.name!r} cannot be shown: it was not recorded; simulate with recording=fm.Recording(...)"
            )


def _mirrored(
    x: FloatArray, places: FloatArray, triangle: IntArray, axis: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Vertices, places and triangles with their image in the plane normal to an axis."""
    sign = np.ones(3)
    sign[axis] = -1.0
    twice = np.vstack([triangle, triangle[:, ::-1] + len(x)])
    return np.vstack([x, sign * x]), np.concatenate([places, sign * places], axis=1), twice


def _between(instants: FloatArray, t: float) -> tuple[int, float]:
    """The row of the instant before t (s), and the share of the way to the next."""
    if len(instants) == 1:
        return 0, 0.0
    row = int(np.clip(np.searchsorted(instants, t, side="right") - 1, 0, len(instants) - 2))
    return row, float(np.clip((t - instants[row]) / (instants[row + 1] - instants[row]), 0.0, 1.0))
