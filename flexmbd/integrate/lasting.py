"""How much of a fast vibration of joints is sure to last: what stiffness has come on the way may go again.

An error of a lasting vibration's velocity swings and does not drift, so that implicit methods measure it by the
displacement that it makes.  Where a stop lets go in mid-swing, the velocity's error stays: a vibration against what an
element has stiffened since it was softest is given no such leave.  Vibrations of modes last, and all of
machines with elastic bodies are taken to, for their joints tremble with these.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.changing_stiffness import lasting_share


@kernel
def judge_lasting(plan, work, state, groups, x, v):
    """Write STEP_LASTING, of a step that ends at (x, v)."""
    if groups.stiffness.shape[0] == 0:
        return
    share = lasting_share(plan, work, groups.of, groups.full, x, v, groups.stiffness, groups.softest)
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
