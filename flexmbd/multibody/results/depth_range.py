"""Limits of contacts: what is pressed far into a sphere, a rod or a box may leave it on the other side."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.contacts import depth_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows

IntArray = NDArray[np.int64]

_HALF_WAY = 0.5  # to the middle, where the force turns to the other side


@dataclass(frozen=True, eq=False)
class _Depths:
    """Contacts, and their rows of ``Plan.elements``."""

    contacts: tuple[Contact, ...]
    elements: IntArray

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        plan = rows.scene.plan
        shares = np.zeros((len(rows.t), len(self.elements)))
        depth_series(plan, new_work(plan), self.elements, np.ascontiguousarray(rows.x), np.zeros(rows.scene.nv), shares)
        beyond = np.argwhere(shares > _HALF_WAY)
        if not len(beyond):
            return False
        row, which = beyond[0]
        what = self.contacts[which].what
        remedy = "the law is too soft for what meets there, take a stiffer one, or shapes that are thicker"
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
    found = [
        (one, scene.index.forces[one].elements.start)
        for one in scene.index.forces
        if isinstance(one, Contact) and any(id(end.body) in chosen for end in one.frames)
    ]
    if found:
        yield _Depths(tuple(one for one, _ in found), np.array([row for _, row in found], np.int64))
