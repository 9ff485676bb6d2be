"""Stops at the ends of a joint's range."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.force.protocol import OnCoordinate, Table, check_numbers
from flexmbd.multibody.kernels import layout as at


@dataclass(frozen=True, eq=False)
class JointStop(OnCoordinate):
    """One-sided contact where a joint coordinate passes its limits.

    With the depth s > 0 beyond a limit, the stop pushes back with

        g(s) max(0, 1 + damping ds/dt),  g = stiffness s^2 / (2 transition) up to s = transition,
                                         then stiffness (s - transition / 2),

    after Hunt & Crossley 1975: it never pulls, and starts and ends at zero force.  ``g`` has a continuous slope, so
    the error control of a step sees no jump.

    Attributes:
        connection: a joint with coordinates that are numbers.
        lower, upper: limits (m or rad).
        stiffness: N/m or N m/rad beyond the transition.
        damping: s/m or s/rad.
        transition: depth over which the stiffness grows to its full size (m or rad).
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    lower: float
    upper: float
    stiffness: float
    damping: float = 0.0
    transition: float = 1e-3
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or numbers that no stop has."""
        super().check()
        check_numbers(
            self.what,
            positive={"stiffness": self.stiffness, "transition": self.transition},
            least={"damping": self.damping},
        )
        if not self.lower < self.upper:
            raise SceneError(f"{self.what}: lower = {self.lower} must lie below upper = {self.upper}")

    def lay(self, table: Table) -> None:
        """One row for both limits."""
        x, v = table.coordinate(self.connection, self.coordinate)
        data = table.numbers([self.lower, self.upper, self.stiffness, self.damping, self.transition])
        table.element(at.ON_STOP, self.what, x=x, v=v, data=data)
