"""Linear systems of other libraries, taken as they are: scipy.signal's and python-control's."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """z' = A z + B u, or from sample to sample z_next = A z + B u; y = C z + D u.

    Attributes:
        A, B, C, D: (n, n), (n, m), (k, n), (k, m).
        period: s between two samples; None: it is continuous, 0: discrete, with a period that is not told.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    period: float | None


def as_linear_system(given: object, what: str) -> LinearSystem | None:
    """A system of scipy.signal or of python-control by its matrices; None where it is none of these.

    A library that was never loaded has made no system, and is not loaded here.

    Raises:
        SceneError: it has no state space, as a transfer function that is improper; ``what`` is for the message.
    """
    try:
        found = _of_scipy(given) or _of_control(given)
    except (ValueError, NotImplementedError, ImportError, TypeError) as reason:
        raise SceneError(f"{what}: {type(given).__name__} cannot be written as a state space: {reason}") from reason
    if found is not None and not all(np.isfinite(part).all() for part in (found.A, found.B, found.C, found.D)):
        raise SceneError(f"{what}: the matrices of {type(given).__name__} are not finite")
    return found


def _of_scipy(given: Any) -> LinearSystem | None:
    signal = sys.modules.get("scipy.signal")
    if signal is None or not isinstance(given, (signal.lti, signal.dlti)):
        return None
    space = given.to_ss()
    period = _period(space.dt) if isinstance(given, signal.dlti) else None
    return _system(space, period)


def _of_control(given: Any) -> LinearSystem | None:
    control = sys.modules.get("control")
    if control is None or not isinstance(given, (control.StateSpace, control.TransferFunction)):
        return None
    space = control.ss(given)
    return _system(space, None if space.isctime() else _period(space.dt))


def _period(told: Any) -> float:
    """Both libraries have True for a period that is not told."""
    return 0.0 if told is True else float(told)


def _system(space: Any, period: float | None) -> LinearSystem:
    A, B, C, D = (np.atleast_2d(np.array(part, dtype=np.float64)) for part in (space.A, space.B, space.C, space.D))
    return LinearSystem(A, B, C, D, period)
