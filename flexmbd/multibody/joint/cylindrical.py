"""A cylindrical joint: the child slides along one axis and turns about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.kinematic_pair import PRISMATIC, REVOLUTE
from flexmbd.multibody.joint.protocol import ALIGNED, ON_AXIS, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class Cylindrical(AlongAxis, CarriedBySteps):
    """One translation along ``axis`` and one rotation about it.

    Coordinates: the displacement (m) of G from F along the axis, and the angle (rad) from F to G
    about it.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    steps: ClassVar[tuple[Step, ...]] = (Step(PRISMATIC), Step(REVOLUTE))
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement", "angle")
    rows: ClassVar[tuple[Row, ...]] = (*ON_AXIS, *ALIGNED)
