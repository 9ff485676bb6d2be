"""What the patches of an elastic surface do along a motion, and overlaps with which it would begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError, StartWarning, warn
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.joined_surfaces import tell_parted_surfaces
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.lanes import padded_size
from flexmbd.multibody.kernels.elements.table import of_surfaces
from flexmbd.multibody.kernels.sampling import surfaces as at
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.contact_series import ContactSeries, HardGroupSeries
from flexmbd.multibody.team import Team
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceSeries:
    """The patches of an elastic surface along a motion, in the order of ``ElasticSurface.patches``; in inertial axes.

    Attributes:
        gap: (nt, p) m between each patch and the shape, along its normal; 0 where they touch.
        normal: (nt, p, 3) out of the shape.
        force: (nt, p, 3) N on the patch; the shape gets the opposite.
        point: (nt, p, 3) m, the patch's centroid.
        area: (p,) m^2.
        other_normal_force: (nt, p') N on the patches of the other elastic surface, in their order: the normal forces,
            by the weights with which it feels them; p' = 0 where a rigid shape is touched.
        other_area: (p',) m^2.
    """

    gap: FloatArray
    normal: FloatArray
    force: FloatArray
    point: FloatArray
    area: FloatArray
    other_normal_force: FloatArray
    other_area: FloatArray

    @property
    def normal_force(self) -> FloatArray:
        """(nt, p) N along the normals."""
        return np.asarray(np.einsum("tpi,tpi->tp", self.normal, self.force))

    @property
    def pressure(self) -> FloatArray:
        """(nt, p) Pa, the same over the patches' areas."""
        return self.normal_force / self.area

    @property
    def other_pressure(self) -> FloatArray:
        """(nt, p') Pa on the patches of the other elastic surface."""
        return self.other_normal_force / self.other_area

    @property
    def friction(self) -> FloatArray:
        """(nt, p, 3) N on the patches in the tangent plane."""
        return self.force - self.normal_force[..., None] * self.normal


#: What ``run.contacts`` tells of a contact.
AnySeries: TypeAlias = ContactSeries | HardGroupSeries | SurfaceSeries


def surface_rows(
    scene: CompiledScene, contact: SurfaceContact, x: FloatArray, v: FloatArray, a: FloatArray
) -> SurfaceSeries:
    """The series of an elastic surface's contact at rows x (nt, nx), v, a (nt, nv).

    Raises:
        SceneError: it is of another scene.
    """
    rows = scene.index.forces.get(contact)
    if rows is None or not rows.elements:
        raise SceneError(f"{contact.what} is not in this trajectory's scene")
    area = contact.area
    other = contact.other.area if isinstance(contact.other, ElasticSurface) else np.zeros(0)
    w, pressed = np.zeros(padded_size(len(other))), np.zeros((len(x), len(other)))
    out = np.zeros((len(x), len(area), at.N_PATCH))
    at.surface_series(scene.plan, new_work(scene.plan), rows.elements.start, x, v, a, w, out, pressed)
    gap, normal, force, point = np.split(out, [at.NORMAL, at.FORCE, at.POINT], axis=2)
    return SurfaceSeries(gap[:, :, 0], normal, force, point, area, pressed, other)


def tell_overlapping_surfaces(scene: CompiledScene, x: FloatArray, team: Team) -> None:
    """Tell elastic surfaces that are inside of shapes where a run begins, at x (nx,), their bodies undeformed.

    What is less than a millionth of the machine's extent is the digits of the values given.

    Warns:
        StartWarning: there is one; with the pair, how deep, and what to do.
        RangeWarning: some are not solved together with others that press the same body; see ``tell_parted_surfaces``.
    """
    if not (of_surfaces(scene.plan).any() and team.is_root):
        return
    contacts = [one for one in scene.index.forces if isinstance(one, SurfaceContact)]
    tell_parted_surfaces(contacts)
    gap = np.zeros(len(contacts))
    at.surface_overlaps(scene.plan, new_work(scene.plan), x, np.zeros(scene.nv), gap)
    for one, least in zip(contacts, gap, strict=True):
        bent = [x[scene.index.modes[end.body].x].any() for end in one.frames if isinstance(end.body, FlexibleBody)]
        if least < -SEVEN_DIGITS * scene.extent and not any(bent):
            warn(
                f"{one.what}: they overlap by {-least:.3g} m at the start, where the body is undeformed, and spring "
                "apart; begin with them apart or touching, or about an equilibrium, about=scene.equilibrium()",
                StartWarning,
                subject=f"overlap of {one.what}",
            )
