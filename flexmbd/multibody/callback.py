"""Python callables called from inside a compiled step, through C function pointers.

The kernels know an address and call it, as they call compiled functions; ctypes takes the
interpreter's lock for the call.  An exception cannot leave the step: it is kept here, NaN is
handed back, and the flag tells the stepper to stop at once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.team import Team
from flexmbd.multibody.time_function import TimeRow, ask_python

FloatArray = NDArray[np.float64]

_TimeThunk = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.POINTER(ctypes.c_double))


class Callbacks:
    """The Python callables of one compiled scene, and the first error among them.

    Attributes:
        flag: (1,) int64, not zero once a callable has failed; the plan holds it too.
        error: what it raised.
        t: the time (s) it was asked for.
    """

    def __init__(self, team: Team) -> None:
        self.flag = np.zeros(1, np.int64)
        self.error: BaseException | None = None
        self.t = np.nan
        self._team = team
        self._kept: list[Any] = []  # ctypes frees a thunk that nothing holds

    def of_time(self, row: TimeRow, what: str, *, motion: bool) -> int:
        """Return the address of ``void f(double t, double out[3])`` for a function of time."""

        def thunk(t: float, out: Any) -> None:
            values = self._agreed(t, 3, lambda: np.array(ask_python(row, t, what, motion=motion)))
            for k in range(3):
                out[k] = values[k]

        return self._keep(_TimeThunk(thunk))

    def reset(self) -> None:
        """Forget an error."""
        self.flag[0] = 0
        self.error = None

    def _agreed(self, t: float, size: int, ask: Callable[[], FloatArray]) -> FloatArray:
        """Rank 0's answer on every rank, or NaN on every rank where any rank's callable fails."""
        values: FloatArray = np.full(size, np.nan)
        if self.flag[0]:
            return values
        error: Exception | None = None
        try:
            values = ask()
        except Exception as reason:  # noqa: BLE001  (a user's function: any error, told by the simulation)
            error = reason
        except BaseException as reason:  # an interrupt: it must not be lost inside the step
            self._fail(t, reason)
            return values
        try:
            self._team.fail(error)
            return self._team.agree(values)
        except Exception as reason:  # noqa: BLE001  (this rank's or another's)
            self._fail(t, reason)
            return np.full(size, np.nan)

    def _fail(self, t: float, error: BaseException) -> None:
        self.flag[0] = 1
        self.error = error
        self.t = t

    def _keep(self, thunk: Any) -> int:
        self._kept.append(thunk)
        return int(ctypes.cast(thunk, ctypes.c_void_p).value or 0)
