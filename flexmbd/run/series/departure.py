"""How a machine goes on from a break of a function of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Departure:
    """Velocities and accelerations (nv,) just after the instant of a row."""

    row: int
    v: FloatArray
    a: FloatArray

    __repr__ = brief
