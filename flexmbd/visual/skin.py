"""The surfaces of flexible bodies on their way: places and colours, instant by instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.record.reduced_body import ReducedBody, Surface
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.stress_picture import StressModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Skin(Protocol):
    """A coloured surface of ``v`` vertices."""

    @property
    def body(self) -> Body | None:
        """In whose axes the vertices are; None: in inertial ones."""

    @property
    def covers(self) -> tuple[Body, ...]:
        """The bodies that it shows, which are not drawn as sticks then."""

    @property
    def quantity(self) -> tuple[str, str]:
        """What the colours mean and its SI unit."""

    @property
    def x(self) -> FloatArray:
        """(v, 3) m, undeformed vertices."""

    @property
    def triangle(self) -> IntArray:
        """(t, 3) vertices, oriented outwards."""

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices over all instants."""

    @property
    def largest(self) -> float:
        """The largest value over all instants."""

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and their values (v,) at instant k."""


@dataclass(frozen=True, eq=False)
class DisplacementSkin:
    """A record's surface, coloured by the length of the displacement against the body frame.

    Attributes:
        body: whose surface.
        x: (v, 3) m, undeformed vertices.
        triangle: (t, 3) vertices, oriented outwards.
        phi: (v, 3, n) their modes.
        drawn: (v, 3, n) the same with the deformation amplified.
        q: (nt, n) modal coordinates.
    """

    body: Body
    x: FloatArray
    triangle: IntArray
    phi: FloatArray
    drawn: FloatArray
    q: FloatArray
    quantity = ("displacement", "m")

    @property
    def covers(self) -> tuple[Body, ...]:
        """The body alone."""
        return (self.body,)

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices over all instants."""
        return _bounds([self.x + self.drawn @ row for row in self.q])

    @cached_property
    def largest(self) -> float:
        """The largest displacement (m) over all instants."""
        return max(float(self.at(k)[1].max()) for k in range(len(self.q)))

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and the length of their displacement (v,) m at instant k."""
        return self.x + self.drawn @ self.q[k], np.linalg.norm(self.phi @ self.q[k], axis=1)


@dataclass(frozen=True, eq=False)
class StressSkin:
    """A model's surface, coloured by von Mises stress.

    Attributes:
        body: whose surface.
        x: (v, 3) m, undeformed vertices.
        triangle: (t, 3) vertices, oriented outwards.
        places: (nt, v, 3) m, the drawn vertices, single precision.
        von_mises: (nt, v) Pa, single precision.
    """

    body: Body
    x: FloatArray
    triangle: IntArray
    places: NDArray[np.float32]
    von_mises: NDArray[np.float32]
    quantity = ("von Mises stress", "Pa")

    @property
    def covers(self) -> tuple[Body, ...]:
        """The body alone."""
        return (self.body,)

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices over all instants."""
        return _bounds(list(self.places))

    @property
    def largest(self) -> float:
        """The largest stress (Pa) on the surface over all instants."""
        return float(self.von_mises.max())

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and their von Mises stress (v,) Pa at instant k."""
        return self.places[k].astype(np.float64), self.von_mises[k].astype(np.float64)


def skins(
    trajectory: RecordedMotion,
    times: FloatArray,
    models: Mapping[FlexibleBody, StressModel],
    *,
    amplification: float,
) -> list[Skin]:
    """Surfaces of the bodies that have one, at ``times`` (nt,).

    What is amplified is the deformation beyond the rigid motion that follows the interfaces, so
    that bodies stay where joints hold them.

    Collective over the models' communicators where there are models.
    """
    found: list[Skin] = []
    for body in trajectory.bodies.values():
        record, surface = body.reduced(), surface_of(body)
        if record is None:
            if surface is not None:
                none = np.zeros((len(times), 0))
                found.append(DisplacementSkin(body, surface.x, surface.triangle, surface.phi, surface.phi, none))
            continue
        q = trajectory.q(body, t=times)
        model = next((m for b, m in models.items() if b is body), None)
        if model is not None:
            found.append(_stress_skin(body, record, model, q, amplification))
        elif surface is not None:
            rigid = _rigid_motion(record, surface.x)
            drawn = rigid + amplification * (surface.phi - rigid)
            found.append(DisplacementSkin(body, surface.x, surface.triangle, surface.phi, drawn, q))
    return found


def surface_of(body: Body) -> Surface | None:
    """What is drawn of a body: its record's surface, or a pseudo-rigid body's own; None for sticks."""
    if isinstance(body, PseudoRigidBody):
        return body.surface
    record = body.reduced()
    return None if record is None else record.surface


def _stress_skin(
    body: Body, record: ReducedBody, model: StressModel, q: FloatArray, amplification: float
) -> StressSkin:
    pictures = (model.stress_field(record, row) for row in q)
    first = next(pictures)
    shown, triangle = np.unique(first.triangle, return_inverse=True)
    x = first.x[shown]
    rigid = _rigid_motion(record, x)
    places = np.empty((len(q), len(shown), 3), np.float32)
    von_mises = np.empty((len(q), len(shown)), np.float32)
    for k, picture in enumerate((first, *pictures)):
        followed = rigid @ q[k]
        places[k] = x + followed + amplification * (picture.displacement[shown] - followed)
        von_mises[k] = picture.von_mises[shown]
    return StressSkin(body, x, triangle.reshape(-1, 3), places, von_mises)


def _rigid_motion(record: ReducedBody, x: FloatArray) -> FloatArray:
    """(v, 3, n) displacement at ``x`` (v, 3) of the small rigid motion nearest to the interfaces'.

    Nearest in the displacements of their origins; of several, that of the least norm.
    """
    if not record.interfaces:
        return np.zeros((len(x), 3, record.n_modes))
    origins = np.array([frame.p_BI_B for frame in record.interfaces])
    moved = np.array([frame.modes[:3] for frame in record.interfaces])
    motion, *_ = np.linalg.lstsq(_rigid_fields(origins).reshape(-1, 6), moved.reshape(-1, record.n_modes), rcond=1e-9)
    return _rigid_fields(x) @ motion


def _rigid_fields(x: FloatArray) -> FloatArray:
    """(v, 3, 6) displacement at x (v, 3) for unit translations and small unit rotations."""
    fields = np.zeros((len(x), 3, 6))
    fields[:, :, :3] = np.eye(3)
    for axis in range(3):
        fields[:, :, 3 + axis] = np.cross(np.eye(3)[axis], x)
    return fields


def _bounds(places: list[FloatArray]) -> FloatArray:
    lowest = np.min([p.min(axis=0) for p in places], axis=0)
    return np.array([lowest, np.max([p.max(axis=0) for p in places], axis=0)], dtype=np.float64)
