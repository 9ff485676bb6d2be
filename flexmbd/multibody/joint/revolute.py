"""A revolute joint: the child turns about one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import Row
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

    kind: ClassVar[int] = at.REVOLUTE
    start: ClassVar[tuple[float, ...]] = (0.0,)
    velocity_names: ClassVar[tuple[str, ...]] = ("angle",)
    angular: ClassVar[tuple[bool, ...]] = (True,)
    reversible: ClassVar[bool] = True
    rows: ClassVar[tuple[Row, ...]] = (
        (at.ROW_TRANSLATION, 0, "translation x"),
        (at.ROW_TRANSLATION, 1, "translation y"),
        (at.ROW_TRANSLATION, 2, "translation z"),
        (at.ROW_DIRECTION, 2, "rotation y"),
        (at.ROW_DIRECTION, 5, "rotation x"),
    )
