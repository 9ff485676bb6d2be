"""Three translations: a point mass flies, any other body goes anywhere without turning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.kinematic_pair import KinematicPair
from flexmbd.multibody.joint.protocol import UNTURNED, CarriedBySteps, FloatArray, Row, Step

_ANYWHERE = KinematicPair(((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


@dataclass(frozen=True)
class Translation(CarriedBySteps):
    """Three translations and no rotation.

    Coordinates: p_FG_F (m).
    """

    turn: ClassVar[FloatArray] = np.eye(3)
    steps: ClassVar[tuple[Step, ...]] = (Step(_ANYWHERE),)
    velocity_names: ClassVar[tuple[str, ...]] = ("vx", "vy", "vz")
    rows: ClassVar[tuple[Row, ...]] = UNTURNED
