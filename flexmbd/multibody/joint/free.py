"""A free joint: the child flies, its pose is six coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.kinematic_pair import FREE
from flexmbd.multibody.joint.protocol import CarriedBySteps, FloatArray, Row, Step


@dataclass(frozen=True)
class Free(CarriedBySteps):
    """Six relative motions, no reaction.

    Coordinates: p_FG_F (m), then the quaternion of R_FG; velocities: the rate of p_FG_F
    (m/s), then w_FG_G (rad/s).
    """

    turn: ClassVar[FloatArray] = np.eye(3)
    steps: ClassVar[tuple[Step, ...]] = (Step(FREE),)
    velocity_names: ClassVar[tuple[str, ...]] = ("vx", "vy", "vz", "wx", "wy", "wz")
    rows: ClassVar[tuple[Row, ...]] = ()
