"""A sphere or a point that touches a shape, as a force between two frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.errors import SceneError
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.sphere_contact import SphereContact
from flexmbd.multibody.contact.table_shape import placed_numbers
from flexmbd.multibody.force.protocol import ElementTable, WithStates


@dataclass(frozen=True, eq=False)
class Contact(SphereContact, WithStates):
    """A sphere, or a point, that touches a shape; ``System.touch`` makes them.

    Attributes:
        shape, frame_G, radius, centre: see ``SphereContact``.
        law: of the normal force.
        friction: None: smooth.
    """

    law: NormalLaw
    friction: Friction | None = None
    kind: ClassVar[str] = "contact"

    def check(self) -> None:
        """Raise SceneError for a law that is none, or does not know the shapes; a point mass that would turn."""
        self.refuse_turns()
        self.law.check(self.what)
        self.law.stiffness(self.shape, self.radius, self.what)
        if self.friction is not None:
            self.friction.check(self.what)
            if self.friction.resists and self.radius == 0.0:
                raise SceneError(f"{self.what}: a point neither rolls nor spins; leave rolling and spinning out")

    def assemble(self, table: ElementTable) -> None:
        """One row; with friction three states, how far it has slid, and three more where it resists rolling."""
        rough = self.friction
        if rough is not None and rough.stretch() == 0.0 and not rough.resists:
            rough = None
        k = self.law.stiffness(self.shape, self.radius, self.what)
        D = self.law.dissipation()
        normal = [self.radius, k, self.law.exponent, D]
        friction = [0.0] * 5 if rough is None else rough.numbers()
        numbers = [*placed_numbers(self.shape, table), *normal, *friction, *self.centre]
        bristle = turn = None
        if rough is not None:
            bristle = rough.stretch()
            if rough.resists:
                turn = rough.turn(self.radius)
                bristle = bristle or turn
                numbers += [rough.rolling, rough.spinning]
        table.contact(
            self.what, self.frame_F, self.frame_G, numbers=numbers, bristle=bristle, turn=turn, remembers=D < 0.0
        )
