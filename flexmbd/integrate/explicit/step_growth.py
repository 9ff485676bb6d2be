"""What a step of each explicit method makes of a disturbance of the linear machine y'' = -K y - C y'."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate.explicit.tableau import Pair, Tableau

FloatArray = NDArray[np.float64]

_SHARP = 1e-11  # growth in a step that is round-off


@dataclass(frozen=True)
class StepGrowth:
    """A method's answer to a disturbance.

    Attributes:
        name: of the method.
        keeps: (h^2 times the largest of K, h times the largest of C) -> whether K and C without negative directions
            are certainly stable.
        growth: (K, C, h) -> the logarithm of the largest growth in a step.
        otherwise: what else may be taken than a shorter step.
    """

    name: str
    keeps: Callable[[float, float], bool]
    growth: Callable[[FloatArray, FloatArray, float], float]
    otherwise: str = ", none (then rtol rules the step), or an implicit method, integrator=fm.GeneralizedAlpha()"


def companion(stiffness: FloatArray, damping: FloatArray) -> FloatArray:
    """The matrix (2 k, 2 k) of the first order, of y and y'."""
    k = len(stiffness)
    return np.block([[np.zeros((k, k)), np.eye(k)], [-stiffness, -damping]])


@cache
def runge_kutta_growth(pair: Pair | Tableau, name: str) -> StepGrowth:
    """Of a Runge-Kutta method: R(h lambda) of each eigenvalue lambda of the machine."""
    factors = _stability_polynomial(pair)
    radii, angles = np.linspace(0.02, 8.0, 400), np.linspace(0.5 * np.pi, np.pi, 91)
    sizes = np.abs(np.polyval(factors, radii[:, None] * np.exp(1j * angles)))
    reach = float(radii[np.argmax((sizes > 1.0 + _SHARP).any(axis=1))] - 0.02)

    def keeps(k: float, c: float) -> bool:
        return 0.5 * (c + math.sqrt(c * c + 4.0 * k)) <= reach

    def growth(stiffness: FloatArray, damping: FloatArray, h: float) -> float:
        rates = np.linalg.eigvals(companion(stiffness, damping))
        return _logarithm(np.abs(np.polyval(factors, h * rates)))

    return StepGrowth(name, keeps, growth)


def _stability_polynomial(pair: Pair | Tableau) -> FloatArray:
    """Factors of R(z) = 1 + z b^T (I - z A)^-1 1, the highest power first (Hairer & Wanner 1996, eq. IV.2.4)."""
    a = pair.tableau.a
    stages: FloatArray = np.ones(a.shape[1])
    factors = [1.0]
    for _ in range(a.shape[1]):
        factors.append(float(a[-1] @ stages))
        stages = a[:-1] @ stages
    return np.array(factors[::-1])


@cache
def central_difference_growth(corrected: bool, name: str) -> StepGrowth:
    """Of central differences: the amplification of y, y', y'' and, where velocities are corrected, of y'' before."""
    return StepGrowth(name, _central_keeps, partial(_central_growth, corrected))


def _central_keeps(k: float, c: float) -> bool:
    """Exact with velocities as predicted, and enough with corrected ones."""
    return k + 4.0 * c <= 4.0


def _central_growth(corrected: bool, stiffness: FloatArray, damping: FloatArray, h: float) -> float:
    """By a step of each unit vector, as ``central_step`` takes it."""
    n = len(stiffness)
    y, v, a, before = np.eye(4 * n).reshape(4, n, 4 * n)
    end = y + h * v + 0.5 * h * h * a
    guess = v + h * a + (0.5 * h * (a - before) if corrected else 0.0)
    push = -stiffness @ end
    found = push - damping @ guess
    speed = v + 0.5 * h * (a + found)
    if corrected:
        found = push - damping @ speed
        speed = v + 0.5 * h * (a + found)
    return _logarithm(np.abs(np.linalg.eigvals(np.concatenate([end, speed, found, a]))))


def _logarithm(sizes: FloatArray) -> float:
    return math.log(max(float(sizes.max(initial=0.0)), 1e-300))
