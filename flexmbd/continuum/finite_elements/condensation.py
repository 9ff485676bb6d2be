"""Static condensation: the fields of one cell are solved for in their cell, and what is left is of the shared unknown.

With K the matrix of a cell, u its shared unknowns and a the fields of the cell,

    K_aa a + K_au u = f_a,     (K_uu - K_ua K_aa^-1 K_au) u = f_u - K_ua K_aa^-1 f_a

(Wilson 1974, The static condensation algorithm).  K_aa need not be definite, as that of a stress that is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.contract.cell_fields import CellFields
from flexmbd.round_off import WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]

# Scalings of rows and columns to largest entries of one: each halves the exponents that are left.
_SCALINGS = 12


@dataclass(frozen=True, eq=False)
class CondensedCells:
    """Matrices of k cells, condensed.

    Attributes:
        matrices: (k, n, n) of the shared unknowns.
        inverse: (k, m, m) of K_aa.
        coupling: (k, n, m) K_ua.
        lift: (k, m, n) K_aa^-1 K_au: minus the fields of the cell by unit shared unknowns.
        singular: (k,) cells whose K_aa has no inverse; all that is theirs is no number.
    """

    matrices: FloatArray
    inverse: FloatArray
    coupling: FloatArray
    lift: FloatArray
    singular: NDArray[np.bool_]


def condense(matrices: FloatArray, fields: CellFields) -> CondensedCells:
    """Condense the matrices (k, n + m, n + m) of cells."""
    own, shared = fields.cell_places, fields.shared_places
    inverse, singular = inverted(_part(matrices, own, own))
    coupling = _part(matrices, shared, own)
    lift = inverse @ _part(matrices, own, shared)
    return CondensedCells(_part(matrices, shared, shared) - coupling @ lift, inverse, coupling, lift, singular)


def _part(matrices: FloatArray, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> FloatArray:
    """Blocks of matrices (k, n, n); mostly they stand together, and slices cost less."""
    if all(np.array_equal(places, np.arange(places[0], places[-1] + 1)) for places in (rows, columns)):
        return matrices[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return matrices[:, rows[:, None], columns]


def inverted(matrices: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Inverses of matrices (k, m, m) whose rows are of unlike units; and which of them have none, (k,)."""
    d, scaled = _equilibrated(matrices)
    try:
        found = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        found = np.stack([_inverse(one) for one in scaled])
    norms = [abs(one).sum(axis=2).max(axis=1, initial=0.0) for one in (scaled, found)]
    singular = ~(norms[0] * norms[1] * WORTHLESS_PIVOT < 1.0)
    found[singular] = np.nan
    return d[:, :, None] * found * d[:, None, :], singular


def undetermined(matrix: FloatArray) -> NDArray[np.int64]:
    """Which unknowns a singular matrix (m, m) leaves open: places of the largest entries of its kernel."""
    _, scaled = _equilibrated(matrix[None])
    if not np.isfinite(scaled).all():
        return np.flatnonzero(~np.isfinite(scaled[0]).all(axis=1))
    kernel = abs(np.linalg.svd(scaled[0])[2][-1])
    return np.flatnonzero(kernel > 0.5 * kernel.max())


def _inverse(matrix: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def _equilibrated(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factors of rows and columns (k, m), and the matrices with them, whose rows have a largest entry near one.

    Ruiz 2001, A scaling algorithm to equilibrate both rows and columns norms in matrices.
    """
    d = np.ones(matrices.shape[:2])
    scaled = matrices
    for _ in range(_SCALINGS):
        most = abs(scaled).max(axis=2, initial=0.0)
        if ((0.5 < most) & (most < 2.0)).all():
            break
        d = d / np.sqrt(np.where((most > 0.0) & np.isfinite(most), most, 1.0))
        scaled = d[:, :, None] * matrices * d[:, None, :]
    return d, scaled


def fill_whole(
    whole: fem.Function, fields: CellFields, dofs: NDArray[np.int32], shared: FloatArray, own: FloatArray
) -> None:
    """Set the whole unknown on k cells of this rank.

    Args:
        whole: to be set.
        fields: of it.
        dofs: (k, n + m) of the cells.
        shared: (k, n) values of the shared dofs of each cell.
        own: (k, m) those of the fields of one cell.
    """
    whole.x.array[dofs[:, fields.shared_places]] = shared
    whole.x.array[dofs[:, fields.cell_places]] = own
