"""Dry friction in a joint, as large as the joint's own reaction makes it."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.multibody.force.protocol import ElementTable, OnJoint, check_numbers
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.prismatic import Prismatic
from flexmbd.multibody.joint.revolute import Revolute
from flexmbd.multibody.kane.bearing import Bearing


@dataclass(frozen=True, eq=False)
class BearingFriction(OnJoint):
    """Coulomb friction of a revolute or prismatic joint, regularised, with the joint's rate w and normal force N.

        -coefficient N tanh(w / regularisation),     of a revolute joint times radius

    N is the size of the force that the joint passes on across its axis at that very moment, the friction's own
    effect included; the moment that it passes on, and a thrust along a hinge's axis, do not count.  The friction of all
    bearings is solved for together, once each evaluation of the equations, which then takes several times as long.

    Attributes:
        connection: a revolute or prismatic joint that is carried by coordinates.
        coefficient: of friction.
        regularisation: rad/s or m/s; below this speed it is a stiff damper.
        radius: m, of the pin of a revolute joint.
    """

    connection: Connection
    coefficient: float
    regularisation: float
    radius: float | None = None

    def check(self) -> None:
        """Raise SceneError for another joint, or numbers that no friction has."""
        joint = self.connection.joint
        if not isinstance(joint, Revolute | Prismatic):
            raise SceneError(f"{self.what}: a {type(joint).__name__} has no bearing; take a Revolute or a Prismatic")
        check_numbers(
            self.what, positive={"regularisation": self.regularisation}, least={"coefficient": self.coefficient}
        )
        if isinstance(joint, Revolute) and self.radius is None:
            raise SceneError(f"{self.what}: a Revolute needs the radius (m) of its pin")
        if isinstance(joint, Prismatic) and self.radius is not None:
            raise SceneError(f"{self.what}: a Prismatic has no pin; leave out the radius")
        if self.radius is not None:
            check_numbers(self.what, positive={"radius": self.radius})

    def assemble(self, table: ElementTable) -> None:
        """One of the bearings that are solved together."""
        table.coordinate(self.connection, 0)
        arm = 1.0 if self.radius is None else self.radius
        table.add_bearing(Bearing(self.connection, self.coefficient * arm, self.regularisation))
