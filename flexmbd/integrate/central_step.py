"""A step of explicit central differences, its error, and the loop over steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.loop_dynamics import N_MEMORY, accelerate, is_nearly_singular, note_scales, project
from flexmbd.multibody.kernels.compiling import entry_kernel, part_of_kernel
from flexmbd.multibody.kernels.residual import drive
from flexmbd.multibody.kernels.rotation_update import EXPONENTIAL, move
from flexmbd.multibody.kernels.time_functions import evaluate_times

FloatArray = NDArray[np.float64]

# Row of State.memory: the acceleration of the step before.
_BEFORE = N_MEMORY

_LONGEST = 0.5  # the longest step in characteristic times of the machine
_SAFETY = 0.9
_LEAST, _MOST = 0.2, 2.0  # a step's size over that of the step before
_UNSEEN = 3.0  # the error over what is seen of it: forces also feel that the velocity at the step's end is foretold


class Scratch(NamedTuple):
    """The step's end, its displacement u, and the local errors."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    multipliers: FloatArray
    error_x: FloatArray
    error_v: FloatArray


@part_of_kernel
def foretell(plan, work, plain, quaternions, state, s, h):
    """Put the positions of the step's end and the velocities expected there into ``s``."""
    for k in range(s.v.shape[0]):
        s.u[k] = h * (state.v[k] + 0.5 * h * state.a[k])
        s.v[k] = state.v[k] + h * state.a[k]
    move(plain, quaternions, EXPONENTIAL, state.x, s.u, s.x)
    evaluate_times(plan, st.end_of_step(state, h), work.time)
    if plan.flag[0] == 0:
        drive(plan, work, s.x, s.v, s.a)


@part_of_kernel
def _step(plan, work, aw, loops, plain, quaternions, state, groups, s, h, rate):
    """Take the step h; False if loops do not close or the end is not finite."""
    foretell(plan, work, plain, quaternions, state, s, h)
    if plan.flag[0] != 0:
        return False
    looped = plan.rows.shape[0] > 0
    for attempt in range(2):
        if attempt == 1 and not project(plan, work, aw, plain, quaternions, state, groups, loops, rate, s.x, s.v):
            return False
        accelerate(plan, work, aw, loops, s.x, s.v, s.a, s.multipliers)
        state.counts[st.EVALUATIONS] += 1
        if not looped or not is_nearly_singular(loops):
            break
    total = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        s.v[k] = state.v[k] + 0.5 * h * (state.a[k] + s.a[k])
        total += s.v[k]
    if looped and not project(plan, work, aw, plain, quaternions, state, groups, loops, rate, s.x, s.v):
        return False
    return np.isfinite(total)


@part_of_kernel
def _error(plan, state, groups, s, h, rate):
    """The step's error over what is tolerated: what the accelerations' slope and curvature add."""
    before = state.numbers[st.STEP_BEFORE]
    known = state.counts[st.STEPS] > 0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        change = s.a[k] - state.a[k]
        s.error_x[k] = h * h / 6.0 * change
        s.error_v[k] = 0.0
        if known:
            bend = change / h - (state.a[k] - state.memory[_BEFORE, k]) / before
            s.error_v[k] = h**3 / 6.0 * bend / (h + before)
    return _UNSEEN * st.error_ratio(plan, state, groups, s.error_x, s.error_v, h, rate)


@part_of_kernel
def _accept(plan, state, groups, s, record, h):
    """Make the step's end the current state and write a row of the record."""
    for k in range(state.v.shape[0]):
        state.memory[_BEFORE, k] = state.a[k]
        state.v[k] = s.v[k]
        state.a[k] = s.a[k]
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = s.multipliers[i]
    st.store(plan, state, groups, record, h)


@entry_kernel
def advance(plan, work, aw, loops, plain, quaternions, state, groups, s, record):
    """Step until the end, a full record, or a failure.

    Returns a code of ``state``: DONE, OUTPUT, CALLBACK_FAILED, STEP_FLOOR or NOT_FINITE (the step
    STEP at TIME, worst velocity WORST).
    """
    number = state.numbers
    count = state.counts
    fixed = count[st.FIXED_STEP] == 1
    while number[st.TIME] < number[st.TIME_END]:
        if count[st.STORED] == record.t.shape[0]:
            return st.OUTPUT
        h = number[st.STEP]
        rate = st.machine_rate(state, groups)
        if not fixed:
            h = min(h, _LONGEST / rate)
        whole = h
        h = st.next_step(state, whole)
        found = _step(plan, work, aw, loops, plain, quaternions, state, groups, s, h, rate)
        if plan.flag[0] != 0:
            return st.CALLBACK_FAILED
        ratio = np.inf
        if found:
            ratio = 0.0 if fixed else _error(plan, state, groups, s, h, rate)
        if not ratio <= 1.0:
            count[st.REJECTED] += 1
            if fixed:
                return st.NOT_FINITE
            if h <= number[st.STEP_FLOOR_SIZE]:
                return st.STEP_FLOOR
            number[st.STEP] = h * max(_LEAST, _SAFETY * ratio ** (-1.0 / 3.0) if np.isfinite(ratio) else 0.0)
            continue
        _accept(plan, state, groups, s, record, h)
        if plan.rows.shape[0] > 0:
            note_scales(loops)
        if not fixed:
            growth = min(_MOST, _SAFETY * max(ratio, 1e-4) ** (-1.0 / 3.0))
            number[st.STEP] = whole if h < whole else min(number[st.STEP_CEILING], h * max(_LEAST, growth))
    return st.DONE
