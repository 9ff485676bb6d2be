"""How much of a fast vibration of joints is sure to last: what stiffness has come on the way may go again.

An error of a lasting vibration's velocity swings and does not drift, so that implicit methods measure it by the
displacement that it makes.  Where a stop lets go in mid-swing, the velocity's error stays: a vibration against what an
element has stiffened since it was softest is given no such leave.  Vibrations of modes last, and all of
machines with elastic bodies are taken to, for their joints tremble with these.

A contact may always let go, also one that bears from the start.  So of rigid bodies no coordinate that moves a contact
which touches within the step is given leave, and where a method filters its error by its iteration matrix, what the
filter takes away of such a coordinate counts too: the contact's vibration, which the step does not resolve and which
becomes velocity where the contact lets go.  In a step in which a contact sets in or lets go nothing is
filtered.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.changing_stiffness import lasting_share
from flexmbd.multibody.kernels.inverse_dynamics.letting_go import CROSSES, count_touching, mark_held, time_of_touch

_UNSEEN = 2.0  # error over what is tolerated


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
    for k in range(groups.held.shape[0]):
        if groups.held[k] > 0.0:
            own_rates[k] = 0.0


@kernel
def lets_go(groups):
    """Whether there are contacts of rigid bodies, so that steps are to be looked at for what they hold."""
    return groups.held.shape[0] > 0


@kernel
def begin_contacts(plan, work, state, groups):
    """Count which contacts touch at the step's start, for ``count_touching`` at its other instants."""
    for i in range(groups.touched.shape[0]):
        groups.touched[i] = 0.0
    count_touching(plan, work, state.x, state.v, groups.touched, groups.gap_begin)


@kernel
def judge_contacts(plan, work, state, groups, x, v, h):
    """Write which contacts touch at the ends of a step h to (x, v), and which coordinates move them.

    Returns the ratio of a step that touches between its ends and does not know: see ``unseen_touch``.
    """
    begin_contacts(plan, work, state, groups)
    count_touching(plan, work, x, v, groups.touched, groups.gap_end)
    mark_held(plan, groups.touched, 2, groups.held)
    return unseen_touch(plan, time_of_touch(groups.gap_begin, groups.gap_end, h))


@kernel
def unseen_touch(plan, t):
    """The error's ratio, 0 or too large, of a step in which a contact touches after t (s) between two looks at it.

    The next attempt is to end there.
    """
    if t == np.inf:
        return 0.0
    plan.horizon[0] = min(plan.horizon[0], t)
    return _UNSEEN


@kernel
def holds_any(groups):
    """Whether any contact touches within the step."""
    for i in range(groups.touched.shape[0]):
        if groups.touched[i] > 0.0:
            return True
    return False


@kernel
def crosses_any(groups):
    """Whether any contact sets in or lets go within the step."""
    for k in range(groups.held.shape[0]):
        if groups.held[k] == CROSSES:
            return True
    return False


@kernel
def is_crossed(groups, k):
    """Whether coordinate k moves a contact that sets in or lets go within the step."""
    return groups.held.shape[0] > 0 and groups.held[k] == CROSSES
