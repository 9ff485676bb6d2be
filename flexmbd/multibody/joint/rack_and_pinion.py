"""A rack and its pinion: a displacement that follows an angle."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.coordinate_coupling import Term, single_coordinate


@checked("pinion", "rack")
@dataclass(frozen=True, eq=False)
class RackAndPinion:
    """The rack's displacement moves by ``radius`` times the pinion's angle.

    Attributes:
        pinion: a joint carried by coordinates, with one rotation.
        rack: a joint carried by coordinates, with one translation.
        radius: m of the rack per rad of the pinion; negative where the rack runs backwards.

    Raises:
        SceneError: joints without such a coordinate, or a radius that is 0 or not finite.
    """

    pinion: Connection
    rack: Connection
    radius: float

    def __post_init__(self) -> None:
        if not is_number(self.radius) or self.radius == 0.0:
            raise SceneError(f"{self.name}: the radius must be finite and not 0, got {self.radius!r}")
        _ = self.terms  # refuses joints without such coordinates

    @property
    def name(self) -> str:
        """In messages."""
        return f"rack {self.rack.name!r} on pinion {self.pinion.name!r}"

    @property
    def terms(self) -> tuple[Term, ...]:
        """radius angle - displacement."""
        angle = single_coordinate(self.pinion, angular=True, what=self.name)
        travel = single_coordinate(self.rack, angular=False, what=self.name)
        return Term(self.pinion, angle, self.radius), Term(self.rack, travel, -1.0)
