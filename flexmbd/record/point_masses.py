"""Fictitious point masses with the inertia of a reduced body, for codes that know lumped masses only.

Every inertia integral of a moving flexible body is an entry of its Gram matrix G, the mass integrals of
the 4 + 3 n fields {1, x, y, z, phi_1x, ...}.  A few points with the same Gram matrix therefore have the
same mass, centre, inertia, modal mass and velocity-dependent forces, whatever the body's mesh was.

With f = (x, phi) and its mean c = G_f1 / m, G is [1, c]^T m [1, c] and the central part
C = G_ff - m c c^T.  Let C = L L^T, L of r - 1 columns, and let D (r, r - 1) have orthonormal columns that
sum to zero.  Then the r points f_k = c + sqrt(r / m) L D_k of mass m / r have the mean c, since the
columns of D sum to zero, and the central part L D^T D L^T = C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import RecordError
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

# Eigenvalues of the central part, relative to the fields' sizes: noise below one, no inertia below the other.
_NOISE = 8.0 * float(np.finfo(float).eps)
_NEGATIVE = -1e-9


@dataclass(frozen=True, eq=False)
class PointMasses:
    """Points of equal mass, fixed to no node of the mesh.

    Attributes:
        mass: (r,) kg, all equal and positive; r is the rank of the Gram matrix, at most 4 + 3 n.
        x: (r, 3) m, positions in the undeformed body, from the body frame B, in B.
        phi: (r, 3, n) displacement per unit modal coordinate, in B.
    """

    mass: FloatArray
    x: FloatArray
    phi: FloatArray


def point_masses(body: ReducedBody) -> PointMasses:
    """The fewest equal point masses that have the inertia of a body, to round-off.

    The factor L is lower triangular and the columns of D are cosines, so that a coordinate that is early
    in the list stays close to the body: x no further from the centre than sqrt(2) times the radius of
    gyration along x, and so do y and z where they are not correlated: inside a box along the axes.

    Args:
        body: elastic or rigid (n = 0).

    Raises:
        RecordError: the Gram matrix is not that of a mass distribution.
    """
    n = body.n_modes
    if not body.mass > 0.0:
        raise RecordError(f"the body's mass is {body.mass} kg; point masses need a positive one")
    mean = body.gram[0, 1:] / body.gram[0, 0]
    factor = _factor(body.gram, mean)
    r = factor.shape[1] + 1
    fields = mean + np.sqrt(r / body.mass) * _cosines(r) @ factor.T
    return PointMasses(
        mass=np.full(r, body.mass / r),
        x=fields[:, :3].copy(),
        phi=np.ascontiguousarray(fields[:, 3:].reshape(r, n, 3).swapaxes(1, 2)),
    )


def _factor(gram: FloatArray, mean: FloatArray) -> FloatArray:
    """Lower triangular L with L L^T the central part of the Gram matrix, as many columns as its rank."""
    squares = np.diag(gram)[1:].reshape(-1, 3).sum(axis=1)
    # one scale for the three components of a field: whatever is small beside its own field is noise
    scale = np.repeat(np.sqrt(np.where(squares > 0.0, squares, 1.0)), 3)
    central = (gram[1:, 1:] - gram[0, 0] * np.outer(mean, mean)) / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(central)
    if values[0] < _NEGATIVE:
        raise RecordError(
            f"the Gram matrix is not that of a mass distribution: it has the relative eigenvalue {values[0]:.1e}, "
            "and none may be negative; make the record again"
        )
    kept = values > _NOISE * len(values)
    triangle: FloatArray = np.linalg.qr((vectors[:, kept] * np.sqrt(values[kept])).T)[1]
    # the sign that Cholesky's factor has, so that the points depend on no eigensolver
    signs = np.where(np.diag(triangle) < 0.0, -1.0, 1.0)
    lower: FloatArray = scale[:, None] * triangle.T * signs
    return lower


def _cosines(r: int) -> FloatArray:
    """(r, r - 1) orthonormal columns that sum to zero: the discrete cosines but the constant one."""
    place = (np.arange(r) + 0.5) * np.pi / r
    waves: FloatArray = np.sqrt(2.0 / r) * np.cos(np.outer(place, np.arange(1, r)))
    return waves
