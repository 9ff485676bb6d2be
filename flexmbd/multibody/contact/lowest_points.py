"""Points of a body that are the lowest before a half space: of a face with its rim, of a profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from flexmbd.multibody.contact.profile import Profile
from flexmbd.multibody.force.protocol import ElementTable
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.contact import lowest_point as kinds


class LowestPoint(Protocol):
    """A point of a body that goes around as the body turns."""

    @property
    def called(self) -> str:
        """What touches, in messages."""

    @property
    def lever(self) -> float:
        """m, radius at which rolling and spinning are resisted, beside that of the sphere; 0: none."""

    @property
    def tables(self) -> tuple[SharedNumbers, ...]:
        """The table that it reads, if it reads one."""

    def numbers(self, table: ElementTable) -> list[float]:
        """(3,) as ``kernels.contact.lowest_point`` takes them."""


@dataclass(frozen=True)
class Rim:
    """The lowest point of a circle about the frame's z axis and of the face in it, which is a little crowned.

    Both are a flattened ellipsoid.

    Attributes:
        radius: m.
        crown: m by which the face's middle is higher.
    """

    radius: float
    crown: float

    called: ClassVar[str] = "rim"
    tables: ClassVar[tuple[SharedNumbers, ...]] = ()

    @property
    def lever(self) -> float:
        """The radius."""
        return self.radius

    def numbers(self, table: ElementTable) -> list[float]:
        """Both semi-axes."""
        return [kinds.RIM, self.radius, self.crown]


@dataclass(frozen=True, eq=False)
class ProfileOutline:
    """The point of a profile that is nearest to a half space.

    Attributes:
        profile: whose frame is the contact's.
    """

    profile: Profile

    called: ClassVar[str] = "profile"
    lever: ClassVar[float] = 0.0

    @property
    def tables(self) -> tuple[SharedNumbers, ...]:
        """The profile's."""
        return (self.profile.table,)

    def numbers(self, table: ElementTable) -> list[float]:
        """The table's place."""
        return [kinds.OUTLINE, float(table.shared(self.profile.table)), 0.0]
