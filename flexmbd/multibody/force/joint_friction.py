"""Dry friction in a joint, regularised."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.multibody.force.protocol import ElementTable, OnCoordinate, check_numbers
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.elements.friction import FRICTION


@dataclass(frozen=True, eq=False)
class JointFriction(OnCoordinate):
    """Friction of given size against the rate w of a joint coordinate.

        -(coulomb + (static - coulomb) exp(-(w / stribeck)^2)) tanh(w / regularisation) - viscous w

    Below the speed ``regularisation`` it is a stiff damper: nothing sticks, a load below ``coulomb`` creeps.  The size
    does not follow the joint's reaction, as that of ``BearingFriction`` does.

    Attributes:
        connection: a joint with coordinates that are numbers.
        coulomb: N or N m, the sliding friction.
        regularisation: m/s or rad/s.
        static: N or N m, at least ``coulomb``; by default the same.
        stribeck: m/s or rad/s over which the excess of ``static`` fades; needed with ``static``.
        viscous: N s/m or N m s/rad.
        coordinate: which of the joint's coordinates, from 0.
    """

    connection: Connection
    coulomb: float
    regularisation: float
    static: float | None = None
    stribeck: float | None = None
    viscous: float = 0.0
    coordinate: int = 0

    def check(self) -> None:
        """Raise SceneError for a joint without that coordinate, or numbers that no friction has."""
        super().check()
        check_numbers(
            self.what,
            positive={"regularisation": self.regularisation},
            least={"coulomb": self.coulomb, "viscous": self.viscous},
        )
        if (self.static is None) != (self.stribeck is None):
            raise SceneError(f"{self.what}: static friction needs Stribeck's speed, and that needs static friction")
        if self.static is not None and self.stribeck is not None:
            check_numbers(self.what, positive={"stribeck": self.stribeck})
            if not self.static >= self.coulomb:
                raise SceneError(f"{self.what}: static = {self.static} must not be below coulomb = {self.coulomb}")

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        x, v = table.coordinate(self.connection, self.coordinate)
        static = self.coulomb if self.static is None else self.static
        speed = 1.0 if self.stribeck is None else self.stribeck
        data = table.numbers([self.coulomb, static, self.regularisation, speed, self.viscous])
        acts = max(self.coulomb, static, self.viscous) > 0.0
        table.element(FRICTION, self.what, x=x, v=v, data=data, acts=acts)
