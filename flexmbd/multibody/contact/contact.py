"""A sphere or a point that touches a shape, as a force between two frames."""

from __future__ import annotations

from dataclasses import dataclass, field

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.given_contact import refuse_wrong_arguments
from flexmbd.multibody.contact.shapes import HollowSphere, Sphere, TouchedShape
from flexmbd.multibody.contact.table_shape import placed_numbers, tables_of
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable, WithStates
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers


@dataclass(frozen=True, eq=False)
class Contact(BetweenFrames, WithStates, WithSharedNumbers):
    """A sphere, or a point, that touches a shape; ``System.touch`` makes them.

    Attributes:
        shape: on frame F.
        frame_G: the frame that carries the sphere.
        radius: m; 0 of a point.
        law: of the normal force.
        friction: None: smooth.
        centre: (3,) m of the sphere, in frame G's axes.
    """

    shape: TouchedShape
    frame_G: Frame
    radius: float
    law: NormalLaw
    friction: Friction | None = None
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame_F: Frame = field(init=False)

    def __post_init__(self) -> None:
        refuse_wrong_arguments(self.shape, self.radius, self.centre)
        object.__setattr__(self, "frame_F", self.shape.frame)

    @property
    def what(self) -> str:
        """Its name in messages."""
        touching = "sphere" if self.radius > 0.0 else "point"
        shape = type(self.shape).__name__
        place = f"({', '.join(f'{x:.6g}' for x in self.centre)}) of " if any(self.centre) else ""
        return f"contact of {touching} {place}{self.frame_G.label} with {shape} {self.frame_F.label}"

    def check(self) -> None:
        """Raise SceneError for a law that is none, or does not know the shapes; a point mass that would turn."""
        wanted = "fm.contact.PowerLaw(...) or fm.contact.Hertz(...)"
        refuse_other(self.law, NormalLaw, f"{self.what}: its law", wanted=wanted)
        if self.friction is not None:
            refuse_other(self.friction, Friction, f"{self.what}: its friction", wanted="fm.contact.Friction(...)")
        if not isinstance(self.shape, (Sphere, HollowSphere)):
            refuse_turn(self.frame_F, f"{self.what}: a {type(self.shape).__name__} turns with its frame")
        if any(self.centre):
            refuse_turn(self.frame_G, f"{self.what}: it turns with its frame")
        self.law.check(self.what)
        self.law.stiffness(self.shape, self.radius, self.what)
        if self.friction is not None:
            self.friction.check(self.what)
            if self.friction.resists and self.radius == 0.0:
                raise SceneError(f"{self.what}: a point neither rolls nor spins; leave rolling and spinning out")

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The shape's table, if it has one."""
        return tables_of(self.shape)

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
