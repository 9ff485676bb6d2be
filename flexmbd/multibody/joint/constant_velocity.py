"""A constant-velocity joint of two shafts: constraints alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import TOGETHER, AlongAxis, ConstraintsAlone, Row
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class ConstantVelocity(AlongAxis, ConstraintsAlone):
    """Two shafts through one point, bent by any angle below pi, that always turn at one speed.

    The shaft of G is that of F turned about an axis across it: the plane between the two halves
    their angle, and F's turn about its shaft is G's about its own.

    Attributes:
        axis: the shaft: "x", "y", "z" or a vector (3,), in both frames.
    """

    axis: Axis = "z"

    rows: ClassVar[tuple[Row, ...]] = (*TOGETHER, Row(kinds.ROW_ANGLE, 0, "equal turning"))
