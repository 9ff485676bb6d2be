"""Which eigenvalues of a stiffness belong to motions that grow, alone or two in flutter; for all spaces alike.

A motion along an eigenvector grows where the eigenvalue is negative. Of forces without a potential two eigenvalues may
meet and become complex: of the motions exp(s t), s^2 = - mu, two grow then, whatever the real parts.
"""

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


def grows(values: NDArray[np.complex128], round_off: float) -> NDArray[np.bool_]:
    """Which are of motions that grow, ``round_off`` being what is left of an eigenvalue that is zero."""
    return np.asarray((flutters(values) | (values.real < 0.0)) & (np.abs(values) > round_off))


def count_growing(values: NDArray[np.complex128], round_off: float) -> int:
    """How many independent motions grow; of a pair in flutter, of which the second may not be among them, two."""
    growing, pairs = grows(values, round_off), flutters(values)
    return int(np.count_nonzero(growing & ~pairs) + 2 * np.count_nonzero(growing & pairs & (values.imag > 0.0)))
