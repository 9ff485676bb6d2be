"""A revolute joint: the child turns about one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.kinematic_pair import REVOLUTE
from flexmbd.multibody.joint.protocol import ALIGNED, TOGETHER, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class Revolute(AlongAxis, CarriedBySteps):
    """One rotation about ``axis``.

    Coordinate: the angle (rad) from F to G about the axis, right-handed.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    steps: ClassVar[tuple[Step, ...]] = (Step(REVOLUTE),)
    velocity_names: ClassVar[tuple[str, ...]] = ("angle",)
    rows: ClassVar[tuple[Row, ...]] = (*TOGETHER, *ALIGNED)
