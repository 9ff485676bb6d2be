"""A prismatic joint: the child slides along one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import Row
from flexmbd.multibody.kernels import layout as at
from flexmbd.rotation import Axis, z_onto


@dataclass(frozen=True)
class Prismatic:
    """One translation along ``axis``.

    Coordinate: the displacement (m) of G from F along the axis.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    def __post_init__(self) -> None:
        z_onto(self.axis)  # refuses what is no axis

    kind: ClassVar[int] = at.PRISMATIC
    start: ClassVar[tuple[float, ...]] = (0.0,)
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement",)
    angular: ClassVar[tuple[bool, ...]] = (False,)
    reversible: ClassVar[bool] = True
    rows: ClassVar[tuple[Row, ...]] = (
        (at.ROW_TRANSLATION, 0, "translation x"),
        (at.ROW_TRANSLATION, 1, "translation y"),
        (at.ROW_AXIS, 0, "rotation x"),
        (at.ROW_AXIS, 1, "rotation y"),
        (at.ROW_AXIS, 2, "rotation z"),
    )
