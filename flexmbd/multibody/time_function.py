"""Functions of time that a scene may hold, as data the kernels read or functions they call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numba import cfunc, types
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PPoly

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels import layout as at

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Sine:
    """offset + amplitude sin(omega t + phase); omega in rad/s, phase in rad."""

    amplitude: float
    omega: float
    phase: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Table:
    """A cubic spline through the points (t, y); t in s, ascending."""

    t: ArrayLike
    y: ArrayLike


@dataclass(frozen=True, eq=False)
class Compiled:
    """A compiled scalar function of time; made by ``flexmbd.compiled``."""

    address: int
    keep: Any
    name: str


@dataclass(frozen=True, eq=False)
class Motion:
    """A prescribed motion by three functions made by ``flexmbd.compiled``."""

    value: Compiled
    rate: Compiled
    acceleration: Compiled


#: What may stand where a function of time is asked for.
TimeFunction = Union[  # noqa: UP007  (a plain | fails at run time: scipy types are unknown to it)
    float, Sine, Table, PPoly, Compiled, Motion, Callable[[float], Any]
]


def compiled(function: Callable[[float], float]) -> Compiled:
    """Compile ``f(t) -> float`` with numba, to be called inside the step without Python.

    Divisions by zero give infinities, as in numpy: an exception could not leave the step, and
    numba would hand back a number in its place.
    """
    pointer = cfunc(types.float64(types.float64), error_model="numpy")(function)
    return Compiled(int(pointer.address), pointer, function.__name__)


@dataclass(frozen=True, eq=False)
class TimeRow:
    """One function of time as the plan holds it.

    Attributes:
        kind: TIME_* code.
        data: numbers for the kernel.
        count: number of pieces of a piecewise polynomial.
        addresses: value, rate, acceleration of compiled functions, 0 where absent.
        call: the Python callable of TIME_PYTHON, else None.
        text: how ``explain`` calls it.
    """

    kind: int
    data: FloatArray
    count: int
    addresses: tuple[int, int, int]
    call: Callable[[float], Any] | None
    text: str


def as_row(function: TimeFunction, what: str, *, motion: bool) -> TimeRow:
    """Translate what a user gave into a ``TimeRow``.

    Args:
        function: the user's function of time.
        what: what it is for, in messages.
        motion: whether rate and acceleration are needed as well.

    Raises:
        SceneError: it is of no known kind, not finite, or lacks the derivatives.
    """
    none = (0, 0, 0)
    if isinstance(function, (int, float, np.integer, np.floating)):
        value = float(function)
        if not np.isfinite(value):
            raise SceneError(f"{what}: {value} is not a finite number")
        return TimeRow(
            at.TIME_PIECEWISE, np.array([1.0, 0.0, 1.0, value]), 1, none, None, f"{value:g}"
        )
    if isinstance(function, Sine):
        values = [function.offset, function.amplitude, function.omega, function.phase]
        return TimeRow(at.TIME_SINE, np.array(values, float), 0, none, None, "sine")
    if isinstance(function, Table):
        function = spline(function, what)
    if isinstance(function, PPoly):
        return _piecewise(function, what)
    if isinstance(function, Motion):
        addresses = (
            function.value.address,
            function.rate.address,
            function.acceleration.address,
        )
        text = f"compiled {function.value.name}"
        return TimeRow(at.TIME_COMPILED, np.zeros(0), 0, addresses, None, text)
    if isinstance(function, Compiled):
        if motion:
            raise SceneError(
                f"{what}: a prescribed motion needs rate and acceleration as well; give "
                "flexmbd.Motion(value, rate, acceleration) of three compiled functions"
            )
        return TimeRow(
            at.TIME_COMPILED,
            np.zeros(0),
            0,
            (function.address, 0, 0),
            None,
            f"compiled {function.name}",
        )
    if callable(function):
        return TimeRow(at.TIME_PYTHON, np.zeros(0), 0, none, function, "Python callable")
    raise SceneError(
        f"{what}: {type(function).__name__} is no function of time; give a number, "
        "flexmbd.Table, flexmbd.Sine, a scipy PPoly, a compiled function or a callable"
    )


def spline(table: Table, what: str) -> PPoly:
    """The cubic spline through a table's points; SceneError where there is none."""
    t = np.asarray(table.t, dtype=np.float64)
    y = np.asarray(table.y, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 2:
        raise SceneError(f"{what}: a table needs t and y of one length, at least 2")
    if not (np.isfinite(t).all() and np.isfinite(y).all() and (np.diff(t) > 0.0).all()):
        raise SceneError(f"{what}: a table needs finite values and strictly ascending t")
    return CubicSpline(t, y)


def _piecewise(poly: PPoly, what: str) -> TimeRow:
    if poly.c.ndim != 2 or not (np.isfinite(poly.c).all() and np.isfinite(poly.x).all()):
        raise SceneError(f"{what}: a piecewise polynomial must be scalar and finite")
    if not (np.diff(poly.x) > 0.0).all():
        raise SceneError(f"{what}: a piecewise polynomial needs ascending breakpoints")
    order, pieces = poly.c.shape
    data = np.concatenate([[float(order)], poly.x, poly.c.T.ravel()])
    return TimeRow(
        at.TIME_PIECEWISE, data, pieces, (0, 0, 0), None, f"piecewise polynomial ({pieces})"
    )


def ask_python(row: TimeRow, t: float, what: str, *, motion: bool) -> tuple[float, float, float]:
    """Call a Python function of time and check what it gives.

    Raises:
        SceneError: wrong shape or not finite; the message names the function and the time.
    """
    if row.call is None:
        raise SceneError(f"{what} is no Python callable")
    answer = np.asarray(row.call(t), dtype=np.float64)
    shape = (3,) if motion else ()
    if answer.shape != shape:
        wanted = "(value, rate, acceleration)" if motion else "one number"
        raise SceneError(f"{what}: at t = {t:g} s it gave shape {answer.shape}, not {wanted}")
    if not np.isfinite(answer).all():
        raise SceneError(f"{what}: at t = {t:g} s it gave {answer}, not finite")
    if motion:
        return float(answer[0]), float(answer[1]), float(answer[2])
    return float(answer), 0.0, 0.0
