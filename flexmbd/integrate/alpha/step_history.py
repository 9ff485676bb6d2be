"""Preparation and end of a step of generalized-alpha: auxiliary accelerations, scales, the history it keeps."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_FAR = 4.0  # times the step before, after one cut short by its end: beyond that its slopes say nothing


@kernel
def prepare_step(plan, work, state, groups, scratch, h):
    """Carry the history to a step of h and set its scales; returns the tolerance of Newton's iteration."""
    rate = state.numbers[st.RATE]
    if h > _FAR * state.numbers[st.STEP_BEFORE]:
        scratch.memory.known_steps[0] = 0
    if scratch.memory.known_steps[0] > 0:
        carry_auxiliary(state, scratch.memory, h)
    else:
        scratch.memory.step_auxiliary[0] = h
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), work.time)
    limit = max(state.numbers[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
    st.set_scales(state, groups, scratch, rate, limit)
    return max(_NEWTON_SHARE * limit, 5e-15)


@kernel
def accept(state, scratch, h):
    """Make the trial state the current one."""
    memory = scratch.memory
    for k in range(state.v.shape[0]):
        memory.earliest[k] = memory.earlier[k]
        memory.earlier[k] = memory.before[k]
        memory.before[k] = state.a[k]
        state.v[k] = scratch.v[k]
        state.a[k] = scratch.a[k]
        memory.auxiliary[k] = scratch.auxiliary[k]
        memory.own_rate[k] = st.own_rate(scratch.own_rate[k], memory.own_rate[k], state.numbers[st.RATE], h)
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x[k]
    for i in range(state.multipliers.shape[0]):
        memory.reactions_earliest[i] = memory.reactions_earlier[i]
        memory.reactions_earlier[i] = memory.reactions_before[i]
        memory.reactions_before[i] = state.multipliers[i]
        state.multipliers[i] = scratch.multipliers[i]
    scratch.memory.step_earlier[0] = state.numbers[st.STEP_BEFORE]
    scratch.memory.known_steps[0] = min(3, scratch.memory.known_steps[0] + 1)


@kernel
def carry_auxiliary(state, memory, h):
    """Give the auxiliary acceleration the instant that it belongs to in a step of another length.

    It lies a share of the step beside the true one, and what it differs from that by is in proportion.  Where steps at
    most double, nothing grows by that in constraint rows or stiff modes, at any rho; slopes of the steps before would.
    Interiors that step along do just this (``Scheme.carry``).
    """
    if h == memory.step_auxiliary[0]:
        return
    share = h / memory.step_auxiliary[0]
    memory.step_auxiliary[0] = h
    for k in range(state.v.shape[0]):
        ahead = memory.auxiliary[k] - state.a[k]
        memory.auxiliary[k] = state.a[k] + share * ahead
