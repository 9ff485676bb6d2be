"""A fixed joint: the child is bonded to the parent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.multibody.joint.kinematic_pair import FIXED
from flexmbd.multibody.joint.protocol import TOGETHER, UNTURNED, CarriedBySteps, FloatArray, Row, Step


@dataclass(frozen=True)
class Fixed(CarriedBySteps):
    """No relative motion; no coordinates."""

    turn: ClassVar[FloatArray] = np.eye(3)
    steps: ClassVar[tuple[Step, ...]] = (Step(FIXED),)
    velocity_names: ClassVar[tuple[str, ...]] = ()
    rows: ClassVar[tuple[Row, ...]] = (*TOGETHER, *UNTURNED)
