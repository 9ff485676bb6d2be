"""A revolute joint: the child turns about one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import ALIGNED, TOGETHER, FloatArray, Row, Step
from flexmbd.multibody.kernels import layout as at
from flexmbd.rotation import Axis, z_onto


@dataclass(frozen=True)
class Revolute:
    """One rotation about ``axis``.

    Coordinate: the angle (rad) from F to G about the axis, right-handed.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    def __post_init__(self) -> None:
        z_onto(self.axis)  # refuses what is no axis

    @property
    def turn(self) -> FloatArray:
        """The axis as z."""
        return z_onto(self.axis)

    steps: ClassVar[tuple[Step, ...]] = (Step(at.REVOLUTE),)
    start: ClassVar[tuple[float, ...]] = (0.0,)
    velocity_names: ClassVar[tuple[str, ...]] = ("angle",)
    angular: ClassVar[tuple[bool, ...]] = (True,)
    reversible: ClassVar[bool] = True
    rows: ClassVar[tuple[Row, ...]] = (*TOGETHER, *ALIGNED)
