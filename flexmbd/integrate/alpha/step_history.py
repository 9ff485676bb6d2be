"""Preparation and end of a step of generalized-alpha: auxiliary accelerations, scales, the history it keeps."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha import workspace as step
from flexmbd.multibody.kernels.base.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_FAR = 4.0  # times the step before, after one cut short by its end: beyond that its slopes say nothing


@part_of_kernel
def prepare_step(plan, work, state, groups, s, h):
    """Carry the history to a step of h and set its scales; returns the tolerance of Newton's iteration."""
    rate = state.numbers[st.RATE]
    if h > _FAR * state.numbers[st.STEP_BEFORE]:
        state.counts[step.KNOWN_STEPS] = 0
    elif s.interior_stiffness.shape[0] > 0:
        shift_auxiliary(state, h)
    else:
        carry_auxiliary(state, h)
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), work.time)
    limit = max(state.numbers[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
    st.set_scales(state, groups, s, rate, limit)
    return max(_NEWTON_SHARE * limit, 5e-15)


@part_of_kernel
def accept(state, s):
    """Make the trial state the current one."""
    memory = state.memory
    for k in range(state.v.shape[0]):
        memory[step.EARLIEST, k] = memory[step.EARLIER, k]
        memory[step.EARLIER, k] = memory[step.BEFORE, k]
        memory[step.BEFORE, k] = state.a[k]
        state.v[k] = s.v[k]
        state.a[k] = s.a[k]
        memory[step.AUXILIARY, k] = s.auxiliary[k]
        memory[step.OWN_RATE, k] = st.own_rate(s.own_rate[k], memory[step.OWN_RATE, k], state.numbers[st.RATE])
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[k]
    for i in range(state.multipliers.shape[0]):
        memory[step.NU_EARLIEST, i] = memory[step.NU_EARLIER, i]
        memory[step.NU_EARLIER, i] = memory[step.NU_BEFORE, i]
        memory[step.NU_BEFORE, i] = state.multipliers[i]
        state.multipliers[i] = s.multipliers[i]
    state.numbers[step.STEP_EARLIER] = state.numbers[st.STEP_BEFORE]
    state.counts[step.KNOWN_STEPS] = min(3, state.counts[step.KNOWN_STEPS] + 1)


@kernel
def carry_auxiliary(state, h):
    """Give the auxiliary acceleration, after a change of the step size, its steady value.

    On a parabola a(t) the recursion tends to a(t + delay) + offset a'', both of the step; the
    parabola is that through the last true accelerations.  A mere scaling of the old deviation
    would leave an error of the old step's square.
    """
    number = state.numbers
    known = state.counts[step.KNOWN_STEPS]
    if h == number[step.STEP_AUXILIARY] or known == 0:
        return
    number[step.STEP_AUXILIARY] = h
    alpha_m = number[step.ALPHA_M]
    alpha_f = number[step.ALPHA_F]
    share = alpha_m - alpha_f
    delay = share * h
    offset = 0.5 * h * h * (1.0 - alpha_f - (1.0 - alpha_m) * (1.0 + share) ** 2 - alpha_m * share**2)
    h1 = number[st.STEP_BEFORE]
    h2 = number[step.STEP_EARLIER]
    for k in range(state.v.shape[0]):
        slope = (state.a[k] - state.memory[step.BEFORE, k]) / h1
        half_curve = 0.0
        if known > 1:
            half_curve = (slope - (state.memory[step.BEFORE, k] - state.memory[step.EARLIER, k]) / h2) / (h1 + h2)
            slope += half_curve * h1
        state.memory[step.AUXILIARY, k] = (
            state.a[k] + delay * slope + (delay * delay + 2.0 * offset) * half_curve
        )


@kernel
def shift_auxiliary(state, h):
    """``carry_auxiliary`` where interiors step along, which do just this (``Scheme.carry``): with the new instant."""
    h_before = state.numbers[st.STEP_BEFORE]
    if h == h_before or state.counts[step.KNOWN_STEPS] == 0:
        return
    share = (state.numbers[step.ALPHA_M] - state.numbers[step.ALPHA_F]) * (h - h_before) / h_before
    for k in range(state.v.shape[0]):
        state.memory[step.AUXILIARY, k] += share * (state.a[k] - state.memory[step.BEFORE, k])
