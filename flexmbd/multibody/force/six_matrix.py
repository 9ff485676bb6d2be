"""A 6 x 6 matrix of a force element, as the user gives it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.multibody.force.protocol import vector
from flexmbd.round_off import EQUAL


def semidefinite_matrix(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """(6, 6) of a diagonal (6,) or of a symmetric, positive semidefinite matrix.

    Raises:
        SceneError: it is none; ``what`` names it.
    """
    given = numbers(value)
    matrix = vector(np.diag(given) if given.shape == (6,) else given, (6, 6), what)
    largest = np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > EQUAL * largest:
        raise SceneError(f"{what} must be symmetric")
    # in units in which the diagonal is one: translations and rotations have unlike ones
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale[scale == 0.0] = 1.0
    if np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] < -EQUAL:
        raise SceneError(f"{what} has a negative eigenvalue; none may be negative")
    return matrix
