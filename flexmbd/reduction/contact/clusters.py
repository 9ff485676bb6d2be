"""Facets of a surface in clusters of like area, by recursive bisection of their centres.

The surface is cut across the axis of the mesh along which it is widest, between two rows of facets where there are
such, and so is each part of it. So the clusters depend on where the facets are, and neither on their numbers nor on
the ranks; facets in one place along an axis stay together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# By how much more slender than squares clusters may be so that all of them are in strips.
_SLENDER = 1.5


def clusters(x: FloatArray, area: FloatArray, *, count: int) -> IntArray:
    """The cluster, 0 to count - 1, of each facet.

    Args:
        x: (f, 3) m, centres of the facets.
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
        low = _number_before(np.sort(np.ptp(x[which], axis=0)), number)
        before = _before(x[which], area[which], low=low, high=number - low)
        parts += [(which[before], first, low), (which[~before], first + low, number - low)]
    return found


def _number_before(widths: FloatArray, count: int) -> int:
    """How many of the clusters of a part come before its cut: as many as are in whole strips of square clusters.

    Args:
        widths: (3,) of the part, ascending.
        count: 2 or more.
    """
    strips = np.sqrt(count * widths[2] / widths[1]) if widths[1] > 0.0 else float(count)
    divisors = [k for k in range(2, count + 1) if count % k == 0]
    best = min(divisors, key=lambda k: (round(abs(np.log(k / strips)) / SAME_PLACE), k))
    if abs(np.log(best / strips)) > np.log(_SLENDER):
        return count // 2
    return best // 2 * (count // best)


def _before(x: FloatArray, area: FloatArray, *, low: int, high: int) -> NDArray[np.bool_]:
    """(f,) which facets come before a cut that gives each side its share, and a facet at least for each cluster."""
    rows = _rows(x)
    widths = np.ptp(x, axis=0)
    # of two that are equally wide but for round-off the first
    axes = sorted(range(3), key=lambda axis: (-round(widths[axis] / (SAME_PLACE * widths.max() or 1.0)), axis))
    order: IntArray = np.arange(len(x))
    ends: IntArray = order[:0]
    for axis in axes:
        order = np.argsort(rows[:, axis], kind="stable")
        ends = np.flatnonzero(np.diff(rows[order, axis])) + 1
        ends = ends[(ends >= low) & (ends <= len(x) - high)]
        if len(ends):
            break
    else:  # fewer rows than clusters: through a row, along the next axis
        order = np.lexsort(rows[:, axes[::-1]].T)
        ends = np.arange(low, len(x) - high + 1)
    share = np.cumsum(area[order])[ends - 1] / area.sum()
    cut = ends[np.round(abs(share - low / (low + high)) / SAME_PLACE).argmin()]
    before = np.zeros(len(x), dtype=bool)
    before[order[:cut]] = True
    return before


def _rows(x: FloatArray) -> IntArray:
    """(f, 3) number of the place of each centre along each axis; those that round-off keeps apart have one."""
    rows = np.empty(x.shape, dtype=np.int64)
    extent = np.ptp(x, axis=0).max()
    for axis in range(3):
        order = np.argsort(x[:, axis])
        steps = np.diff(x[order, axis]) > SAME_PLACE * extent
        rows[order, axis] = np.concatenate([[0], np.cumsum(steps)])
    return rows
