"""Numbers of a machine that leave those that doubles hold: one error, whatever meets them first.

Numpy's warnings of them are of no use to anybody: what is computed is looked at instead, and told by its name.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError, SceneError

FloatArray = NDArray[np.float64]

_keeps: ContextVar[bool] = ContextVar("_keeps", default=False)


def looked_at() -> np.errstate:
    """Around arithmetic, or a function as a decorator, whose result is looked at: numpy does not warn."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")


@contextmanager
def refuse_overflow(what: str) -> Iterator[None]:
    """Around what solves a machine's equations: overflow, and matrices that round-off leaves singular, are errors.

    Raises:
        AssemblyError: numbers that are not finite, or a factorisation that failed; ``what`` says of what.
    """
    try:
        with looked_at():
            yield
    except (np.linalg.LinAlgError, ValueError) as error:
        if not isinstance(error, np.linalg.LinAlgError) and "infs or NaNs" not in str(error):
            raise
        raise AssemblyError(_SIZES.format(what=what)) from error


def refuse_not_finite(what: str, *values: object) -> None:
    """Raise AssemblyError where any of the arrays holds what is no finite number."""
    if not all(np.isfinite(part).all() for part in values):  # type: ignore[call-overload]
        raise AssemblyError(_SIZES.format(what=what))


def finite_answer(what: str, t: FloatArray, values: FloatArray) -> FloatArray:
    """Values (nt, ...) at times t (nt,) s that a user asked for.

    Raises:
        SceneError: one is no finite number, though the motion is: a run that diverged, or units that do not fit.
    """
    if _keeps.get() or np.isfinite(values).all():
        return values
    first = float(t[int(np.argmin(np.isfinite(values).reshape(len(t), -1).all(axis=1)))])
    raise SceneError(
        f"{what} is beyond what doubles hold at t = {first:g} s: the run diverged, or masses, lengths and stiffnesses "
        "are in units that do not fit; ask for times before, or look at the configurations, run.x"
    )


@contextmanager
def keep_overflow() -> Iterator[None]:
    """Within this ``finite_answer`` returns what it is given: a run that diverged is saved nevertheless."""
    before = _keeps.set(True)
    try:
        with looked_at():
            yield
    finally:
        _keeps.reset(before)


_SIZES = (
    "{what} cannot be computed: numbers of the machine are so large, small or unlike that its equations have no "
    "solution in doubles; look at its masses, inertias, stiffnesses, lengths and velocities, and at their units"
)
