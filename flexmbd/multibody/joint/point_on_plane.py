"""A point on a plane: a constraint alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import FloatArray, Row, Step
from flexmbd.multibody.kernels import layout as at
from flexmbd.rotation import Axis, z_onto


@dataclass(frozen=True)
class PointOnPlane:
    """The origin of G stays in the plane through F's origin across ``axis`` of F.

    Attributes:
        axis: the normal: "x", "y", "z" or a vector (3,), in F.
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
    rows: ClassVar[tuple[Row, ...]] = (Row(at.ROW_TRANSLATION, 2, "translation z"),)
