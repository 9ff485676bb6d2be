"""A disc that rolls on a plane without slip: constraints alone, two of them on velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.protocol import ConstraintsAlone, FloatArray, Row, positive
from flexmbd.multibody.kernels.base import kinds


@dataclass(frozen=True)
class RollingDisc(ConstraintsAlone):
    """The rim of a thin disc touches the plane z = 0 of F and its touching point does not slip.

    The disc's centre is the origin of G and its axis z of G; it stands on the side of positive z
    and must not lie flat.  Touching is a constraint on positions; that nothing slips along x and y
    of F holds velocities alone and cannot be integrated.

    Attributes:
        radius: m, positive.
    """

    radius: float

    def __post_init__(self) -> None:
        positive(self.radius, "the radius of a RollingDisc")

    turn: ClassVar[FloatArray] = np.eye(3)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Touching, and no slip along x and y."""
        data = (self.radius,)
        return (
            Row(kinds.ROW_TOUCH, 0, "touching", data),
            Row(kinds.ROW_ROLL, 0, "no slip along x", data, kinds.LEVEL_VELOCITY),
            Row(kinds.ROW_ROLL, 1, "no slip along y", data, kinds.LEVEL_VELOCITY),
        )
