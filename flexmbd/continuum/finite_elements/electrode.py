"""Electrodes: groups of the mesh on which a field that a form names by `gauge(p)`, a potential, has one value.

A given value is a port: the machine sets its effort (voltage), and its flow (charge) answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from flexmbd.errors import MeshError
from flexmbd.given import checked, refuse_no_truth


@checked("name", "field", error=MeshError)
@dataclass(frozen=True)
class Electrode:
    """A group of the mesh that conducts: its potential is the same everywhere.

    Without a further word it is a port, whose voltage the machine gives (zero where nothing is said, a short circuit to
    the ground) and whose charge answers. Its facets may lie inside the part, between two layers; of a group of cells
    the whole conducts, as a metal does.

    Attributes:
        name: the group of facets, edges, vertices or cells of the mesh, and the name of the port.
        grounded: its potential is zero.
        floating: its potential is free, and its charge zero: nothing is connected to it.
        field: the shift of the formulation's `gauge(p)` that is one volt of it.

    Raises:
        MeshError: it is both grounded and floating.
    """

    name: str
    grounded: bool = False
    floating: bool = False
    field: str = "potential"

    #: Effort and flow of the port with their units; effort times the rate of flow is power, W.
    EFFORT: ClassVar[tuple[str, str]] = ("voltage", "V")
    FLOW: ClassVar[tuple[str, str]] = ("charge", "C")

    def __post_init__(self) -> None:
        refuse_no_truth(MeshError, grounded=self.grounded, floating=self.floating)
        if self.grounded and self.floating:
            raise MeshError(f"electrode {self.name!r} cannot be grounded and floating at once: say one of them")

    @property
    def is_port(self) -> bool:
        """Whether its potential is given by the machine."""
        return not (self.grounded or self.floating)

    def __str__(self) -> str:
        """Its group and what is connected to it."""
        return f"electrode {self.name!r}{', grounded' if self.grounded else ', floating' if self.floating else ''}"


Condition = Electrode
"""What holds a field on a group of the mesh; electrodes alone so far."""


def refuse_no_conditions(conditions: object) -> Sequence[Condition]:
    """The conditions, or MeshError where they are no list of electrodes, or one group is named twice."""
    if isinstance(conditions, Condition) or not isinstance(conditions, Sequence):
        raise MeshError(f'conditions must be a list, as conditions=[Electrode("top")]; got {conditions!r:.100}')
    for one in conditions:
        if not isinstance(one, Condition):
            raise MeshError(f'a condition must be an Electrode, as Electrode("top", grounded=True); got {one!r:.100}')
    names = [one.name for one in conditions]
    for name in names:
        if names.count(name) > 1:
            raise MeshError(f"electrode {name!r} is given twice; give each group one condition")
    return conditions
