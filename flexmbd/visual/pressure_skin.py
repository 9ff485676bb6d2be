"""Surfaces of reduced bodies in a film, coloured by the contact pressure on their patches."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy  # its parts load when they are asked for
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.given import numbers, shown
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.groups import NodalModes
from flexmbd.record.reduced_body import ReducedBody, Surface
from flexmbd.round_off import SEVEN_DIGITS
from flexmbd.visual.part import body_pose
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.skin import DisplacementSkin, amplified

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Of times (nt,) s the pressures (nt, patches) Pa on the patches of the records of some bodies.
PressuresAt: TypeAlias = Callable[[FloatArray], Mapping[FlexibleBody, FloatArray]]

# Cosine of the angle up to which a triangle of the surface and the facet that it is part of are turned.
_TURNED = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class PressureSkin(DisplacementSkin):
    """A record's surface, coloured by the pressure on its patches, even over each: vertices between two are doubled.

    Attributes:
        patch: (v,) which of the record's patches each vertex is of; -1: of none.
        pressure: (nt, patches) Pa.
    """

    patch: IntArray
    pressure: FloatArray
    quantity: tuple[str, str] = ("contact pressure", "Pa")

    @property
    def largest(self) -> float:  # type: ignore[override]
        """The largest pressure (Pa) over all instants."""
        return float(self.pressure.max(initial=0.0))

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m and the pressure (v,) Pa at instant k."""
        values = np.append(self.pressure[k], 0.0)[self.patch]
        return self.x + self.drawn @ self.q[k], values


@dataclass(frozen=True, eq=False)
class PatchedSurface:
    """A surface whose vertices are each of one patch.

    Attributes:
        surface: the record's, or of a record without one its patches' facets.
        patch: (v,) of each vertex; -1: none.
    """

    surface: Surface
    patch: IntArray


def pressure_skins(
    motion: RecordedMotion,
    times: FloatArray,
    pressures: PressuresAt,
    *,
    amplification: float,
    coloured: Collection[FlexibleBody],
) -> list[PressureSkin]:
    """Surfaces of the bodies that have pressures, at ``times`` (nt,) s.

    Args:
        motion: of the machine.
        times: s.
        pressures: by body.
        amplification: as of ``skin.skins``.
        coloured: bodies that already have the colours of their stress.

    Raises:
        PictureError: such a body has pressures too; it is of another machine; what ``pressures`` gives is none.
    """
    found = []
    for body, pressure in _pressures_at(pressures, times).items():
        if not any(body is other for other in motion.bodies.values()):
            raise PictureError(f"body {body.name!r}, of which pressures are to be shown, is not in this machine")
        if any(body is other for other in coloured):
            raise PictureError(
                f"body {body.name!r} has one colour: of its stress, models={{body: model}}, or of what presses it, "
                "pressures=; draw two pictures"
            )
        record = body.record
        patched = patched_surface(record, body.name)
        surface = patched.surface
        found.append(
            PressureSkin(
                label=body.name,
                covers=() if record.surface is None else (body,),
                x=surface.x,
                triangle=surface.triangle,
                phi=surface.phi,
                drawn=amplified(record, surface, amplification),
                q=motion.q(body, t=times),
                pose=body_pose(motion, body, times),
                patch=patched.patch,
                pressure=pressure,
            )
        )
    return found


def _pressures_at(pressures: PressuresAt, times: FloatArray) -> Mapping[FlexibleBody, FloatArray]:
    """(nt, patches) Pa by body at times (nt,) s.

    Raises:
        PictureError: it is no function, or gives something else.
    """
    if isinstance(pressures, type) or not callable(pressures):
        raise PictureError(f"pressures must be a function of times (k,) s, got {shown(pressures)}")
    found = pressures(times)
    if not isinstance(found, Mapping) or not all(isinstance(body, FlexibleBody) for body in found):
        raise PictureError(f"pressures must give a mapping of flexible bodies to pressures, got {shown(found)}")
    checked = {body: numbers(pressure) for body, pressure in found.items()}
    for body, pressure in checked.items():
        count = 0 if body.record.contact is None else len(body.record.contact.area)
        if pressure.shape != (len(times), count):
            raise PictureError(
                f"pressures of body {body.name!r}, which has {count} patches, must be ({len(times)}, {count}) Pa at "
                f"{len(times)} times, got {pressure.shape}"
            )
    return checked


def patched_surface(record: ReducedBody, name: str) -> PatchedSurface:
    """The surface of a record, and the patches on it.

    Raises:
        PictureError: the record keeps no nodes, or its patches have no facets.
    """
    group, modes = record.contact, record.modes
    if group is None or modes is None or not len(group.facet):
        raise PictureError(
            f"the pressure on {name!r} cannot be drawn: its record does not hold where the facets of its patches are; "
            "reduce it with keep=Keep(surface=True, modes=True)"
        )
    triangle, patch = _facet_triangles(group, modes)
    if record.surface is None:
        return _split(Surface(modes.x, triangle, modes.phi), patch)
    return _split(record.surface, _patches_of(record.surface, modes.x[triangle], patch))


def _facet_triangles(group: ContactPatches, modes: NodalModes) -> tuple[IntArray, IntArray]:
    """(t, 3) rows of the nodes, and (t,) patches, of the facets' triangles between corners."""
    corners = np.searchsorted(modes.node, group.facet)
    if corners.shape[1] == 3:
        return corners, group.patch
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]), np.tile(group.patch, 2)


def _patches_of(surface: Surface, facets: FloatArray, patch: IntArray) -> IntArray:
    """(t,) the patch of each triangle of a surface; -1: none.

    A triangle is part of a facet, in triangles (f, 3, 3) m of which ``patch`` (f,) says the patch, if its middle is
    over it, and they are turned alike: the surface may divide facets, whose edges may be curved.
    """
    middles, normals = _middles(surface.x[surface.triangle])
    found, away = np.full(len(middles), -1), np.full(len(middles), np.inf)
    centres, outwards = _middles(facets)
    reach = np.linalg.norm(facets - centres[:, None], axis=2).max(axis=1)
    near = scipy.spatial.KDTree(middles).query_ball_point(centres, reach)
    for f, some in enumerate(near):
        one = np.asarray(some, dtype=np.int64)
        r = middles[one] - facets[f, 0]
        shares = np.linalg.lstsq((facets[f, 1:] - facets[f, 0]).T, r.T, rcond=None)[0]
        inside = (shares >= -SEVEN_DIGITS).all(axis=0) & (shares.sum(axis=0) <= 1.0 + SEVEN_DIGITS)
        far = np.abs(r @ outwards[f])
        chosen = inside & (normals[one] @ outwards[f] > _TURNED) & (far < away[one])
        found[one[chosen]], away[one[chosen]] = patch[f], far[chosen]
    return found


def _middles(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(t, 3) m and unit normals (t, 3) of triangles (t, 3, 3)."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normals, axis=1)
    return triangles.mean(axis=1), normals / np.where(size > 0.0, size, 1.0)[:, None]


def _split(surface: Surface, patch: IntArray) -> PatchedSurface:
    """Double the vertices between triangles of different patches (t,)."""
    pairs = np.stack([surface.triangle.ravel(), np.repeat(patch, 3)], axis=1)
    own, rows = np.unique(pairs, axis=0, return_inverse=True)
    vertex = own[:, 0]
    parts = Surface(surface.x[vertex], rows.reshape(-1, 3), surface.phi[vertex])
    return PatchedSurface(parts, own[:, 1])
