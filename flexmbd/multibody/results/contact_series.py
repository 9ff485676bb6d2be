"""What a contact of a scene does along a motion: gap, forces, slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.hard_contact import HardContact
from flexmbd.multibody.contact.shapes import TouchShape
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.force_tables import hard_contact_places
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


def _element(scene: CompiledScene, contact: Contact | HardContact) -> int:
    """Its row of ``Plan.elements``."""
    rows = scene.index.forces.get(contact)
    if rows is None or not rows.elements:
        raise SceneError(f"{contact.what} is not in this trajectory's scene")
    return rows.elements.start


def contact_rows(
    scene: CompiledScene, contact: Contact, t: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray
) -> ContactSeries:
    """The series of a contact at rows t (nt,), x (nt, nx), v, a (nt, nv).

    Raises:
        SceneError: it is no contact, or of another scene.
    """
    refuse_other(contact, Contact, "what run.contacts is asked for", wanted="a contact, or all, as scene.touch gave")
    out = np.zeros((len(x), at.N_CONTACT))
    at.contact_series(scene.plan, new_work(scene.plan), _element(scene, contact), t, x, v, a, out)
    parts = np.split(out, [at.NORMAL, at.FORCE, at.SLIDING, at.POINT], axis=1)
    return ContactSeries(parts[0][:, 0], *parts[1:])


@dataclass(frozen=True, eq=False)
class HardContactSeries(ContactSeries):
    """A hard contact along a motion: forces are impulses over the steps in which they act, none of located impacts.

    Attributes:
        impulse: (nt, 3) N s on the sphere, in the step that ends at a row, or in the impact between two rows of one
            time, at the second.
        normal_work, friction_work: (nt,) J, what both have done on the machine since the start: of impacts that lose
            speed and of what slides it is negative.
    """

    impulse: FloatArray
    normal_work: FloatArray
    friction_work: FloatArray


#: Columns of what is told of a hard contact: the force (N) on the sphere, both works (J), the impulse (N s).
WORKS, IMPULSE, N_TOLD_PAIR = 3, 5, 8


def hard_contact_rows(
    scene: CompiledScene, contact: HardContact, x: FloatArray, v: FloatArray, a: FloatArray, told: FloatArray
) -> HardContactSeries:
    """The series of a hard contact at rows x (nt, nx), v, a (nt, nv).

    ``told`` (nt, n, N_TOLD_PAIR) of all: force on the sphere (N, inertial axes), both works since the start, impulse.

    Raises:
        SceneError: it is of another scene.
    """
    row = _element(scene, contact)
    out = np.zeros((len(x), at.N_CONTACT))
    at.hard_contact_series(scene.plan, new_work(scene.plan), row, x, v, a, out)
    gap, normal, _, slip, point = np.split(out, [at.NORMAL, at.FORCE, at.SLIDING, at.POINT], axis=1)
    own = told[:, int(np.searchsorted(hard_contact_places(scene.plan), row))]
    works = own[:, WORKS], own[:, WORKS + 1]
    return HardContactSeries(gap[:, 0], normal, own[:, :WORKS], slip, point, own[:, IMPULSE:], *works)


@dataclass(frozen=True, eq=False)
class HardGroupSeries:
    """The points of a group of shapes along a motion, those of all rows one after the other; in inertial axes.

    Attributes:
        row: (k,) of the trajectory, at the end of whose step each acted.
        pair: (k, 2) places of the two shapes in ``shapes``.
        shapes: all of the group.
        point: (k, 3) m.  normal: (k, 3) out of the second shape onto the first.  gap: (k,) m, within the step.
        force: (k, 3) N on the first shape, the impulse over the step.
        slip: (k, 3) m/s, of the first against the second at the step's end, in the tangent plane.
        normal_work, friction_work: (nt,) J, what all of them have done on the machine since the start.
    """

    row: NDArray[np.int64]
    pair: NDArray[np.int64]
    shapes: tuple[TouchShape, ...]
    point: FloatArray
    normal: FloatArray
    gap: FloatArray
    force: FloatArray
    slip: FloatArray
    normal_work: FloatArray
    friction_work: FloatArray

    @property
    def normal_force(self) -> FloatArray:
        """(k,) N along the normal."""
        return np.asarray(np.einsum("ij,ij->i", self.normal, self.force))

    def at_rows(self, rows: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Points (n, most, 3) m and forces (n, most, 3) N of rows (n,) of the trajectory; zeros where fewer are."""
        first, last = (np.searchsorted(self.row, rows, side=side) for side in ("left", "right"))
        most = int((last - first).max(initial=0))
        place, force = np.zeros((2, len(rows), most, 3))
        for k, (i, j) in enumerate(zip(first, last, strict=True)):
            place[k, : j - i], force[k, : j - i] = self.point[i:j], self.force[i:j]
        return place, force

    @property
    def friction(self) -> FloatArray:
        """(k, 3) N on the first shape in the tangent plane."""
        return self.force - self.normal_force[:, None] * self.normal
