"""Places on facets that are nearest to points, and how places go with the nodes of the facets before them.

All by the places of the nodes alone, of complex numbers too: their imaginary part is the derivative (Squire & Trapp
1998, doi:10.1137/S003614459631241X).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
#: Of real numbers, or of complex ones.
Digits = NDArray[Any]


def nearest_places(x: Digits, corners: Digits, off: NDArray[np.bool_]) -> tuple[Digits, Digits, Digits]:
    """Depths (n,) m of points behind triangles, normals (n, 3), and shares (n, 3) of the corners in the places.

    Args:
        x: (n, 3) m, the points; behind edges and corners where places are on these.
        corners: (n, 3, 3) m.
        off: (n, 3) corners that the place does not hang on, as of `NearFacets`.
    """
    share, normal, depth = _in_planes(x, corners)
    count = off.sum(axis=1)
    some = np.flatnonzero(count > 0)
    if len(some):
        share[some] = 0.0
        edge, corner = np.flatnonzero(count == 1), np.flatnonzero(count == 2)
        k = off[edge].argmax(axis=1)
        i, j = (k + 1) % 3, (k + 2) % 3
        along = corners[edge, j] - corners[edge, i]
        share[edge, j] = _dot(x[edge] - corners[edge, i], along) / _dot(along, along)
        share[edge, i] = 1.0 - share[edge, j]
        share[corner, (~off[corner]).argmax(axis=1)] = 1.0
        away = np.einsum("nk,nka->na", share[some], corners[some]) - x[some]
        depth[some] = np.sqrt(_dot(away, away))
        normal[some] = away / depth[some, None]
    return depth, normal, share


def _in_planes(x: Digits, corners: Digits) -> tuple[Digits, Digits, Digits]:
    one, two, arm = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], x - corners[:, 0]
    area = np.cross(one, two)
    square = _dot(area, area)
    second, third = _dot(np.cross(arm, two), area) / square, _dot(np.cross(one, arm), area) / square
    normal = area / np.sqrt(square)[:, None]
    return np.stack([1.0 - second - third, second, third], axis=1), normal, -_dot(arm, normal)


def carried_places(weights: Digits, points: Digits, corners: Digits, mass: FloatArray) -> Digits:
    """(n, k, 3, 3) by how much of their facets' nodes' displacements the places go with these where points are.

    A facet carries what is behind it by the mean rotation of its nodes, so that a force there has its moment.

    Args:
        weights: (n, k) of the nodes in the places on the facets.
        points: (n, 3) m.
        corners: (n, w, 3) m, of the facets' first w <= k nodes; the others are among them, without weight.
        mass: (n, w) of these in the mean.
    """
    width = corners.shape[1]
    centre = np.einsum("nk,nka->na", mass, corners) / mass.sum(axis=1)[:, None]
    arms = corners - centre[:, None]
    behind = points - np.einsum("nk,nka->na", weights[:, :width], corners)
    square = np.einsum("nk,nka,nka->n", mass, arms, arms)[:, None, None]
    inertia = square * np.eye(3) - np.einsum("nk,nka,nkb->nab", mass, arms, arms)
    # J^-1 sum of m r x du moves what is behind
    turn = np.linalg.solve(inertia[:, None], mass[:, :, None, None] * _products(arms))
    carry = weights[:, :, None, None] * np.eye(3)
    carry[:, :width] -= _products(behind)[:, None] @ turn
    return np.asarray(carry)


def _products(vectors: Digits) -> Digits:
    """(..., 3, 3) matrices of the products of vectors (..., 3) with others."""
    return np.asarray(np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2))


def _dot(a: Digits, b: Digits) -> Digits:
    return np.asarray(np.einsum("na,na->n", a, b))
