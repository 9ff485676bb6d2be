"""Machines whose numbers leave those that doubles hold: one error, whichever factorisation meets them first."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from flexmbd.errors import AssemblyError


@contextmanager
def refuse_overflow(what: str) -> Iterator[None]:
    """Around what solves a machine's equations: overflow, and matrices that round-off leaves singular, are errors.

    Raises:
        AssemblyError: numbers that are not finite, or a factorisation that failed; ``what`` says of what.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            yield
    except (np.linalg.LinAlgError, ValueError) as error:
        if not isinstance(error, np.linalg.LinAlgError) and "infs or NaNs" not in str(error):
            raise
        raise AssemblyError(_SIZES.format(what=what)) from error


def refuse_not_finite(what: str, *values: object) -> None:
    """Raise AssemblyError where any of the arrays holds what is no finite number."""
    if not all(np.isfinite(part).all() for part in values):  # type: ignore[call-overload]
        raise AssemblyError(_SIZES.format(what=what))


_SIZES = (
    "{what} cannot be computed: numbers of the machine are so large, small or unlike that its equations have no "
    "solution in doubles; look at its masses, inertias, stiffnesses, lengths and velocities, and at their units"
)
