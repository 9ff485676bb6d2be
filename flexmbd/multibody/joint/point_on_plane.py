"""A point on a plane: a constraint alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.joint.protocol import AlongAxis, ConstraintsAlone, Row
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis


@dataclass(frozen=True)
class PointOnPlane(AlongAxis, ConstraintsAlone):
    """The origin of G stays in the plane through F's origin across ``axis`` of F.

    Attributes:
        axis: the normal: "x", "y", "z" or a vector (3,), in F.
    """

    axis: Axis = "z"

    rows: ClassVar[tuple[Row, ...]] = (Row(kinds.ROW_TRANSLATION, 2, "translation z"),)
