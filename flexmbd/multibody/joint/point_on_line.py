"""A point on a line: constraints alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import ON_AXIS, AlongAxis, ConstraintsAlone, Row
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class PointOnLine(AlongAxis, ConstraintsAlone):
    """The origin of G stays on the line through F's origin along ``axis`` of F.

    Attributes:
        axis: "x", "y", "z" or a vector (3,), in F.
    """

    axis: Axis = "z"

    rows: ClassVar[tuple[Row, ...]] = ON_AXIS
