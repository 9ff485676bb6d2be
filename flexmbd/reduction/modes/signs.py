"""One rule for the signs of modes, and for their rotation where frequencies are equal.

Eigenvectors are determined up to a sign, and those of a multiple eigenvalue up to a rotation.  The
rule: fixed fields w_1, w_2, ... without any symmetry are projected on the modes, p_ij = phi_i^T M w_j,
and inside every cluster of equal eigenvalues the modes are turned so that p is upper triangular with a
positive diagonal.  For a single mode that is p_i1 > 0; the first mode of a cluster is the one most
like w_1.  Neither the mesh's partition nor the eigensolver has a say.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray

#: Number of fields, and so the largest cluster whose rotation is determined.
FIELDS = 8

# Relative distance below which neighbouring eigenvalues count as equal. Well above round-off, and
# low enough that a rotation leaves the stiffness diagonal to ten digits.
_EQUAL = 1e-10


def asymmetric_fields(model: LinearModel) -> FloatArray:
    """The fields w_j of the rule, smooth and of size one. Collective.

    Rotations and other unknowns have theirs too, since some modes move nothing else: a straight beam
    twists without a displacement of its axis.

    Returns:
        (owned dofs, FIELDS), displacements in m, in the mesh's axes.
    """
    layout = model.layout
    x = layout.node_x[: layout.n_owned_nodes]
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    model.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    model.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    extent = (high - low).max()
    fields: FloatArray = np.zeros((layout.n_local, FIELDS), order="F")
    for part in layout.fields:
        components = range(part.components.start, part.components.stop)
        function = fem.Function(part.space)
        for j in range(FIELDS):
            function.interpolate(partial(_waves, components, j, low, extent))
            fields[part.dofs, j] = function.x.array
    return np.asfortranarray(fields[: layout.n_owned])


def _waves(
    components: Sequence[int], j: int, low: FloatArray, extent: float, x: FloatArray
) -> FloatArray:
    """Components of the field w_j at points (3, k): a row each; a single one without its axis."""
    rows: FloatArray = np.empty((len(components), x.shape[1]))
    for row, c in zip(rows, components, strict=True):
        number = 12 * (j // 4) + 4 * (c % 3) + j % 4 + 24 * (c // 3) + 1
        # fractional parts of multiples of irrational numbers: spread evenly and the same everywhere
        wave = 6.0 * (1 + j // 4) * np.modf(np.sqrt([2.0, 3.0, 5.0]) * number)[0]
        phase = 2.0 * np.pi * np.modf(np.sqrt(7.0) * number)[0]
        row[:] = np.cos(wave @ (x - low[:, None]) / extent + phase)
        if c >= 3:
            # rotations, by which points at the body's end move by one
            row /= extent
    return rows if len(components) > 1 else rows[0]


def determined_rotation(eigenvalues: FloatArray, projections: FloatArray) -> FloatArray:
    """The orthogonal matrix that turns modes as the rule says.

    Args:
        eigenvalues: (n,) ascending.
        projections: (n, FIELDS), p_ij = phi_i^T M w_j.

    Returns:
        (n, n) block diagonal Q; the modes phi Q, with projections Q^T p, follow the rule.
    """
    n = len(eigenvalues)
    rotation = np.zeros((n, n))
    ends = np.flatnonzero(np.diff(eigenvalues) > _EQUAL * eigenvalues[1:]) + 1
    for cluster in np.split(np.arange(n), ends):
        q, r = np.linalg.qr(projections[cluster], mode="complete")
        signs = np.ones(len(cluster))
        diagonal = np.diag(r)
        signs[: len(diagonal)] = np.where(diagonal < 0.0, -1.0, 1.0)
        rotation[np.ix_(cluster, cluster)] = q * signs
    return rotation
