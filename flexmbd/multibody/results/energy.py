"""Energies of a machine over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.overflow import looked_at

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Energy:
    """Energies (J) at each instant, each (nt,)."""

    kinetic: FloatArray
    elastic: FloatArray
    gravitational: FloatArray
    spring: FloatArray

    __repr__ = brief

    @property
    @looked_at()
    def total(self) -> FloatArray:
        """Sum of the four."""
        return self.kinetic + self.elastic + self.gravitational + self.spring
