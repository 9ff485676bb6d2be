"""Hard contact: nothing enters, without a stiffness; impulses follow from restitution and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.contact.impact_law import ImpactLaw
from flexmbd.multibody.contact.sphere_contact import SphereContact
from flexmbd.multibody.contact.table_shape import placed_numbers
from flexmbd.multibody.force.protocol import ElementTable, check_numbers


@dataclass(frozen=True, kw_only=True)
class Hard:
    """A contact that nothing enters, 0 <= N, 0 <= gap, one of both zero.

    By ``fm.MoreauJean`` at fixed steps; by error control where single contacts meet and part, impacts as events.

    Attributes:
        restitution: e between 0 and 1: the share of its normal speed that an impact leaves, at each contact by itself
            (Newton's law of impact), or what ``impact`` says.
        mu: coefficient of Coulomb's friction, in impacts too.
        impact: the law of impact.
    """

    restitution: float = 0.0
    mu: float = 0.0
    impact: ImpactLaw = ImpactLaw.NEWTON

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no contact has; ``what`` is its name in messages."""
        check_numbers(what, least={"restitution": self.restitution, "mu": self.mu})
        if self.restitution > 1.0:
            raise SceneError(f"{what}: restitution = {self.restitution} makes energy; it is between 0 and 1")
        wanted = " or ".join(f"fm.contact.{one}" for one in ImpactLaw)
        refuse_other(self.impact, ImpactLaw, f"{what}: impact", wanted=wanted)

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Restitution, friction, and 1 of Poisson's law, else 0 (``kernels.elements.hard_element``)."""
        return self.restitution, self.mu, float(self.impact is ImpactLaw.POISSON)


@dataclass(frozen=True, eq=False)
class HardContact(SphereContact):
    """A sphere, or a point, that touches a shape and does not enter it; ``System.touch`` makes them.

    Attributes:
        shape, frame_G, radius, centre: see ``SphereContact``.
        law: of impacts and friction.
    """

    law: Hard
    kind: ClassVar[str] = "hard contact"

    def check(self) -> None:
        """Raise SceneError for a law that is none, or a point mass that would turn."""
        refuse_other(self.law, Hard, f"{self.what}: its law", wanted="fm.contact.Hard(...)")
        self.refuse_turns()
        self.law.check(self.what)

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = [*placed_numbers(self.shape, table), self.radius, *self.law.numbers, *self.centre]
        table.hard_contact(self.what, self.frame_F, self.frame_G, numbers=np.array(numbers))
