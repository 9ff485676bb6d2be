"""Stops at the ends of a joint's range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.stop import STOP

_SHARE = 1e-3  # of 1 rad, or of the way between the limits


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
        transition: depth over which the stiffness grows to its full size (m or rad).  By default 1e-3 rad, and of a
            displacement 1e-3 of the way between the limits; one with a single limit has no such length.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    lower: float
    upper: float
    stiffness: float
    damping: float = 0.0
    transition: float | None = None
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or numbers that no stop has."""
        super().check()
        check_numbers(self.what, positive={"stiffness": self.stiffness}, least={"damping": self.damping})
        if np.isnan(numbers([self.lower, self.upper])).any() or not self.lower < self.upper:
            raise SceneError(f"{self.what}: lower = {self.lower} must lie below upper = {self.upper}")
        check_numbers(self.what, positive={"transition": self._depth()})

    def assemble(self, table: ElementTable) -> None:
        """One row for both limits."""
        x, v = table.coordinate(self.connection, self.coordinate)
        data = table.numbers([self.lower, self.upper, self.stiffness, self.damping, self._depth()])
        table.element(STOP, self.what, x=x, v=v, data=data)

    def _depth(self) -> float:
        """The transition (m or rad), where none is given from the range."""
        if self.transition is not None:
            return self.transition
        if self.connection.joint.angular[self.coordinate]:
            return _SHARE
        if not np.isfinite(self.upper - self.lower):
            raise SceneError(
                f"{self.what}: a stop of one limit has no range to take the transition from; give the depth (m) over "
                "which its stiffness grows, transition=..."
            )
        return _SHARE * (self.upper - self.lower)
