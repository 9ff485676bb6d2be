"""How the stiffness of elements changes on the way: what it makes of vibrations, and of old iteration matrices."""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.table import changes, coordinate_law, force_slope, is_coordinate_law


@kernel
def _stiffness(plan, work, row, x, v, size):
    """Magnitudes of the derivatives of an element's force by its coordinate, of the given size, and by that's rate."""
    if is_coordinate_law(row[at.EL_KIND]):
        _, by_x, by_v = coordinate_law(plan, row, x[row[at.EL_X]], v[row[at.EL_V]])
        return abs(by_x), abs(by_v)
    return abs(force_slope(plan, work, row, x, v, size)), 0.0


@deferred_kernel()
def take_stiffness(plan, work, sizes, x, v, stiffness):
    """Fill (ne, 2) with the stiffness and damping at (x, v) of all elements that change; ``sizes``: (nv,), rad or m."""
    for i in range(stiffness.shape[0]):
        row = plan.elements[i]
        if changes(row[at.EL_KIND]):
            stiffness[i, 0], stiffness[i, 1] = _stiffness(plan, work, row, x, v, sizes[row[at.EL_V]])


@deferred_kernel(NUMBER)
def stiffness_change(plan, work, sizes, x, v, stiffness):
    """The largest change of an element's stiffness or damping since ``take_stiffness``, as a share of what it was."""
    largest = 0.0
    for i in range(stiffness.shape[0]):
        row = plan.elements[i]
        if not changes(row[at.EL_KIND]):
            continue
        now = _stiffness(plan, work, row, x, v, sizes[row[at.EL_V]])
        for c in range(2):
            change = abs(now[c] - stiffness[i, c])
            if change > 0.0:
                largest = max(largest, change / stiffness[i, c] if stiffness[i, c] > 0.0 else np.inf)
    return largest


@deferred_kernel(NUMBER)
def lasting_share(plan, work, group_of, sizes, x, v, stiffness, softest):
    """The share, 0 to 1, of joints' own rates that is sure to last at (x, v).

    ``softest``: (ne, 2) the smallest magnitudes so far of each element's derivatives by its coordinate and by that's
    rate; those of now go into ``stiffness``.  ``group_of``, ``sizes``: each coordinate's group (nv,), and of each
    group the size (rad or m).  A rate goes with the root of a stiffness, and with a damper as it is.
    """
    share = 1.0
    for i in range(stiffness.shape[0]):
        row = plan.elements[i]
        if not changes(row[at.EL_KIND]):
            continue
        by_x, by_v = _stiffness(plan, work, row, x, v, sizes[group_of[row[at.EL_V]]])
        stiffness[i, 0] = by_x
        stiffness[i, 1] = by_v
        if by_x > softest[i, 0]:
            share = min(share, np.sqrt(softest[i, 0] / by_x))
        if by_v > softest[i, 1]:
            share = min(share, softest[i, 1] / by_v)
    return share
