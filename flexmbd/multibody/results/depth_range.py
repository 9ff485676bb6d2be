"""Limits of contacts: what is pressed far into a sphere, a rod or a box may leave it on the other side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.contacts import depth_series
from flexmbd.multibody.kernels.sampling.surfaces import surface_depth_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows

IntArray = NDArray[np.int64]

_THICKER = "or shapes that are thicker"
_KINDS: tuple[tuple[type[Contact | SurfaceContact], Callable[..., None], str], ...] = (
    (Contact, depth_series, f"the law is too soft for what meets there, take a stiffer one, {_THICKER}"),
    (SurfaceContact, surface_depth_series, f"the body dents too far for what it meets, take a slower one, {_THICKER}"),
)
_HALF_WAY = 0.5  # to the middle, where the force turns to the other side


@dataclass(frozen=True, eq=False)
class _Depths:
    """Contacts of one kind, and their rows of ``Plan.elements``.

    Attributes:
        contacts: n of them.
        elements: (n,).
        series: how deep they are pressed in, ``kernels.sampling.contacts.depth_series`` or one like it.
        remedy: where they are pressed in too far.
    """

    contacts: tuple[Contact | SurfaceContact, ...]
    elements: IntArray
    series: Callable[..., None]
    remedy: str

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        plan = rows.scene.plan
        shares = np.zeros((len(rows.t), len(self.elements)))
        self.series(plan, new_work(plan), self.elements, np.ascontiguousarray(rows.x), np.zeros(rows.scene.nv), shares)
        beyond = np.argwhere(shares > _HALF_WAY)
        if not len(beyond):
            return False
        row, which = beyond[0]
        what = self.contacts[which].what
        remedy = self.remedy
        if row == 0 and rows.before is None:
            remedy = "the shapes overlap where the run begins: begin with them apart, or near where they rest"
        warn(
            f"{what}: at t = {rows.t[row]:.6g} s it is pressed in by {100.0 * shares[row, which]:.2g} % of the way to "
            f"the middle, from where it is pushed out on the other side: {remedy}",
            RangeWarning,
            subject=f"depth of {what}",
        )
        return True


def depth_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_Depths]:
    """Of the contacts of these bodies with shapes that have a middle."""
    chosen = {id(body) for body in bodies}
    for kind, series, remedy in _KINDS:
        found = [
            (one, scene.index.forces[one].elements.start)
            for one in scene.index.forces
            if isinstance(one, kind) and any(id(end.body) in chosen for end in one.frames)
        ]
        if found:
            rows = np.array([row for _, row in found], np.int64)
            yield _Depths(tuple(one for one, _ in found), rows, series, remedy)
