"""Which contacts of elastic surfaces give way together: those that press one body, and so on from body to body.

Their kernels: ``kernels.elements.surface_groups``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.contact.elastic_surface import ElasticSurface, patches_table
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.base.lanes import padded_size
from flexmbd.multibody.kernels.elements.surface_groups import group_parts

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MOST = 2**23  # numbers of scratch space, 64 MB
_FELT = 0.05  # of what a patch gives under a force on it: what it gives under one elsewhere, beyond which this is told


@dataclass(frozen=True, eq=False)
class JoinedSurfaces:
    """Contacts without friction that give way together.

    Attributes:
        contacts: two or more.
    """

    contacts: tuple[SurfaceContact, ...]

    @cached_property
    def bodies(self) -> tuple[FlexibleBody, ...]:
        """Those whose patches they press."""
        return tuple({id(one.body): one.body for contact in self.contacts for one in contact.elastic}.values())

    @cached_property
    def patches(self) -> tuple[IntArray, ...]:
        """(p,) of each body the patches that are pressed, by their rows in ``record.contact``."""
        found = []
        for body in self.bodies:
            surfaces = [one.patches for contact in self.contacts for one in contact.elastic if one.body is body]
            found.append(np.unique(np.concatenate(surfaces)))
        return tuple(found)

    @cached_property
    def tables(self) -> tuple[SharedNumbers, ...]:
        """What the kernels know of these patches: that of a surface that has them all, if there is one."""
        found = []
        for body, patches in zip(self.bodies, self.patches, strict=True):
            surfaces = [one for contact in self.contacts for one in contact.elastic if one.body is body]
            whole = next((one.table for one in surfaces if len(one.patches) == len(patches)), None)
            found.append(whole or patches_table(body.record, patches))
        return tuple(found)

    @cached_property
    def scratch(self) -> int:
        """How many numbers of ``work.generalized`` the kernels need for all of them."""
        return self._parts[-1]

    @cached_property
    def _modes(self) -> list[int]:
        return [body.record.n_modes for body in self.bodies]

    @cached_property
    def _parts(self) -> list[int]:
        slots = sum(padded_size(len(contact.area)) for contact in self.contacts)
        longest = max(6 + sum(one.body.record.n_modes for one in contact.elastic) for contact in self.contacts)
        first = max(contact.own_scratch for contact in self.contacts)
        unknowns = 6 * len(self.contacts) + sum(self._modes)
        return group_parts(len(self.contacts), list(map(len, self.patches)), slots, unknowns, longest, first)

    def numbers(self, tables: Sequence[int], first: int) -> FloatArray:
        """What the kernels know of the group, where its numbers begin at ``first`` and the tables at these places."""
        count = len(self.bodies)
        head = [len(self.contacts), count, *self._parts[: -1 - count]]
        modes = 6 * len(self.contacts) + np.cumsum([0, *self._modes])
        of_bodies = [list(one) for one in zip(tables, modes, self._parts[-1 - count : -1], strict=False)]
        behind = first + len(head) + 4 * len(self.contacts) + 3 * count
        of_members: list[list[int]] = []
        listed: list[int] = []
        for contact in self.contacts:
            pair, places = [-1, -1], [-1, -1]
            for side, one in enumerate(contact.sides):
                if isinstance(one, ElasticSurface):
                    pair[side] = next(k for k, body in enumerate(self.bodies) if body is one.body)
                    places[side] = behind + len(listed)
                    listed.extend(map(int, np.searchsorted(self.patches[pair[side]], one.patches)))
            of_members.append([*pair, *places])
        return np.concatenate([np.ravel(np.array(part, float)) for part in (head, of_members, of_bodies, listed)])


def joined_surfaces(contacts: Sequence[SurfaceContact]) -> list[JoinedSurfaces]:
    """The groups among contacts that give way together: those of ``connected_surfaces`` that are not too large."""
    return [group for group in connected_surfaces(contacts) if group.scratch <= _MOST]


def tell_parted_surfaces(contacts: Sequence[SurfaceContact]) -> None:
    """Tell groups that are too large, and contacts with friction, solved alone, where others press patches near theirs.

    Warns:
        RangeWarning: there is one; with a contact of it.
    """
    for group in connected_surfaces(contacts):
        if group.scratch > _MOST:
            warn(
                f"{group.contacts[0].what}, and {len(group.contacts) - 1} more contacts of elastic surfaces of bodies "
                "that touch each other, are too many to be solved together: what presses a body elsewhere its patches "
                "feel through its modes alone; take larger patches, fewer pairs, or more modes",
                RangeWarning,
                subject=f"surfaces apart, of {group.contacts[0].what}",
            )
    for body in {id(one.body): one.body for contact in contacts for one in contact.elastic}.values():
        _tell_alone(body, contacts)


def _tell_alone(body: FlexibleBody, contacts: Sequence[SurfaceContact]) -> None:
    """Tell of a body the contact with friction that feels most of what another one presses it with.

    Where a ball at one point will press is not known.
    """
    hard = [contact for contact in contacts if isinstance(contact.law, Hard)]
    pressing = [(contact, one.patches) for contact in hard for one in contact.elastic if one.body is body]
    group = body.record.contact
    if group is None or len(pressing) < 2 or all(contact.may_join for contact, _ in pressing):
        return
    give = np.abs(group.G[::3, ::3])  # along the normals
    own = np.sqrt(np.diag(give))
    felt = np.divide(give, np.outer(own, own), out=np.zeros_like(give), where=np.outer(own, own) > 0.0)
    found = [
        (felt[np.ix_(patches, others)].max(), contact, other)
        for k, (contact, patches) in enumerate(pressing)
        for j, (other, others) in enumerate(pressing)
        if j != k and not contact.may_join
    ]
    share, contact, other = max(found, key=lambda one: one[0])
    if share > _FELT:
        warn(
            f"{contact.what} has friction, and is solved alone: beside what the modes have, forces of {other.what} "
            f"move its patches by up to {100.0 * share:.2g} % of what they move their own by, and this it does not "
            "feel; take more modes, or no friction",
            RangeWarning,
            subject=f"surfaces apart, of {body.name}",
        )


def connected_surfaces(contacts: Sequence[SurfaceContact]) -> list[JoinedSurfaces]:
    """The groups among contacts: those without friction whose bodies' patches others of them press too."""
    groups: list[tuple[list[SurfaceContact], set[int]]] = []
    for contact in contacts:
        if not contact.may_join:
            continue
        mine, bodies = [contact], {id(one.body) for one in contact.elastic}
        apart = []
        for members, pressed in groups:
            if pressed & bodies:
                mine, bodies = members + mine, bodies | pressed
            else:
                apart.append((members, pressed))
        groups = [*apart, (mine, bodies)]
    return [JoinedSurfaces(tuple(members)) for members, _ in groups if len(members) > 1]
