"""How wide the patches of a surface are, and within what they are felt by what touches between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Of a patch's widths: within it a patch is felt; the diagonal of a rectangle has to be.
SUPPORT = 1.75


def felt_forms(x: FloatArray, normal: FloatArray, area: FloatArray) -> FloatArray:
    """(p, 3, 3) 1/m^2: forms r . M r < 1 of the places r from the centroids at which patches are felt.

    Args:
        x: (p, 3) m, centroids.
        normal: (p, 3) unit normals.
        area: (p,) m^2.
    """
    forms = np.einsum("p,pa,pb->pab", 1.0 / area, normal, normal)
    for k in range(len(x)):
        plane = np.linalg.svd(normal[k][None])[2][1:]
        forms[k] += plane.T @ _form_beside(_beside(x - x[k], normal[k], plane), area[k]) @ plane
    return forms / SUPPORT**2


def _beside(r: FloatArray, normal: FloatArray, plane: FloatArray) -> FloatArray:
    """(n, 2) m, in the plane and as far as they are: the patches from one, but those above and below it."""
    flat = r @ plane.T
    far, beside = np.linalg.norm(r, axis=1), np.linalg.norm(flat, axis=1)
    near = beside > abs(r @ normal)
    return flat[near] * (far[near] / beside[near])[:, None]


def _form_beside(others: FloatArray, area: float) -> FloatArray:
    """(2, 2) 1/m^2, over the widths of a patch of an area between others at (n, 2) m.

    The others' distances say how slender it is, as far as they surround it: by the second moments of what is nearer to
    it than to them and to their mirror images.  What they leave open is as wide as the area needs.
    """
    from scipy.spatial import ConvexHull  # on need: 0.1 s

    if not len(others):
        return np.asarray(np.eye(2) / area, np.float64)
    open_at = 1e3 * (np.linalg.norm(others, axis=1).max() + area / np.linalg.norm(others, axis=1).min())
    ends = np.concatenate([others, open_at * np.eye(2)])
    # the lines half-way to them are the dual points, and corners of the cell are the edges of their hull
    dual = 2.0 * ends / np.sum(ends**2, axis=1)[:, None]
    edges = ConvexHull(np.concatenate([dual, -dual])).equations
    corners = -edges[:, :2] / edges[:, 2:]
    corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]
    following = np.roll(corners, -1, axis=0)
    twice = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    total = corners + following
    moments = sum(np.einsum("e,ea,eb->ab", twice, one, one) for one in (corners, following, total)) / 24.0
    squares, axes = np.linalg.eigh(12.0 * moments / (0.5 * twice.sum()))
    narrow, wide = np.sqrt(squares)
    if narrow * wide > area:
        narrow = min(narrow, np.sqrt(area))
        wide = area / narrow
    scale = narrow * wide / area
    return (axes / np.array([narrow, wide]) ** 2 * scale) @ axes.T
