"""Motions of a machine beside its start: vibrations, or as many combinations of them as its start tells apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motions:
    """k of them, each of kinetic energy 1/2 at unit velocity.

    Attributes:
        squares: (k,) 1/s^2, their stiffness, ascending.
        shapes: (free, k) of the free coordinates.
        damping: (k, k) 1/s.
        pushes, runs: (k,) of the start's accelerations and velocities.
    """

    squares: FloatArray
    shapes: FloatArray
    damping: FloatArray
    pushes: FloatArray
    runs: FloatArray
