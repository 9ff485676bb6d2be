"""Modes of another program brought to normal form: unit mass, diagonal stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray
from flexmbd.round_off import TEN_DIGITS, WORTHLESS_PIVOT


def normal_modes(path: str | Path, stiffness: FloatArray, *, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues and eigenvectors of reduced matrices; what is in normal form already stays to the bit.

    Args:
        path: the file they are of, for messages.
        stiffness: (n, n) symmetric.
        mass: (n, n) symmetric.

    Returns:
        Diagonal stiffness (n,), ascending, and the basis (n, n) that leads to it.

    Raises:
        ExportError: one of the two is not positive definite.
    """
    import scipy.linalg

    n = len(stiffness)
    diagonal = np.diag(stiffness)
    if (
        np.abs(mass - np.eye(n)).max() < TEN_DIGITS
        and np.array_equal(stiffness, np.diag(diagonal))
        and (np.diff(diagonal) >= 0.0).all()
        and diagonal[0] > 0.0
    ):
        return diagonal.copy(), np.eye(n)
    try:
        values, basis = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
    except np.linalg.LinAlgError as error:
        raise ExportError(
            f"{path}: the reduced mass is not positive definite: its modes depend on each other"
        ) from error
    if not values[0] > WORTHLESS_PIVOT * values[-1]:
        raise ExportError(
            f"{path}: the reduced stiffness is not positive definite: among its modes are rigid motions, which the "
            "frame of the body has already; leave them out"
        )
    return values, basis * np.where(basis.sum(axis=0) < 0.0, -1.0, 1.0)
