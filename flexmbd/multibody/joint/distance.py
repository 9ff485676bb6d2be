"""A constant distance between two points: a constraint alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.protocol import ConstraintsAlone, FloatArray, Row, positive
from flexmbd.multibody.kernels.base import kinds


@dataclass(frozen=True)
class Distance(ConstraintsAlone):
    """The origins of F and G stay apart by ``length``, as if by a massless rod with two balls.

    The multiplier is the rod's tension (N).

    Attributes:
        length: m, positive.
    """

    length: float

    def __post_init__(self) -> None:
        positive(self.length, "the length of a Distance")

    turn: ClassVar[FloatArray] = np.eye(3)

    @property
    def rows(self) -> tuple[Row, ...]:
        """(|p_FG|^2 / length - length) / 2 = 0, which has no singular point."""
        return (Row(kinds.ROW_DISTANCE, 0, "distance", (self.length,)),)
