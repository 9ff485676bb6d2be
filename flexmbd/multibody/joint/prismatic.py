"""A prismatic joint: the child slides along one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import ON_AXIS, UNTURNED, FloatArray, Row, Step
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

    @property
    def turn(self) -> FloatArray:
        """The axis as z."""
        return z_onto(self.axis)

    steps: ClassVar[tuple[Step, ...]] = (Step(at.PRISMATIC),)
    start: ClassVar[tuple[float, ...]] = (0.0,)
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement",)
    angular: ClassVar[tuple[bool, ...]] = (False,)
    reversible: ClassVar[bool] = True
    rows: ClassVar[tuple[Row, ...]] = (*ON_AXIS, *UNTURNED)
