"""How much of joints' fast vibrations is sure to last: what stiffness has come on the way may go again."""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.table import changes, coordinate_law, force_slope, is_coordinate_law


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
        kind = row[at.EL_KIND]
        if not changes(kind):
            continue
        k = row[at.EL_V]
        x_k = x[row[at.EL_X]]
        if is_coordinate_law(kind):
            _, by_x, by_v = coordinate_law(plan, row, x_k, v[k])
        else:
            by_x = force_slope(plan, work, row, x_k, v[k], sizes[group_of[k]])
            by_v = 0.0
        stiffness[i, 0] = abs(by_x)
        stiffness[i, 1] = abs(by_v)
        if abs(by_x) > softest[i, 0]:
            share = min(share, np.sqrt(softest[i, 0] / abs(by_x)))
        if abs(by_v) > softest[i, 1]:
            share = min(share, softest[i, 1] / abs(by_v))
    return share
