"""A spring, and a damper if wanted, on a joint's coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from flexmbd.multibody.connection import Connection
from flexmbd.multibody.force.protocol import OnCoordinate, Table, check_numbers
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.time_function import Table as Points
from flexmbd.multibody.time_function import spline


@dataclass(frozen=True, eq=False)
class JointSpring(OnCoordinate):
    """-stiffness (beta - rest) - damping d(beta)/dt on a joint coordinate beta.

    Attributes:
        connection: a joint with coordinates that are numbers.
        stiffness: N/m or N m/rad; or a ``Table`` of the resisting force (N or N m) over the deflection
            beta - rest, a cubic spline that goes on straight outside.
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
        check_numbers(self.what, least={"damping": self.damping, "|rest|": abs(self.rest)})
        if isinstance(self.stiffness, Points):
            spline(self.stiffness, self.what)
        else:
            check_numbers(self.what, least={"stiffness": self.stiffness})

    def lay(self, table: Table) -> None:
        """One row: a straight law, or a characteristic with its potential."""
        x, v = table.coordinate(self.connection, self.coordinate)
        if not isinstance(self.stiffness, Points):
            data = table.numbers([self.stiffness, self.rest, self.damping])
            table.element(at.ON_SPRING, self.what, x=x, v=v, data=data)
            return
        force = _straight_outside(spline(self.stiffness, self.what))
        potential = force.antiderivative()
        potential.c[-1] -= potential(0.0)
        head = np.array([self.rest, self.damping])
        data = table.numbers(np.concatenate([head, _laid(force), _laid(potential)]))
        table.element(at.ON_CHARACTERISTIC, self.what, x=x, v=v, data=data, count=force.c.shape[1])


def _straight_outside(inner: PPoly) -> PPoly:
    """The same with a straight piece at each end, which the kernel goes on with."""
    ends = inner.x[[0, -1]]
    line = np.zeros((len(inner.c), 2))
    line[-2] = inner(ends, 1)
    line[-1] = inner(ends)
    line[-1, 0] -= line[-2, 0]  # the left piece begins one unit before the table
    c = np.column_stack([line[:, 0], inner.c, line[:, 1]])
    return PPoly(c, np.concatenate([[ends[0] - 1.0], inner.x, [ends[1] + 1.0]]))


def _laid(poly: PPoly) -> np.ndarray:
    return np.concatenate([[float(len(poly.c))], poly.x, poly.c.T.ravel()])
