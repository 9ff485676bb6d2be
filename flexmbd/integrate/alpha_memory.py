"""What generalized-alpha does before and after a step is solved for: its size, its scales, what it remembers."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import alpha_layout as step
from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.time_functions import evaluate_times

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_LONGEST = 0.5  # the longest step in characteristic times of the machine
_HOLD = 8  # steps without growth after a rejection

# What becomes of a step.
RETRY, KEEP, FLOOR = range(3)


@part_of_kernel
def set_out(plan, work, state, groups, s):
    """The step to take, that which its end may have cut short, the machine's rate and what Newton is to reach."""
    number = state.numbers
    h = number[st.STEP]
    rate = st.machine_rate(state, groups)
    if state.counts[st.FIXED_STEP] == 0:
        h = min(h, _LONGEST / (rate + 1e-300))
    whole = h
    h = st.next_step(state, whole)
    if s.added.shape[0] > 0:
        shift_auxiliary(state, h)
    else:
        carry_auxiliary(state, h)
    evaluate_times(plan, number[st.TIME] + h, work.time)
    limit = max(number[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
    st.set_scales(state, groups, s, rate, limit)
    return h, whole, rate, max(_NEWTON_SHARE * limit, 5e-15)


@kernel
def accept(plan, state, groups, s, record, h):
    """Make the trial state the current one and write a row of the record."""
    memory = state.memory
    for k in range(state.v.shape[0]):
        memory[step.EARLIEST, k] = memory[step.EARLIER, k]
        memory[step.EARLIER, k] = memory[step.BEFORE, k]
        memory[step.BEFORE, k] = state.a[k]
        state.v[k] = s.v[k]
        state.a[k] = s.a[k]
        memory[step.AUXILIARY, k] = s.auxiliary[k]
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = s.multipliers[i]
    state.numbers[step.STEP_EARLIER] = state.numbers[st.STEP_BEFORE]
    state.counts[step.KNOWN_BEFORE] = min(3, state.counts[step.KNOWN_BEFORE] + 1)
    st.store(plan, state, groups, record, h)


@kernel
def carry_auxiliary(state, h):
    """Give the auxiliary acceleration of a new step size the value that the method settles at.

    On a parabola a(t) the recursion settles at a(t + delay) + settle a'', each by the step; the
    parabola is that through the last true accelerations.  A mere scaling of the old deviation
    would leave an error of the old step's square.
    """
    number = state.numbers
    known = state.counts[step.KNOWN_BEFORE]
    if h == number[step.STEP_AUXILIARY] or known == 0:
        return
    number[step.STEP_AUXILIARY] = h
    alpha_m = number[step.ALPHA_M]
    alpha_f = number[step.ALPHA_F]
    share = alpha_m - alpha_f
    delay = share * h
    settle = 0.5 * h * h * (1.0 - alpha_f - (1.0 - alpha_m) * (1.0 + share) ** 2 - alpha_m * share**2)
    h1 = number[st.STEP_BEFORE]
    h2 = number[step.STEP_EARLIER]
    for k in range(state.v.shape[0]):
        slope = (state.a[k] - state.memory[step.BEFORE, k]) / h1
        half_curve = 0.0
        if known > 1:
            half_curve = (slope - (state.memory[step.BEFORE, k] - state.memory[step.EARLIER, k]) / h2) / (h1 + h2)
            slope += half_curve * h1
        state.memory[step.AUXILIARY, k] = (
            state.a[k] + delay * slope + (delay * delay + 2.0 * settle) * half_curve
        )


@kernel
def shift_auxiliary(state, h):
    """``carry_auxiliary`` where interiors step along, which do just this (``Scheme.carry``): with the new instant."""
    h_before = state.numbers[st.STEP_BEFORE]
    if h == h_before or state.counts[step.KNOWN_BEFORE] == 0:
        return
    share = (state.numbers[step.ALPHA_M] - state.numbers[step.ALPHA_F]) * (h - h_before) / h_before
    for k in range(state.v.shape[0]):
        state.memory[step.AUXILIARY, k] += share * (state.a[k] - state.memory[step.BEFORE, k])


@part_of_kernel
def judge(state, ratio, h, whole):
    """Whether a step whose error is ``ratio`` of what is tolerated counts; sets the next."""
    number = state.numbers
    count = state.counts
    growth = 0.9 / np.sqrt(max(ratio, 1e-4))
    if not ratio <= 1.0:
        count[st.REJECTED] += 1
        count[step.HOLD] = _HOLD
        if h <= number[st.STEP_FLOOR_SIZE]:
            return FLOOR
        number[st.STEP] = h * max(0.2, growth) if np.isfinite(growth) else 0.2 * h
        return RETRY
    # the step changes seldom, for each change costs a factorisation
    count[step.HOLD] -= 1
    if h < whole:
        number[st.STEP] = whole  # it was cut short by the end alone
    elif growth > 1.25 and count[step.HOLD] <= 0:
        number[st.STEP] = min(number[st.STEP_CEILING], h * min(growth, 2.0))
    else:
        number[st.STEP] = h if growth > 0.95 else 0.85 * h
    return KEEP
