"""A one-dimensional inertia that a joint's coordinate turns."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import is_number
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.joint.connection import Connection


@dataclass(frozen=True, eq=False)
class ShaftInertia(OnCoordinate):
    """A rotor with an inertia about its axis alone, turned by ``ratio`` times a coordinate's rate, through a gear.

    As in one-dimensional mechanics (Modelica's Rotational) its kinetic energy is inertia (ratio dbeta/dt)^2 / 2 and
    nothing more: it adds inertia ratio^2 to the coordinate's entry of the mass matrix, whatever the joint's bodies do.
    So its bearings get no gyroscopic moments, its housing no moment as it accelerates, and the machine neither its mass
    nor its angular momentum; where these matter, add a ``RigidBody`` with a joint and an ``fm.joint.Gear``.  Several on
    one coordinate add.

    Attributes:
        connection: a joint that is carried by coordinates.
        inertia: kg m^2, positive.
        ratio: turns (rad) of the rotor per unit (rad or m) of the coordinate.
        coordinate: which of the joint's, from 0.
    """

    connection: Connection
    inertia: float
    ratio: float = 1.0
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError unless the joint has this coordinate, and the numbers are those of a rotor on a gear."""
        super().check()
        check_numbers(self.what, positive={"inertia": self.inertia})
        if not is_number(self.ratio) or self.ratio == 0.0:
            raise SceneError(f"{self.what}: the ratio must be finite and not 0, got {self.ratio!r:.60}")

    def assemble(self, table: ElementTable) -> None:
        """An entry of the mass matrix."""
        table.inertia(self.connection, self.coordinate, self.inertia * self.ratio**2, self.what)
