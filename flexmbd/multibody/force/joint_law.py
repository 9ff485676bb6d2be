"""A user's law of force on a joint's coordinate."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate
from flexmbd.multibody.functions.callback import Law
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.functions.switched import Switched, at_side, refuse_other_law, switch_number, switched_now
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.user_law import USER_LAW


@dataclass(frozen=True, eq=False)
class JointLaw(OnCoordinate):
    """A force (N or N m) on a joint coordinate as a function of time and the coordinate's own state.

    It is called at every evaluation of the equations, several times a step: compile what is slow.

    Attributes:
        connection: a joint with coordinates that are numbers.
        law: f(t, beta, rate of beta) -> one number, positive along the coordinate: Python, or
            ``flexmbd.compiled``; or ``flexmbd.Switched``, of a law that jumps.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    law: Compiled | Law | Switched
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or unless the law is a function of three arguments."""
        super().check()
        if isinstance(self.law, Switched):
            refuse_other_law(self.law, Signature.LAW, f"{self.what}: a law of t, beta, its rate and its side")
        elif isinstance(self.law, Compiled):
            if self.law.signature is not Signature.LAW:
                raise SceneError(f"{self.what}: {self.law.name} must take three arguments, t, beta and its rate")
        elif not callable(self.law):
            raise SceneError(f"{self.what}: {type(self.law).__name__} is not a function of t, beta and its rate")

    def assemble(self, table: ElementTable) -> None:
        """One row with the function's address."""
        x, v = table.coordinate(self.connection, self.coordinate)
        if isinstance(self.law, Switched):
            law = switched_now(self.law)
            up, down = (table.law(at_side(law, side), self.what) for side in (1.0, -1.0))
            place = table.side(law, lambda side, t, q, dq: switch_number(law, side, t, q[x], dq[v]), self.what)
            table.element(USER_LAW, self.what, x=x, v=v, address=up, derivative=down, side=place)
            return
        table.element(USER_LAW, self.what, x=x, v=v, address=table.law(self.law, self.what))
