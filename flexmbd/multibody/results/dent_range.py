"""Limits of spheres on elastic surfaces: a dent that is wider than their patches is partly counted twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.contact_laws import Hertz
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.shapes import Sphere
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows
from flexmbd.multibody.results.surface_series import surface_rows


@dataclass(frozen=True, eq=False)
class _Dents:
    """A sphere on an elastic surface by Hertz's law."""

    contact: SurfaceContact
    curvature: float  # 1/m, the mean of both relative ones
    patch: float  # m, radius of a disc of the smallest patch's area

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        still = np.zeros((len(rows.t), rows.scene.nv))
        depth = -surface_rows(rows.scene, self.contact, np.ascontiguousarray(rows.x), still, still).gap[:, 0]
        radius = np.sqrt(np.maximum(depth, 0.0) / self.curvature)
        beyond = np.flatnonzero(radius > self.patch)
        if not len(beyond):
            return False
        k = beyond[0]
        warn(
            f"{self.contact.what}: at t = {rows.t[k]:.6g} s Hertz's dent is {radius[k]:.2g} m wide in radius, and the "
            f"patches are {self.patch:.2g} m: what lies between is counted by both; take larger patches, or Hard(), by "
            "which patches smaller than the dent carry it",
            RangeWarning,
            subject=f"dent of {self.contact.what}",
        )
        return True


def dent_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_Dents]:
    """Of the spheres that touch elastic surfaces of these bodies, or are on them."""
    chosen = {id(body) for body in bodies}
    for one in scene.index.forces:
        if not (isinstance(one, SurfaceContact) and isinstance(one.law, Hertz)):
            continue
        if not any(id(end.body) in chosen for end in one.frames):
            continue
        if isinstance(one.surface, Sphere) and isinstance(one.other, ElasticSurface):
            curvature = 1.0 / one.surface.radius + 0.5 * sum(one.curved.curvatures())
            yield _Dents(one, curvature, one.other.patch_radius)
