"""How much of a fast vibration of joints is sure to last: what stiffness has come on the way may go again.

An error of a lasting vibration's velocity swings and does not drift, so that implicit methods measure it by the
displacement that it makes.  Where a stop lets go in mid-swing, the velocity's error stays: a vibration against what an
element has stiffened since it was softest is given no such leave.  Vibrations of modes last.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.table import changes, coordinate_law, force_slope, is_coordinate_law


@deferred_kernel(NUMBER)
def _share(plan, work, groups, x, v):
    """The share, 0 to 1, of joints' own rates that is sure to last at (x, v); writes ``groups.stiffness``.

    A rate goes with the root of a stiffness, and with a damper as it is.
    """
    share = 1.0
    for i in range(groups.stiffness.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        if not changes(kind):
            continue
        k = row[at.EL_V]
        x_k = x[row[at.EL_X]]
        if is_coordinate_law(kind):
            _, by_x, by_v = coordinate_law(plan, row, x_k, v[k])
        else:
            by_x = force_slope(plan, work, row, x_k, v[k], groups.full[groups.of[k]])
            by_v = 0.0
        groups.stiffness[i, 0] = abs(by_x)
        groups.stiffness[i, 1] = abs(by_v)
        if abs(by_x) > groups.softest[i, 0]:
            share = min(share, np.sqrt(groups.softest[i, 0] / abs(by_x)))
        if abs(by_v) > groups.softest[i, 1]:
            share = min(share, groups.softest[i, 1] / abs(by_v))
    return share


@kernel
def judge_lasting(plan, work, state, groups, x, v):
    """Write STEP_LASTING, of a step that ends at (x, v)."""
    if groups.stiffness.shape[0] == 0:
        return
    share = _share(plan, work, groups, x, v)
    state.numbers[st.LASTING_AT_END] = share
    state.numbers[st.STEP_LASTING] = min(share, state.numbers[st.LASTING], state.numbers[st.LASTING_BEFORE])


@kernel
def forget_passing(plan, state, groups, own_rates):
    """Keep of joints' own rates (nv,) what lasts, for the steps after: a contact's rate is none of free flight."""
    if groups.stiffness.shape[0] > 0:
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            if groups.kind[groups.of[k]] != kinds.GROUP_MODAL:
                own_rates[k] *= state.numbers[st.STEP_LASTING]
