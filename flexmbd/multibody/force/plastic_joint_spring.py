"""An elasto-plastic spring on a joint's coordinate; on a revolute joint a plastic hinge."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexmbd.given import checked
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.force.yield_curve import yield_curve
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.memory_law import ELASTOPLASTIC


@checked("rest", "kinematic", "coordinate")
@dataclass(frozen=True, eq=False)
class PlasticJointSpring(OnCoordinate):
    """Resists the deformation beta - rest of a joint coordinate along a measured curve, elastic and then yielding.

    It unloads with the elastic slope and yields in the other direction by the same curve: where hardening is kinematic
    at twice its scale (Masing's rule), where it is isotropic at the force that it has reached.  A ``kinematic`` share
    between takes so much of the force from the one and the rest from the other.  A start beyond yield counts as loaded
    from rest.  ``run.remembered(spring)`` tells its plastic deformation and what it has dissipated.

    Sources: Iwan 1966; Besseling 1958; of plastic hinges in multibody crash models Ambrosio & Nikravesh 1992.

    Attributes:
        connection: a joint with coordinates that are numbers.
        deformation: (n,) m or rad, growing; the first piece, from 0, is elastic, and the last goes on.
        force: (n,) N or N m, never falling.
        rest: coordinate at which it is slack before it yields (m or rad).
        kinematic: share of kinematic hardening, 0 to 1.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    deformation: ArrayLike
    force: ArrayLike
    rest: float = 0.0
    kinematic: float = 1.0
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or points that are no yield curve."""
        super().check()
        check_numbers(self.what, least={"|rest|": abs(self.rest)})
        yield_curve(self.deformation, self.force, self.kinematic, self.what)

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        x, v = table.coordinate(self.connection, self.coordinate)
        curve = yield_curve(self.deformation, self.force, self.kinematic, self.what)
        law, memory = curve.law_numbers(self.kinematic), curve.memory()
        data = table.numbers([self.rest, law.size, *law])
        place = table.memory(memory)
        table.element(ELASTOPLASTIC, self.what, x=x, v=v, data=data, count=len(memory), memory=place)
