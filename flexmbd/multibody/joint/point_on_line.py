"""A point on a line: constraints alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import ON_AXIS, FloatArray, Row, Step
from flexmbd.rotation import Axis, z_onto


@dataclass(frozen=True)
class PointOnLine:
    """The origin of G stays on the line through F's origin along ``axis`` of F.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in F.
    """

    axis: Axis = "z"

    def __post_init__(self) -> None:
        z_onto(self.axis)  # refuses what is no axis

    @property
    def turn(self) -> FloatArray:
        """The axis as z."""
        return z_onto(self.axis)

    steps: ClassVar[tuple[Step, ...]] = ()
    start: ClassVar[tuple[float, ...]] = ()
    velocity_names: ClassVar[tuple[str, ...]] = ()
    angular: ClassVar[tuple[bool, ...]] = ()
    reversible: ClassVar[bool] = False
    rows: ClassVar[tuple[Row, ...]] = ON_AXIS
