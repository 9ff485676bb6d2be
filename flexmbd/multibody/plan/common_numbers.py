"""Numbers in ``Plan.data`` that several forces read: tables that they share, and groups that act together."""

from __future__ import annotations

from collections.abc import Sequence

from flexmbd.multibody.contact.joined_surfaces import joined_surfaces
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers
from flexmbd.multibody.plan.numbering import Numbering
from flexmbd.multibody.scene_index import JoinedPlace


def place_common_numbers(numbering: Numbering, forces: Sequence[Force]) -> None:
    """Let these numbers stand in the plan, each once, and their places in the index, before any force's own begin."""
    for force in forces:
        if isinstance(force, WithSharedNumbers):
            for one in force.shared_numbers:
                _place_shared(numbering, one)
    for group in joined_surfaces([force for force in forces if isinstance(force, SurfaceContact)]):
        tables = [_place_shared(numbering, one) for one in group.tables]
        place = numbering.data_size
        numbering.add_data(group.numbers(tables, place))
        for number, contact in enumerate(group.contacts):
            numbering.index.joined[contact] = JoinedPlace(place, number, group.scratch)


def _place_shared(numbering: Numbering, numbers: SharedNumbers) -> int:
    """Where they begin in ``Plan.data``; they are appended where they are not there yet."""
    shared = numbering.index.shared
    if numbers not in shared:
        shared[numbers] = numbering.add_data(numbers.values)
    return shared[numbers]
