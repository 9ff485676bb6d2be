"""The motion between the ends of steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.sampling.interpolation import interpolated_coordinates, motion_at
from flexmbd.overflow import looked_at
from flexmbd.round_off import EQUAL
from flexmbd.run.series.departure import Departure

FloatArray = NDArray[np.float64]
#: t (nt,), x (nt, nx), v and a (nt, nv) at the ends of steps.
Rows: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@looked_at()
def motion_between(
    plan: Plan, rows: Rows, departures: Sequence[Departure], t: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Configurations (k, nx), velocities and accelerations (k, nv) at times (s).

    Raises:
        SceneError: a time outside the rows, or not a time.
    """
    wanted = np.atleast_1d(numbers(t))
    if wanted.ndim > 1 or not wanted.size or not np.isfinite(wanted).all():
        raise SceneError(f"a time, or an array (k,) of times, in s is wanted, got {t!r:.100}")
    ends = rows[0]
    if not len(ends):
        raise SceneError("the run stopped before its first row: there is no motion to ask for")
    slack = EQUAL * float(np.abs(ends[[0, -1]]).max())
    if wanted.min() < ends[0] - slack or wanted.max() > ends[-1] + slack:
        raise SceneError(
            f"time {wanted.min():g} to {wanted.max():g} s lies outside the trajectory, {ends[0]:g} to {ends[-1]:g} s"
        )
    if len(ends) == 1:
        x, v, a = (np.repeat(part, len(wanted), axis=0) for part in rows[1:])
        return x, v, a
    return motion_at(interpolated_coordinates(plan), _with_departures(rows, departures), wanted)


def _with_departures(rows: Rows, departures: Sequence[Departure]) -> Rows:
    """The rows with a second one at each break: just after it."""
    if not departures:
        return rows
    at = np.array([one.row for one in departures])
    after = [np.array([getattr(one, name) for one in departures]) for name in ("v", "a")]
    t, x = (np.insert(part, at + 1, part[at], axis=0) for part in rows[:2])
    v, a = (np.insert(part, at + 1, new, axis=0) for part, new in zip(rows[2:], after, strict=True))
    return t, x, v, a
