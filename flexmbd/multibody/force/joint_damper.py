"""A viscous damper on a joint's coordinate."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.spring import SPRING


@dataclass(frozen=True, eq=False)
class JointDamper(OnCoordinate):
    """-damping d(beta)/dt on a joint coordinate beta.

    Attributes:
        connection: a joint with coordinates that are numbers.
        damping: N s/m or N m s/rad.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    damping: float
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or negative damping."""
        super().check()
        check_numbers(self.what, least={"damping": self.damping})

    def assemble(self, table: ElementTable) -> None:
        """One row, a spring without stiffness."""
        x, v = table.coordinate(self.connection, self.coordinate)
        data = table.numbers([0.0, 0.0, self.damping])
        table.element(SPRING, self.what, x=x, v=v, data=data, acts=self.damping > 0.0)
