"""Coefficients of Radau IIA with three stages, from collocation (Hairer & Wanner 1996, sections IV.5, IV.8)."""

from __future__ import annotations

import numpy as np

STAGES = 3
ORDER = 5

#: (3,) instants of the stages in steps; the last is the step's end.
NODES = np.array([(4.0 - np.sqrt(6.0)) / 10.0, (4.0 + np.sqrt(6.0)) / 10.0, 1.0])

_POWERS = NODES[:, None] ** np.arange(STAGES)
_INVERSE = np.linalg.inv(_POWERS)

#: (3, 3) weights of the stages' rates in each stage's increment, per step.
WEIGHTS = NODES[:, None] * _POWERS / np.arange(1, STAGES + 1) @ _INVERSE

#: (3,) of each stage's rate in the increment of the step, per step.
QUADRATURE = WEIGHTS[2].copy()

_values, _vectors = np.linalg.eig(np.linalg.inv(WEIGHTS))
_order = np.argsort(_values.imag)  # a pair of conjugates about a real one

#: Eigenvalues of the inverse of WEIGHTS: a real one, and the one of the pair above the axis.
REAL = float(_values[_order[1]].real)
COMPLEX = complex(_values[_order[2]])

_pair = _vectors[:, _order[2]]
_real = _vectors[:, _order[1]].real
#: (3, 3) WEIGHTS^-1 = BASIS blockdiag(REAL, [[Re, -Im], [Im, Re]]) BASIS^-1.
BASIS = np.column_stack([_real, _pair.real, -_pair.imag])
BASIS_INVERSE = np.linalg.inv(BASIS)

#: (3,) share of each stage's rate in the error estimate, beside 1 / REAL of the rate at the start (eq. IV.8.19):
#: the gap between that rate and what the stages' parabola makes of it.
ERROR_WEIGHTS = -_INVERSE[0] / REAL

#: (3,) second derivative of the parabola through the stages' rates, times the step squared.
CURVATURE = 2.0 * _INVERSE[2]


def _polynomial(nodes: np.ndarray) -> np.ndarray:
    """Inverse Vandermonde matrix: values at ``nodes`` to coefficients, lowest first."""
    return np.linalg.inv(nodes[:, None] ** np.arange(len(nodes)))


#: (3, 3) values at the stages to coefficients of their polynomial in t / step.
TO_POWERS = _polynomial(NODES)
