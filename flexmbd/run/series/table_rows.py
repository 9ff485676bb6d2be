"""Rows of a table of results: the times, and the values of its columns at these."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.given import is_number, numbers, shown
from flexmbd.round_off import EQUAL, TEN_DIGITS
from flexmbd.run.series.columns import Answers, ResultColumns

FloatArray = NDArray[np.float64]

_AT_ONCE = 1 << 16  # rows between the ends of steps


def table_times(ends: FloatArray, t: ArrayLike | None, every: float | None) -> FloatArray | None:
    """(k,) s of the rows of a table; None for the ends of steps.

    Raises:
        SceneError: both are given, times in rows and columns, or the time between two is not positive.
    """
    if every is None:
        times = None if t is None else np.atleast_1d(numbers(t))
        if times is not None and times.ndim > 1:
            raise SceneError(f"a table needs a time t, or an array (k,) of times, in s, got {shown(t)}")
        return times
    if t is not None or not (is_number(every) and every > 0.0):
        raise SceneError(f"a table needs times t, or every as a positive time (s), not t = {t!r} and every = {every!r}")
    if not len(ends):
        raise SceneError("the run stopped before its first row: there is nothing to tabulate")
    return equal_times(float(ends[0]), float(ends[-1]), every)


def tabulate(run: Answers, columns: Sequence[ResultColumns], *, t: FloatArray | None) -> ResultTable:
    """The table of a trajectory, at times (s) or at the ends of its steps.

    Raises:
        SceneError: a time outside the trajectory, or columns that know the ends of steps alone.
    """
    names = ("t", *(name for one in columns for name in one.names))
    units = ("s", *(unit for one in columns for unit in one.units))
    at = run.t if t is None else t
    try:
        values = np.empty((len(at), len(names)))
    except MemoryError as error:
        raise SceneError(
            f"there is no memory for a table of {len(at)} rows, {len(names)} columns; ask for fewer"
        ) from error
    values[:, 0] = at
    rows = _AT_ONCE if t is not None else max(1, len(at))
    for begin in range(0, max(1, len(at)), rows):  # motions are much wider than the table
        block = slice(begin, begin + rows)
        place = 1
        for one in columns:
            found = np.asarray(one.values(run, None if t is None else t[block]))
            values[block, place : place + len(one.names)] = found.reshape(len(at[block]), len(one.names))
            place += len(one.names)
    return ResultTable(names, units, values)


def equal_times(begin: float, end: float, every: float) -> FloatArray:
    """(k,) s: equal steps from the beginning, and the end."""
    steps = (end - begin) / every * (1 + EQUAL)
    try:
        t = begin + every * np.arange(math.floor(steps) + 1)
    except (OverflowError, ValueError, MemoryError) as error:
        raise SceneError(
            f"every = {every:g} s makes {steps:.3g} times, for which there is no memory; give a longer time"
        ) from error
    t[-1] = min(t[-1], end)
    return t if end - t[-1] <= TEN_DIGITS * every else np.append(t, end)
