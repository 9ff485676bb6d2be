"""A gear: two joints' angles in a fixed ratio."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.coordinate_coupling import Term, single_coordinate


@checked("first", "second")
@dataclass(frozen=True, eq=False)
class Gear:
    """The second joint's angle moves by ``ratio`` times that of the first.

    Attributes:
        first, second: joints carried by coordinates, with one rotation each.
        ratio: turns of the second per turn of the first: -z1/z2 of outer gears with z1 and z2
            teeth whose axes point alike, z1/z2 where one is a ring or a chain joins them.

    Raises:
        SceneError: a joint without exactly one rotation, twice the same joint, or a ratio that
            is 0 or not finite.
    """

    first: Connection
    second: Connection
    ratio: float

    def __post_init__(self) -> None:
        if not is_number(self.ratio) or self.ratio == 0.0:
            raise SceneError(f"{self.name}: the ratio must be finite and not 0, got {self.ratio!r}")
        if self.first is self.second:
            raise SceneError(f"{self.name}: couples the joint with itself; give two joints")
        _ = self.terms  # refuses joints without one rotation

    @property
    def name(self) -> str:
        """In messages."""
        return f"gear {self.first.name!r} to {self.second.name!r}"

    @property
    def terms(self) -> tuple[Term, ...]:
        """ratio angle_1 - angle_2."""
        places = [single_coordinate(c, angular=True, what=self.name) for c in (self.first, self.second)]
        return Term(self.first, places[0], self.ratio), Term(self.second, places[1], -1.0)
