"""Normal form of a reduced basis: M_qq = 1 and K_qq diagonal, by an exact change of basis."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError


def normal_form(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Diagonalise stiffness and mass together.

    Args:
        stiffness: (n, n) symmetric positive definite.
        mass: (n, n) symmetric positive definite.

    Returns:
        Eigenvalues (n,), ascending, and X (n, n) with X^T mass X = 1 and X^T stiffness X diagonal.

    Raises:
        ReductionError: the stiffness is not positive definite.
    """
    scale = 1.0 / np.sqrt(np.diag(stiffness))
    grid = np.outer(scale, scale)
    # mass by stiffness, not the other way round: the error then sits in the mass of the highest
    # modes, and low frequencies and static responses are exact to the last digits
    try:
        _, x = scipy.linalg.eigh(mass * grid, stiffness * grid)
    except np.linalg.LinAlgError as error:
        raise ReductionError(
            "the reduced stiffness is not positive definite: the basis is linearly dependent, or a "
            "part of the body is connected to no interface"
        ) from error
    x = scale[:, None] * x[:, ::-1]
    x /= np.sqrt(np.einsum("ij,ij->j", x, mass @ x))
    return np.einsum("ij,ij->j", x, stiffness @ x), x
