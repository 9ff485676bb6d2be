"""A screw joint: the child turns about one axis and advances along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.errors import SceneError
from flexmbd.given import is_number
from flexmbd.multibody.joint.kinematic_pair import screw
from flexmbd.multibody.joint.protocol import ALIGNED, ON_AXIS, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class Screw(AlongAxis, CarriedBySteps):
    """One rotation about ``axis`` that advances along it.

    Coordinate: the angle (rad) from F to G about the axis, right-handed, over any number of
    turns; the displacement along the axis is ``pitch`` times it.

    Attributes:
        pitch: advance (m/rad), negative for a left-handed screw; not 0.
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    pitch: float
    axis: Axis = "z"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_number(self.pitch) or self.pitch == 0.0:
            raise SceneError(f"the pitch of a screw must be finite and not 0 (that is a Revolute), got {self.pitch!r}")

    velocity_names: ClassVar[tuple[str, ...]] = ("angle",)

    @property
    def steps(self) -> tuple[Step, ...]:
        """One screw."""
        return (Step(screw(self.pitch)),)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Those of a cylindrical joint, and the advance."""
        return (*ON_AXIS, *ALIGNED, Row(kinds.ROW_SCREW, 0, "advance", (self.pitch,)))
