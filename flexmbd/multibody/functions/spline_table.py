"""Tables that users give as functions of time or of a joint coordinate, as splines."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError, TableWarning, warn
from flexmbd.given import numbers, refuse_no_truth

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

FloatArray = NDArray[np.float64]


class Beyond(Enum):
    """How a table goes on before its first point and after its last.

    Attributes:
        HOLD: it keeps the first and the last value.
        LINEAR: it goes on straight, with the slopes that it has there.
        EXTRAPOLATE: its first and last cubics go on, as far from the points as they may lead.
    """

    HOLD = "hold"
    LINEAR = "linear"
    EXTRAPOLATE = "extrapolate"


@dataclass(frozen=True, eq=False)
class Table:
    """A cubic spline through the points (t, y); t in s, ascending.

    A spline's second derivative is continuous, as a motion's should be, but beside a jump or a pulse it swings over.
    Where it would do so by more than the points' whole range the table is monotone, which a ``TableWarning`` tells.

    Attributes:
        t: (n,) s.
        y: (n,) values.
        monotone: stay between neighbouring points, and level between equal ones (Fritsch and Butland 1984,
            doi:10.1137/0905021); then only the first derivative is continuous, and a smooth function is met less well.
        beyond: the values before the first point and after the last. Held, its slope there is zero: a motion whose
            points do not end at rest stops dead at the last of them, and the machine takes the impulse.
    """

    t: ArrayLike
    y: ArrayLike
    monotone: bool = field(default=False, kw_only=True)
    beyond: Beyond = field(default=Beyond.HOLD, kw_only=True)


def is_polynomial(function: Any) -> TypeGuard[PPoly]:
    """Whether it is scipy's piecewise polynomial; where scipy.interpolate was never loaded there is none."""
    loaded = sys.modules.get("scipy.interpolate")
    return loaded is not None and isinstance(function, loaded.PPoly)


def spline(table: Table, what: str) -> PPoly:
    """A table as a piecewise cubic whose end pieces extend it as the table's `beyond` says.

    Warns with a TableWarning where cubics would leave the range of the points by more than that range, and takes
    monotone ones there.

    Raises:
        SceneError: the table is none.
    """
    t, y = numbers(table.t), numbers(table.y)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 2:
        raise SceneError(f"{what}: a table needs numbers t and y, of one length, at least 2")
    if not (np.isfinite(t).all() and np.isfinite(y).all() and (np.diff(t) > 0.0).all()):
        raise SceneError(f"{what}: a table needs finite values and strictly ascending t")
    if not isinstance(table.beyond, Beyond):
        raise SceneError(
            f"{what}: a table's beyond must be fm.Beyond.HOLD, LINEAR or EXTRAPOLATE, got {table.beyond!r}"
        )
    refuse_no_truth(monotone=table.monotone)
    from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly  # on need: 0.2 s

    inner = None if table.monotone else CubicSpline(t, y)
    if inner is None or _swings(inner, y, what):
        inner = PchipInterpolator(t, y)
    if table.beyond is Beyond.EXTRAPOLATE:
        return inner
    # straight pieces at both ends, as wide as the table; the first begins where the line from its end is there
    width = t[-1] - t[0]
    ends = np.zeros((len(inner.c), 2))
    if table.beyond is Beyond.LINEAR:
        ends[-2] = inner(t[[0, -1]], 1)
    ends[-1] = y[[0, -1]] - ends[-2] * [width, 0.0]
    x = np.concatenate([[t[0] - width], t, [t[-1] + width]])
    return PPoly(np.column_stack([ends[:, 0], inner.c, ends[:, 1]]), x)


def _swings(inner: PPoly, y: FloatArray, what: str) -> bool:
    """Whether cubics leave the range of the points by more than that range, which is told."""
    turns = inner.derivative().roots(discontinuity=False, extrapolate=False)
    turns = turns[np.isfinite(turns)]  # a piece that is constant has them everywhere
    if len(turns) == 0:
        return False
    values = inner(turns)
    low, high = y.min(), y.max()
    beyond = np.maximum(values - high, low - values)
    worst = int(np.argmax(beyond))
    # by less than the points' own range a smooth function's true extremes may lie outside of them; by more, the cubics
    # make more of the curve than the points do
    if not beyond[worst] > high - low:
        return False
    warn(
        f"{what}: the cubic spline through its points, which lie between {low:.6g} and {high:.6g}, swings to "
        f"{values[worst]:.6g} at {turns[worst]:.6g}; it is taken as fm.Table(t, y, monotone=True), which stays between "
        "neighbours and says nothing; for a smooth curve give more points where it is steep, or a scipy CubicSpline",
        TableWarning,
    )
    return True
