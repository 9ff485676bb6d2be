"""A spherical joint: the child turns freely about one point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.kinematic_pair import SPHERICAL
from flexmbd.multibody.joint.protocol import TOGETHER, CarriedBySteps, FloatArray, Row, Step


@dataclass(frozen=True)
class Spherical(CarriedBySteps):
    """Three rotations about a point.

    Coordinates: the quaternion of R_FG (scalar first); velocities: w_FG_G (rad/s).
    """

    turn: ClassVar[FloatArray] = np.eye(3)
    steps: ClassVar[tuple[Step, ...]] = (Step(SPHERICAL),)
    velocity_names: ClassVar[tuple[str, ...]] = ("wx", "wy", "wz")
    rows: ClassVar[tuple[Row, ...]] = TOGETHER
