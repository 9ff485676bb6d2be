"""Newton's gravitation between all pairs of a group of bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexmbd.multibody.bodies.body import Frame, RigidBody
from flexmbd.multibody.force.between_pairs import check_group
from flexmbd.multibody.force.protocol import ElementTable, OffJoints, check_numbers
from flexmbd.multibody.kernels.elements.pairs import GRAVITATION

#: m^3 kg^-1 s^-2, CODATA 2022.
NEWTON = 6.6743e-11


@dataclass(frozen=True, eq=False)
class Gravitation(OffJoints):
    """The attraction G m M / r^2 between the centres of mass of any two of a group of bodies.

    By their masses as they are in each run.  Exact between points and balls; it turns no body.

    Attributes:
        bodies: rigid bodies and point masses, two at least.
        G: m^3 kg^-1 s^-2; the constant of nature by default.

    Raises:
        SceneError: no group of bodies, or a constant that is not positive.
    """

    bodies: Sequence[RigidBody]
    G: float = NEWTON

    def __post_init__(self) -> None:
        self.check()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """At the centres of mass."""
        return tuple(body.frame(p=body.com) for body in self.bodies)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"Gravitation between {self.bodies[0].name} ... {self.bodies[-1].name}"

    def check(self) -> None:
        """Raise SceneError for no group of bodies, or a constant that is not positive."""
        check_group(self.bodies, RigidBody, "Gravitation", "RigidBody or PointMass of the scene")
        check_numbers(self.what, positive={"G": self.G})

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        table.pairs(GRAVITATION, self.what, self.frames, numbers=(self.G,))
