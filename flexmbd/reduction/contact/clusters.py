"""Facets of a surface in clusters of like area, by recursive bisection of their places.

The surface falls into sides, between which there are edges. Each is cut across the axis of the mesh along which it is
widest, between two rows of facets where there are such, and so is each part of it. How far the normals turn counts as
a width as well, so that what lies back to back is parted. The clusters depend on where the facets are, and neither on
their numbers nor on the ranks.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# By how much more slender than squares clusters may be so that all of them are in strips.
_SLENDER = 1.5
# Of a cluster's area: what a cut may take from it so that clusters lie in strips.
_FITS = 0.1


# The cosine of the angle between the normals of neighbours from which on there is an edge between them.
_EDGE = 0.5


def sides(corners: IntArray, normal: FloatArray, x: FloatArray) -> list[IntArray]:
    """Which facets are on each side of a surface; across its edges the normal turns by 60 degrees or more.

    Args:
        corners: (f, 3 or 4) their nodes, one after the other around a facet.
        normal: (f, 3) unit normals.
        x: (f, 3) m, centres, by which the sides are ordered.
    """
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    facet = np.repeat(np.arange(len(corners)), corners.shape[1])
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    one, other = facet[order[:-1]][same], facet[order[1:]][same]
    smooth = np.einsum("fi,fi->f", normal[one], normal[other]) > _EDGE
    pairs = (np.ones(int(smooth.sum())), (one[smooth], other[smooth]))
    number, side = scipy.sparse.csgraph.connected_components(scipy.sparse.coo_array(pairs, shape=(len(x), len(x))))
    found = [np.flatnonzero(side == i) for i in range(number)]
    rows = _rows(np.array([x[which].mean(axis=0) for which in found]))
    return [found[i] for i in np.lexsort(rows.T[::-1])]


def clusters(x: FloatArray, area: FloatArray, *, count: int) -> IntArray:
    """The cluster, 0 to count - 1, of each facet.

    Args:
        x: (f, d) m, centres of the facets, and what else keeps them apart.
        area: (f,) m^2.
        count: of the clusters, no more than facets.
    """
    found = np.zeros(len(x), dtype=np.int64)
    parts: list[tuple[IntArray, int, int]] = [(np.arange(len(x)), 0, count)]
    while parts:
        which, first, number = parts.pop()
        if number == 1:
            found[which] = first
            continue
        before, low = _cut(x[which], area[which], count=number)
        parts += [(which[before], first, low), (which[~before], first + low, number - low)]
    return found


def _cut(x: FloatArray, area: FloatArray, *, count: int) -> tuple[NDArray[np.bool_], int]:
    """(f,) which facets come before a cut, and how many of the clusters; a facet at least for each."""
    rows, widths = _rows(x), np.ptp(x, axis=0)
    wanted = _number_before(np.sort(widths)[-2:], count)
    # of two that are equally wide but for round-off the first
    axes = sorted(range(x.shape[1]), key=lambda axis: (-round(widths[axis] / (SAME_PLACE * widths.max() or 1.0)), axis))
    for axis in axes:
        order = np.argsort(rows[:, axis], kind="stable")
        cut = _best_cut(np.flatnonzero(np.diff(rows[order, axis])) + 1, area[order], count=count, wanted=wanted)
        if cut is not None:
            break
    else:  # fewer rows than clusters: through a row, along the next axis
        order = np.lexsort(rows[:, axes[::-1]].T)
        cut = _best_cut(np.arange(1, len(x)), area[order], count=count, wanted=wanted)
        assert cut is not None  # noqa: S101  (there are as many facets as clusters)
    before = np.zeros(len(x), dtype=bool)
    before[order[: cut[0]]] = True
    return before, cut[1]


def _best_cut(ends: IntArray, area: FloatArray, *, count: int, wanted: int) -> tuple[int, int] | None:
    """The end after which to cut, and the number of clusters before it; None where each has too few facets.

    That of the clusters whose share fits the area best, of some that fit the wanted one, else that next to half.
    """
    share = count * np.cumsum(area)[ends - 1] / area.sum()
    low = np.concatenate([np.full(len(ends), wanted), np.clip(np.rint(share), 1, count - 1).astype(np.int64)])
    ends, share = np.tile(ends, 2), np.tile(share, 2)
    there = (ends >= low) & (len(area) - ends >= count - low)
    if not there.any():
        return None
    ends, share, low = ends[there], share[there], low[there]
    lacking = np.round(np.maximum(abs(share - low) - _FITS, 0.0) / SAME_PLACE)
    best = np.lexsort([np.round(abs(share - low) / SAME_PLACE), abs(2 * low - count), low != wanted, lacking])[0]
    return int(ends[best]), int(low[best])


def _number_before(widths: FloatArray, count: int) -> int:
    """How many of the clusters are best before a cut: as many as are in whole strips of square clusters.

    Args:
        widths: (2,) of the part, the second largest and the largest.
        count: 2 or more.
    """
    strips = np.sqrt(count * widths[1] / widths[0]) if widths[0] > 0.0 else float(count)
    divisors = [k for k in range(2, count + 1) if count % k == 0]
    best = min(divisors, key=lambda k: (round(abs(np.log(k / strips)) / SAME_PLACE), k))
    if abs(np.log(best / strips)) > np.log(_SLENDER):
        return count // 2
    return best // 2 * (count // best)


def _rows(x: FloatArray) -> IntArray:
    """(f, d) number of the place of each centre along each axis; those that round-off keeps apart have one."""
    rows = np.empty(x.shape, dtype=np.int64)
    extent = np.ptp(x, axis=0).max()
    for axis in range(x.shape[1]):
        order = np.argsort(x[:, axis])
        steps = np.diff(x[order, axis]) > SAME_PLACE * extent
        rows[order, axis] = np.concatenate([[0], np.cumsum(steps)])
    return rows
