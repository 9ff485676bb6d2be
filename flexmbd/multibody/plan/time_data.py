"""What the kernels read of a function of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.functions.time_function import TimeRow
from flexmbd.multibody.kernels.base import kinds

FloatArray = NDArray[np.float64]


def data_with_integrals(row: TimeRow) -> FloatArray:
    """A function's data; of piecewise polynomials of several pieces also ``time_functions.integrals`` to each piece."""
    if row.kind != kinds.TIME_PIECEWISE or row.count == 1:
        return row.data
    from scipy.interpolate import PPoly  # on need: 0.2 s

    x = row.data[1 : row.count + 2]
    poly = PPoly(row.data[row.count + 2 :].reshape(row.count, -1).T, x)
    width = np.diff(x)[:-1]
    found = np.zeros((row.count, 3))
    for k, whole in enumerate((poly.antiderivative(), poly, poly.derivative())):
        gains = np.zeros(row.count - 1)
        for c in whole.c[:-1, :-1]:
            gains = (gains + c) * width
        found[1:, k] = np.cumsum(gains)
    return np.concatenate([row.data, found.ravel()])
