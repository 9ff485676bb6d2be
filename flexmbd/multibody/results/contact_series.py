"""What a contact of a scene does along a motion: gap, forces, slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling import contacts as at
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContactSeries:
    """A contact along a motion; vectors are in inertial axes.

    Attributes:
        gap: (nt,) m between the sphere, or the point, and the shape; negative where they touch.
        normal: (nt, 3) out of the shape at the nearest point.
        force: (nt, 3) N on the sphere; the shape gets the opposite at ``point``.
        slip: (nt, 3) m/s, velocity of the sphere's nearest point against the shape in the tangent plane.
        point: (nt, 3) m, of the sphere the point nearest to the shape.
    """

    gap: FloatArray
    normal: FloatArray
    force: FloatArray
    slip: FloatArray
    point: FloatArray

    @property
    def normal_force(self) -> FloatArray:
        """(nt,) N along the normal."""
        return np.asarray(np.einsum("ij,ij->i", self.normal, self.force))

    @property
    def friction(self) -> FloatArray:
        """(nt, 3) N on the sphere in the tangent plane."""
        return self.force - self.normal_force[:, None] * self.normal


def contact_rows(
    scene: CompiledScene, contact: Contact, t: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray
) -> ContactSeries:
    """The series of a contact at rows t (nt,), x (nt, nx), v, a (nt, nv).

    Raises:
        SceneError: it is no contact, or of another scene.
    """
    refuse_other(contact, Contact, "what is asked for a contact's series", wanted="what System.touch returned")
    rows = scene.index.forces.get(contact)
    if rows is None or not rows.elements:
        raise SceneError(f"{contact.what} is not in this trajectory's scene")
    out = np.zeros((len(x), at.N_CONTACT))
    at.contact_series(scene.plan, new_work(scene.plan), rows.elements.start, t, x, v, a, out)
    parts = np.split(out, [at.NORMAL, at.FORCE, at.SLIDING, at.POINT], axis=1)
    return ContactSeries(parts[0][:, 0], *parts[1:])
