"""Small numbers of the checks: sizes, quotients and differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from flexmbd.continuum.contract_suite.trial import FloatArray, Trial


def largest(values: npt.ArrayLike) -> float:
    """Largest magnitude; NaN if any is."""
    return float(np.max(np.abs(values), initial=0.0))


def ratio(part: Any, whole: Any) -> float:
    """Quotient of two numbers; zero where the part is."""
    if part == 0.0:
        return 0.0
    return float(part / whole) if whole != 0.0 else float("inf")


def elastic_force(trial: Trial, u: FloatArray) -> float:
    """Largest force of an unknown at rest's stiffness, scaled."""
    return largest(trial.scale * (trial.stiffness(trial.rest()) @ u))


def difference(
    function: Callable[[FloatArray], FloatArray], at: FloatArray, step: FloatArray
) -> FloatArray:
    """Derivative of a function along a step, by central differences of fourth order."""
    h = 1e-3
    near = function(at + h * step) - function(at - h * step)
    far = function(at + 2 * h * step) - function(at - 2 * h * step)
    return np.asarray((8 * near - far) / (12 * h))
