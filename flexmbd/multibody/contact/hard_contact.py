"""Hard contact: nothing enters, without a stiffness; impulses follow from restitution and friction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.contact.given_contact import refuse_wrong_arguments
from flexmbd.multibody.contact.shapes import TouchedShape
from flexmbd.multibody.contact.table_shape import placed_numbers, tables_of
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable, check_numbers
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers


@dataclass(frozen=True, kw_only=True)
class Hard:
    """A contact that nothing enters, 0 <= N, 0 <= gap, one of both zero: for ``fm.MoreauJean`` alone, at fixed steps.

    Attributes:
        restitution: e, share of its normal speed that an impact leaves, between 0 and 1, at each contact by itself
            (Newton's law of impact).
        mu: coefficient of Coulomb's friction, in impacts too.
    """

    restitution: float = 0.0
    mu: float = 0.0

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no contact has; ``what`` is its name in messages."""
        check_numbers(what, least={"restitution": self.restitution, "mu": self.mu})
        if self.restitution > 1.0:
            raise SceneError(f"{what}: restitution = {self.restitution} makes energy; it is between 0 and 1")


@dataclass(frozen=True, eq=False)
class HardContact(BetweenFrames, WithSharedNumbers):
    """A sphere, or a point, that touches a shape and does not enter it; ``System.touch`` makes them.

    Attributes:
        shape: on frame F.
        frame_G: the frame that carries the sphere.
        radius: m; 0 of a point.
        law: of impacts and friction.
        centre: (3,) m of the sphere, in frame G's axes.
    """

    shape: TouchedShape
    frame_G: Frame
    radius: float
    law: Hard
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
        return f"hard contact of {touching} {place}{self.frame_G.label} with {shape} {self.frame_F.label}"

    def check(self) -> None:
        """Raise SceneError for a law that is none."""
        refuse_other(self.law, Hard, f"{self.what}: its law", wanted="fm.contact.Hard(...)")
        self.law.check(self.what)

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The shape's table, if it has one."""
        return tables_of(self.shape)

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = [*placed_numbers(self.shape, table), self.radius, self.law.restitution, self.law.mu, *self.centre]
        table.hard_contact(self.what, self.frame_F, self.frame_G, numbers=np.array(numbers))
