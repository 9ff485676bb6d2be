"""Which eigenvalues belong to vibrations that flutter: pairs that have met and become complex; for all spaces alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PAIR = 1e-6  # imaginary part over size, below which round-off may have parted two equal eigenvalues


def parted(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """How far apart the two of a pair are, over their size."""
    return np.asarray(np.abs(values.imag) / np.maximum(np.abs(values), np.finfo(float).tiny))


def flutters(values: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Which are complex: of two motions that grow together."""
    return np.asarray(parted(values) > _PAIR)
