"""The smooth forces of a step of Moreau's and Jean's method, by the workspace of ``step``."""

from __future__ import annotations

import math

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.explicit_machine import accelerate
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.free_spins import to_middle, without_gyration
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.round_off import ROUND_OFF, TEN_DIGITS

EVALUATIONS = 60  # in a step at most: of a damper that takes nearly all of the speed in it


@kernel
def drive_to_end(s, state):
    """Give prescribed coordinates the velocities of the step's end; False where a user's function failed."""
    m = s.machine
    evaluate_times(m.plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), m.work.time)
    if m.plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
        return False
    drive(m.plan, m.work, s.end, s.free, s.a)
    return True


@kernel
def evaluate(s, state, groups, h):
    """Write the velocities at the end without impulses, by forces at ``s.v``; their relative change, -1: failed."""
    if not accelerate(s.machine, state, state.numbers[st.TIME] + 0.5 * h, s.x, s.v, s.a, s.multipliers):
        return -1.0
    without_gyration(s.spins, s.v, s.a)
    change = 0.0
    for k in range(s.v.shape[0]):
        if s.moves[k] == 0:
            continue
        end = s.begin[k] + h * s.a[k]
        size = st.group_speed(groups, groups.of[k], state.numbers[st.RATE]) + abs(end)
        found = abs(end - s.free[k]) / size
        if not found <= change:
            change = found
            state.counts[st.WORST] = k
        s.free[k] = end
    if not math.isfinite(change):
        state.counts[st.OUTCOME] = st.NOT_FINITE
        return -1.0
    return change


@kernel
def halfway(s, end):
    """Write the velocity halfway to that at the end into ``s.v``; prescribed coordinates have theirs."""
    for k in range(s.v.shape[0]):
        if s.moves[k] == 1:
            s.v[k] = 0.5 * (s.begin[k] + end[k])


@kernel
def smooth(s, state, groups, h):
    """Write the velocity at the end without impulses; False where that failed."""
    for k in range(s.v.shape[0]):
        s.begin[k] = state.v[k]
    to_middle(s.spins, h, s.begin)
    for k in range(s.v.shape[0]):
        s.v[k] = s.begin[k]
        s.free[k] = s.begin[k]
    before = math.inf
    for k in range(EVALUATIONS):
        change = evaluate(s, state, groups, h)
        if change < 0.0:
            return False
        halfway(s, s.free)
        s.follows[1] = k > 1 or change > ROUND_OFF
        if change <= ROUND_OFF or (change <= TEN_DIGITS and not change < 0.5 * before):
            return drive_to_end(s, state)
        before = change
    if before <= TEN_DIGITS:
        return drive_to_end(s, state)
    state.counts[st.OUTCOME] = st.NOT_CONVERGED
    return False
