"""One rule for the signs of modes, and for their rotation where frequencies are equal.

Eigenvectors are determined up to a sign, and those of a multiple eigenvalue up to a rotation.  The
rule: fixed fields w_1, w_2, ... without any symmetry are projected on the modes, p_ij = phi_i^T M w_j,
and inside every cluster of equal eigenvalues the modes are turned so that p is upper triangular with a
positive diagonal.  For a single mode that is p_i1 > 0; the first mode of a cluster is the one most
like w_1.  Neither the mesh's partition nor the eigensolver has a say.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd.continuum.blocks import FloatArray
from flexmbd.continuum.model import ContinuumModel

#: Number of fields, and so the largest cluster whose rotation is determined.
FIELDS = 4

# Relative distance below which neighbouring eigenvalues count as equal. Well above round-off, and
# low enough that a rotation leaves the stiffness diagonal to ten digits.
_EQUAL = 1e-10


def asymmetric_fields(model: ContinuumModel) -> FloatArray:
    """The fields w_j of the rule, smooth and of size one. Collective.

    Returns:
        (owned dofs, FIELDS), m, in the mesh's axes.
    """
    x = model.space.tabulate_dof_coordinates()[: model.n_owned // 3]
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    model.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    model.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    xi = (x - low) / (high - low).max()
    fields = np.empty((len(x), 3, FIELDS))
    number = np.arange(3 * FIELDS).reshape(3, FIELDS) + 1.0
    # fractional parts of multiples of irrational numbers: spread evenly and the same everywhere
    wave = 6.0 * np.modf(np.multiply.outer(np.sqrt([2.0, 3.0, 5.0]), number))[0]
    phase = 2.0 * np.pi * np.modf(np.sqrt(7.0) * number)[0]
    for axis in range(3):
        fields[:, axis] = np.cos(xi @ wave[:, axis] + phase[axis])
    return fields.reshape(-1, FIELDS)


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
