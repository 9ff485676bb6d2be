"""A spherical joint: the child turns freely about one point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.kinematic_pair import SPHERICAL
from flexmbd.multibody.joint.protocol import TOGETHER, FloatArray, Row, Step


@dataclass(frozen=True)
class Spherical:
    """Three rotations about a point.

    Coordinates: the quaternion of R_FG (scalar first); velocities: w_FG_G (rad/s).
    """

    turn: ClassVar[FloatArray] = np.eye(3)
    steps: ClassVar[tuple[Step, ...]] = (Step(SPHERICAL),)
    start: ClassVar[tuple[float, ...]] = (1.0, 0.0, 0.0, 0.0)
    velocity_names: ClassVar[tuple[str, ...]] = ("wx", "wy", "wz")
    angular: ClassVar[tuple[bool, ...]] = (True, True, True)
    reversible: ClassVar[bool] = False
    rows: ClassVar[tuple[Row, ...]] = TOGETHER
