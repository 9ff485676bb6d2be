"""A prismatic joint: the child slides along one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.kinematic_pair import PRISMATIC
from flexmbd.multibody.joint.protocol import ON_AXIS, UNTURNED, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class Prismatic(AlongAxis, CarriedBySteps):
    """One translation along ``axis``.

    Coordinate: the displacement (m) of G from F along the axis.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    steps: ClassVar[tuple[Step, ...]] = (Step(PRISMATIC),)
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement",)
    rows: ClassVar[tuple[Row, ...]] = (*ON_AXIS, *UNTURNED)
