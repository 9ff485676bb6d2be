"""A point on a plane as coordinates: the child slides on a plane and does not turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.kinematic_pair import KinematicPair
from flexmbd.multibody.joint.protocol import UNTURNED, AlongAxis, CarriedBySteps, Row, Step
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis

_IN_PLANE = KinematicPair(((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)))


@dataclass(frozen=True)
class PlanarPoint(AlongAxis, CarriedBySteps):
    """Two translations across ``axis``, the plane's normal, and no rotation.

    Coordinates: the displacements (m) of G from F along the first and second column of ``turn``
    (along x and y for the axis z, y and z for x, z and x for y).

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    steps: ClassVar[tuple[Step, ...]] = (Step(_IN_PLANE),)
    velocity_names: ClassVar[tuple[str, ...]] = ("displacement 1", "displacement 2")
    rows: ClassVar[tuple[Row, ...]] = (Row(kinds.ROW_TRANSLATION, 2, "translation z"), *UNTURNED)
