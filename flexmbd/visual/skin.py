"""The surfaces of flexible bodies on their way: places and colours, instant by instant."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.results.heat_factors import heat_factors, heated_stress_field
from flexmbd.record.reduced_body import ReducedBody, Surface
from flexmbd.record.stress_field import StressField, StressModel
from flexmbd.visual.part import body_pose, bounds_of
from flexmbd.visual.recorded_motion import RecordedMotion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class DisplacementSkin:
    """A record's surface, coloured by the length of the displacement against the body frame.

    Attributes:
        label: the body's name.
        covers: the body, where it is one of a machine.
        x: (v, 3) m, undeformed vertices.
        triangle: (t, 3) vertices, oriented outwards.
        phi: (v, 3, n) their modes.
        drawn: (v, 3, n) the same with the deformation amplified.
        q: (nt, n) modal coordinates.
        pose: (nt, 4, 4) from the body's axes to inertial ones.
        quantity: what the values are and their unit.
    """

    label: str
    covers: tuple[Body, ...]
    x: FloatArray
    triangle: IntArray
    phi: FloatArray
    drawn: FloatArray
    q: FloatArray
    pose: FloatArray
    quantity: tuple[str, str] = ("displacement", "m")
    colour = None
    turns = False

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices over all instants."""
        return bounds_of([self.x + self.drawn @ row for row in self.q])

    @cached_property
    def largest(self) -> float:
        """The largest displacement (m) over all instants."""
        return max(float(self.at(k)[1].max()) for k in range(len(self.q)))

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and the length of their displacement (v,) m at instant k."""
        return self.x + self.drawn @ self.q[k], np.linalg.norm(self.phi @ self.q[k], axis=1)

    def displacement(self, k: int) -> FloatArray:
        """(v, 3) m at instant k, not amplified."""
        return self.phi @ self.q[k]


@dataclass(frozen=True, eq=False)
class StressSkin:
    """A model's surface, coloured by von Mises stress.

    Attributes:
        label: the body's name.
        covers: the body, where it is one of a machine.
        x: (v, 3) m, undeformed vertices.
        triangle: (t, 3) vertices, oriented outwards.
        places: (nt, v, 3) m, the drawn vertices, single precision.
        moved: (nt, v, 3) m, their displacements, not amplified, single precision.
        von_mises: (nt, v) Pa, single precision.
        pose: (nt, 4, 4) from the body's axes to inertial ones.
    """

    label: str
    covers: tuple[Body, ...]
    x: FloatArray
    triangle: IntArray
    places: NDArray[np.float32]
    moved: NDArray[np.float32]
    von_mises: NDArray[np.float32]
    pose: FloatArray
    colour = None
    quantity = ("von Mises stress", "Pa")
    turns = False

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices over all instants."""
        return bounds_of(list(self.places))

    @property
    def largest(self) -> float:
        """The largest stress (Pa) on the surface over all instants."""
        return float(self.von_mises.max())

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and their von Mises stress (v,) Pa at instant k."""
        return self.places[k].astype(np.float64), self.von_mises[k].astype(np.float64)

    def displacement(self, k: int) -> FloatArray:
        """(v, 3) m at instant k, not amplified."""
        return self.moved[k].astype(np.float64)


def skins(
    motion: RecordedMotion,
    times: FloatArray,
    models: Mapping[FlexibleBody, StressModel],
    *,
    amplification: float,
    beside: Collection[Body] = (),
) -> list[DisplacementSkin | StressSkin]:
    """Surfaces of the bodies that have one and no shape, at ``times`` (nt,) s; none of ``beside``.

    What is amplified is the deformation beyond the rigid motion that follows the interfaces, so
    that bodies stay where joints hold them.

    Collective over the models' communicators where there are models.
    """
    found: list[DisplacementSkin | StressSkin] = []
    for name, body in motion.bodies.items():
        if any(body is other for other in beside):
            continue
        record = body.reduced()
        surface = surface_of(body)
        model = next((m for b, m in models.items() if b is body), None)
        if model is not None and record is not None:
            pose = body_pose(motion, body, times)
            heat = heat_factors(motion.scene, body, record, times)
            found.append(_stress_skin(body, record, model, motion.q(body, t=times), heat, pose, amplification))
        elif surface is not None and (body.shape is None or isinstance(body, PseudoRigidBody)):
            q = np.zeros((len(times), 0)) if record is None else motion.q(body, t=times)
            drawn = surface.phi if record is None else amplified(record, surface, amplification)
            pose = body_pose(motion, body, times)
            found.append(DisplacementSkin(name, (body,), surface.x, surface.triangle, surface.phi, drawn, q, pose))
    return found


def amplified(record: ReducedBody, surface: Surface, amplification: float) -> FloatArray:
    """(v, 3, n) modes of a record's surface, amplified beyond the rigid motion that follows the interfaces."""
    rigid = _rigid_motion(record, surface.x)
    return rigid + amplification * (surface.phi - rigid)


def surface_of(body: Body) -> Surface | None:
    """The drawn surface of a body: its record's, or a pseudo-rigid body's own; None for sticks."""
    if isinstance(body, PseudoRigidBody):
        return body.surface
    record = body.reduced()
    return None if record is None else record.surface


def _stress_skin(
    body: Body,
    record: ReducedBody,
    model: StressModel,
    q: FloatArray,
    heat: Mapping[str, FloatArray],
    pose: FloatArray,
    amplification: float,
) -> StressSkin:
    pictures = (heated_stress_field(model, record, row, heat, k) for k, row in enumerate(q))
    first = next(pictures)
    shown, triangle = np.unique(first.triangle, return_inverse=True)
    x = first.x[shown]
    rigid = _rigid_motion(record, x)
    places, moved = np.empty((2, len(q), len(shown), 3), np.float32)
    von_mises = np.empty((len(q), len(shown)), np.float32)
    for k, picture in enumerate((first, *pictures)):
        followed = rigid @ q[k]
        moved[k] = picture.displacement[shown]
        places[k] = x + followed + amplification * (picture.displacement[shown] - followed)
        von_mises[k] = picture.von_mises[shown]
    return StressSkin(body.name, (body,), x, triangle.reshape(-1, 3), places, moved, von_mises, pose)


def field_skin(field: StressField, amplification: float) -> StressSkin:
    """The surface of a stress field, at its one instant, in its own axes."""
    shown, triangle = np.unique(field.triangle, return_inverse=True)
    moved = field.displacement[shown].astype(np.float32)
    places = (field.x[shown] + amplification * field.displacement[shown]).astype(np.float32)
    values = field.von_mises[shown].astype(np.float32)
    parts = (places[None], moved[None], values[None], np.eye(4)[None])
    return StressSkin("body", (), field.x[shown], triangle.reshape(-1, 3), *parts)


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
