"""Control points of triangles that are curved so that they meet in one tangent plane along their edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.contact.facets import BoolArray, Facets
from flexmbd.round_off import SQUARED

FloatArray = NDArray[np.float64]

_LEANS = 0.5  # the least cosine between an edge and its tangent, else it is no edge of a smooth crease, and straight


def corner_normals(facets: Facets, sharp: BoolArray) -> FloatArray:
    """Unit normals (t, 3, 3) at the corners of triangles.

    Around a point those triangles share one that follow each other across edges which are not ``sharp``.
    """
    from scipy.sparse import coo_array  # on need: few scenes have surfaces
    from scipy.sparse.csgraph import connected_components

    t, k = np.nonzero(~sharp)
    other, edge = np.divmod(facets.across[t, k], 3)
    here = np.concatenate([3 * t + k, 3 * t + (k + 1) % 3])
    there = np.concatenate([3 * other + (edge + 1) % 3, 3 * other + edge])
    size = facets.rows.size
    graph = coo_array((np.ones(len(here)), (here, there)), shape=(size, size)).tocsr()
    group = connected_components(graph, directed=False)[1].astype(np.int64)
    sums = np.zeros((size, 3))
    np.add.at(sums, group, (facets.angles[..., None] * facets.normals[:, None]).reshape(-1, 3))
    sums = sums[group]
    return np.asarray((sums / np.linalg.norm(sums, axis=1)[:, None]).reshape(-1, 3, 3))


def control_points(facets: Facets, sharp: BoolArray, normals: FloatArray) -> FloatArray:
    """Control points (t, 19, 3) m of quartic patches (``kernels.contact.gregory_patch``) by normals at corners.

    Each is seen from the first corner of its triangle.
    """
    legs = np.stack([_edge(facets, sharp, normals, k) for k in range(3)], axis=1)  # (t, edge, 3, 3) of cubics
    x = facets.arms
    quartic = np.empty((len(x), 3, 5, 3))  # the edges by degree elevation
    cubic = np.concatenate([x[:, :, None], x[:, :, None] + np.cumsum(legs, axis=2)], axis=2)
    cubic[:, :, 3] = np.roll(x, -1, axis=1)
    quartic[:, :, 0], quartic[:, :, 4] = cubic[:, :, 0], cubic[:, :, 3]
    for j in range(1, 4):
        quartic[:, :, j] = 0.25 * (j * cubic[:, :, j - 1] + (4 - j) * cubic[:, :, j])
    first, last = np.empty_like(x), np.empty_like(x)
    for k in range(3):
        before, after = (k + 2) % 3, (k + 1) % 3
        first[:, k], last[:, k] = _inner(
            legs[:, k], quartic[:, k], normals[:, k], normals[:, after], quartic[:, before, 3], quartic[:, after, 1]
        )
    within = np.stack([one for k in range(3) for one in (first[:, k], last[:, (k + 2) % 3])], axis=1)
    return np.concatenate([quartic[:, :, :4].reshape(-1, 12, 3), x[:, :1], within], axis=1)


def _edge(facets: Facets, sharp: BoolArray, normals: FloatArray, k: int) -> FloatArray:
    """(t, 3, 3) m the legs of the control polygon of edge k, a cubic.

    It leaves each end along the chord as projected into the tangent plane, of a sharp edge along the line in which the
    two tangent planes meet; its outer legs are of the length at which it is next to a circle (Goldapp 1991).
    """
    after = (k + 1) % 3
    chord = facets.arms[:, after] - facets.arms[:, k]
    length = np.linalg.norm(chord, axis=1)[:, None]
    along = chord / length
    across = facets.across[:, k]
    there = across >= 0
    other, edge = np.divmod(np.maximum(across, 0), 3)
    tangents = []
    for mine, its in ((normals[:, k], normals[other, (edge + 1) % 3]), (normals[:, after], normals[other, edge])):
        flat = _unit(along - np.einsum("ti,ti->t", along, mine)[:, None] * mine)
        line = np.cross(mine, its)
        sine = np.linalg.norm(line, axis=1)
        meets = sharp[:, k] & there & (sine > SQUARED)
        line = line / np.where(meets, sine, 1.0)[:, None]
        line *= np.sign(np.einsum("ti,ti->t", line, along))[:, None]
        tangents.append(np.where(meets[:, None], line, flat))
    leans = np.min([np.einsum("ti,ti->t", one, along) for one in tangents], axis=0) < _LEANS
    begin, end = (np.where(leans[:, None], along, one) for one in tangents)
    cosine = np.einsum("ti,ti->t", begin, end)[:, None]
    half = np.sqrt(0.5 * (1.0 + np.clip(cosine, -1.0, 1.0)))  # cosine of half the angle between the tangents
    leg = length / (1.5 * (1.0 + half))
    return np.stack([leg * begin, chord - leg * (begin + end), leg * end], axis=1)


def _inner(
    legs: FloatArray, quartic: FloatArray, begins: FloatArray, ends: FloatArray, before: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The two control points (t, 3 each) within, by which the patch keeps to the tangent planes along an edge.

    Across the edge c the patch goes as k(t) A(t) + h(t) c'(t) / 3, with k, h and A linear, A from normal x tangent at
    one end to that at the other (Chiyokura & Kimura 1983).  ``before`` and ``after``: of the other two edges the
    control points next to this one's ends.
    """
    sides = np.cross(begins, legs[:, 0]), np.cross(ends, legs[:, 2])
    cross = [_unit(np.asarray(side, dtype=np.float64)) for side in sides]
    goes = before - quartic[:, 0], after - quartic[:, 3]
    k = [np.einsum("ti,ti->t", one, other)[:, None] for one, other in zip(goes, cross, strict=True)]
    h = [_share(goes[0], legs[:, 0]), _share(goes[1], legs[:, 2])]
    middle = k[0] * cross[1] + k[1] * cross[0]
    first = k[0] * cross[0] + middle + 2.0 * h[0] * legs[:, 1] + h[1] * legs[:, 0]
    last = k[1] * cross[1] + middle + 2.0 * h[1] * legs[:, 1] + h[0] * legs[:, 2]
    return quartic[:, 1] + first / 3.0, quartic[:, 2] + last / 3.0


def _share(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((np.einsum("ti,ti->t", a, b) / np.einsum("ti,ti->t", b, b))[:, None])


def _unit(a: FloatArray) -> FloatArray:
    return np.asarray(a / np.linalg.norm(a, axis=1)[:, None])
