"""A sphere or a point that touches a shape, as a force between two frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.lowest_points import LowestPoint
from flexmbd.multibody.contact.sphere_contact import SphereContact
from flexmbd.multibody.contact.table_shape import placed_numbers
from flexmbd.multibody.force.protocol import ElementTable, WithStates
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.contact.signed_distance import SECOND


@dataclass(frozen=True, eq=False)
class Contact(SphereContact, WithStates):
    """A sphere, or a point, that touches a shape; ``System.touch`` makes them.

    Attributes:
        shape, frame_G, radius, centre: see ``SphereContact``.
        law: of the normal force.
        friction: None: smooth.
        lowest: how the centre moves from there as G turns; None: not at all.
        second: whether it is where the sphere touches a Profile as well, as the other side of a slot.
    """

    law: NormalLaw
    friction: Friction | None = None
    lowest: LowestPoint | None = None
    second: bool = False
    kind: ClassVar[str] = "contact"

    @property
    def what(self) -> str:
        """Its name in messages."""
        return super().what + (", second point" if self.second else "")

    @property
    def touching(self) -> str:
        """What touches, in messages."""
        return super().touching if self.lowest is None else self.lowest.called

    def check(self) -> None:
        """Raise SceneError for a law that is none, or does not know the shapes; a point mass that would turn."""
        wanted = "fm.contact.PowerLaw(...) or fm.contact.Hertz(...)"
        refuse_other(self.law, NormalLaw, f"{self.what}: its law", wanted=wanted)
        if self.friction is not None:
            refuse_other(self.friction, Friction, f"{self.what}: its friction", wanted="fm.contact.Friction(...)")
        self.refuse_turns()
        if self.lowest is not None:
            refuse_turn(self.frame_G, f"{self.what}: it turns with its frame")
        self.law.check(self.what)
        self._stiffness()
        if self.friction is not None:
            self.friction.check(self.what)
            if self.friction.resists and self._lever() == 0.0:
                raise SceneError(f"{self.what}: a point neither rolls nor spins; leave rolling and spinning out")

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The tables of what touches."""
        return (*super().shared_numbers, *(() if self.lowest is None else self.lowest.tables))

    def _lever(self) -> float:
        """m, the radius at which it resists rolling and spinning."""
        return self.radius + (0.0 if self.lowest is None else self.lowest.lever)

    def _stiffness(self) -> float:
        """k (N/m^p); an edge, and a profile, have no one curvature, and are to a law as a point."""
        return self.law.stiffness(self.shape, self.radius if self.lowest is None else 0.0, self.what)

    def assemble(self, table: ElementTable) -> None:
        """One row; with friction three states, how far it has slid, and three more where it resists rolling."""
        rough = self.friction
        if rough is not None and rough.stretch() == 0.0 and not rough.resists:
            rough = None
        k = self._stiffness()
        D = self.law.dissipation()
        normal = [self.radius, k, self.law.exponent, D]
        friction = [0.0] * 5 if rough is None else rough.numbers()
        lowest = [0.0] * 3 if self.lowest is None else self.lowest.numbers(table)
        shape = placed_numbers(self.shape, table)
        if self.second:
            shape[SECOND] = 1.0
        numbers = [*shape, *normal, *friction, *self.centre, *lowest]
        bristle = turn = None
        if rough is not None:
            bristle = rough.stretch()
            if rough.resists:
                turn = rough.turn(self._lever())
                bristle = bristle or turn
                numbers += [rough.rolling, rough.spinning, self._lever()]
        table.contact(
            self.what, self.frame_F, self.frame_G, numbers=numbers, bristle=bristle, turn=turn, remembers=D < 0.0
        )
