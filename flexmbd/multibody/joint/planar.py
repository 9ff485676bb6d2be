"""A planar joint: the child slides on a plane and turns about its normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.kinematic_pair import PRISMATIC, REVOLUTE
from flexmbd.multibody.joint.protocol import ALIGNED, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class Planar(AlongAxis, CarriedBySteps):
    """Two translations across ``axis``, the plane's normal, and one rotation about it.

    Coordinates: the displacements (m) of G from F along the first and second column of ``turn``
    (along x and y for the axis z, y and z for x, z and x for y), and the angle (rad) about the
    normal.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    steps: ClassVar[tuple[Step, ...]] = (Step(PRISMATIC, "x"), Step(PRISMATIC, "y"), Step(REVOLUTE))
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement 1", "displacement 2", "angle")
    rows: ClassVar[tuple[Row, ...]] = (Row(kinds.ROW_TRANSLATION, 2, "translation z"), *ALIGNED)
