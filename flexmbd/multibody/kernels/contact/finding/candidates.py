"""Points of a pair as they are found, each place once, and those that are kept."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.shape_table import FEATURE_BITS, ID_BITS, MOST_POINTS

_GAP = 9


@kernel
def feature(kind, one, other):
    """The number of the features that touch."""
    return (kind << 2 * FEATURE_BITS) | (one << FEATURE_BITS) | other


@kernel
def add_point(work, found, on_a, on_b, normal, gap, name, same):
    """Add a point; how many there are.

    Points of one name, or within ``same`` (m) on a, are one: it has the name of the first and the place of the deepest.
    Those beyond the room, which is for all that can be, are left out.
    """
    at = found
    for k in range(found):
        off = sub3(load3(work.candidates[k], 0), on_a)
        if work.features[k] == name or dot3(off, off) <= same * same:
            if gap >= work.candidates[k, _GAP]:
                return found
            at = k
            break
    if at == work.candidates.shape[0]:
        return found
    row = work.candidates[at]
    store3(row, 0, on_a)
    store3(row, 3, on_b)
    store3(row, 6, normal)
    row[_GAP] = gap
    if at < found:
        return found
    work.features[at] = name
    return found + 1


@kernel
def _swap(work, i, j):
    for c in range(10):
        work.candidates[i, c], work.candidates[j, c] = work.candidates[j, c], work.candidates[i, c]
    work.features[i], work.features[j] = work.features[j], work.features[i]


@kernel
def _thin_out(work, found):
    """Bring the deepest point to the front, then each time the one that is farthest from those before it.

    Less far counts what is higher above the deepest, by twice its height: an upper rim does not displace the lower.
    """
    deepest = 0
    for k in range(1, found):
        if work.candidates[k, _GAP] < work.candidates[deepest, _GAP]:
            deepest = k
    _swap(work, 0, deepest)
    for kept in range(1, MOST_POINTS):
        best, farthest = -math.inf, kept
        for k in range(kept, found):
            nearest = math.inf
            for i in range(kept):
                off = sub3(load3(work.candidates[k], 0), load3(work.candidates[i], 0))
                nearest = min(nearest, math.sqrt(dot3(off, off)))
            nearest -= 2.0 * (work.candidates[k, _GAP] - work.candidates[0, _GAP])
            if nearest > best:
                best, farthest = nearest, k
        _swap(work, kept, farthest)
    return MOST_POINTS


@kernel
def keep_points(table, work, out, a, b, found, count):
    """Write the points of a pair after ``count`` others, as far as there is room; how many there are then."""
    if found > MOST_POINTS:
        found = _thin_out(work, found)
    law = table.law[table.group[a], table.group[b]]
    for k in range(found):
        if count < out.gap.shape[0]:
            row = work.candidates[k]
            out.shapes[count, 0], out.shapes[count, 1] = a, b
            out.bodies[count, 0], out.bodies[count, 1] = table.body[a], table.body[b]
            store3(out.position_a[count], 0, load3(row, 0))
            store3(out.position_b[count], 0, load3(row, 3))
            store3(out.normal[count], 0, load3(row, 6))
            out.gap[count] = row[_GAP]
            out.id[count] = ((a * table.body.shape[0] + b) << ID_BITS) | work.features[k]
            out.law[count] = law
        count += 1
    return count


@kernel
def between(on_a, on_b, core_gap, radius_a, radius_b, normal):
    """The points of the surfaces about two core points that are ``core_gap`` apart along the normal, and their gap."""
    return (
        sub3(on_a, scale3(radius_a, normal)),
        sub3(on_b, scale3(-radius_b, normal)),
        core_gap - radius_a - radius_b,
    )
