"""A spring, and a damper if wanted, on a joint's coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexmbd.given import is_number
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.functions.spline_table import Table as Points
from flexmbd.multibody.functions.spline_table import spline
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.characteristic import CHARACTERISTIC
from flexmbd.multibody.kernels.elements.spring import SPRING

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


@dataclass(frozen=True, eq=False)
class JointSpring(OnCoordinate):
    """-stiffness (beta - rest) - damping d(beta)/dt on a joint coordinate beta.

    Attributes:
        connection: a joint with coordinates that are numbers.
        stiffness: N/m or N m/rad; or a ``Table`` of the resisting force (N or N m) over the deflection
            beta - rest, a cubic spline, which keeps its first and last force outside unless its ``beyond`` says
            otherwise.
        rest: coordinate at which it is slack (m or rad).
        damping: N s/m or N m s/rad.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    stiffness: float | Points
    rest: float = 0.0
    damping: float = 0.0
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or numbers that no spring has."""
        super().check()
        rest = abs(self.rest) if is_number(self.rest) else self.rest
        check_numbers(self.what, least={"damping": self.damping, "|rest|": rest})
        if isinstance(self.stiffness, Points):
            spline(self.stiffness, self.what)
        else:
            check_numbers(self.what, least={"stiffness": self.stiffness})

    def assemble(self, table: ElementTable) -> None:
        """One row: a straight law, or a characteristic with its potential."""
        x, v = table.coordinate(self.connection, self.coordinate)
        if not isinstance(self.stiffness, Points):
            data = table.numbers([self.stiffness, self.rest, self.damping])
            acts = self.stiffness > 0.0 or self.damping > 0.0
            table.element(SPRING, self.what, x=x, v=v, data=data, acts=acts)
            return
        force = spline(self.stiffness, self.what)
        potential = force.antiderivative()
        potential.c[-1] -= potential(0.0)
        head = np.array([self.rest, self.damping])
        data = table.numbers(np.concatenate([head, _coefficients(force), _coefficients(potential)]))
        table.element(CHARACTERISTIC, self.what, x=x, v=v, data=data, count=force.c.shape[1])


def _coefficients(poly: PPoly) -> np.ndarray:
    return np.concatenate([[float(len(poly.c))], poly.x, poly.c.T.ravel()])
