"""Lie-group generalized-alpha for trees and, in stabilised index-2 form, for closed loops.

Order 2; dissipation at high frequency set by the spectral radius rho.  Variable steps keep the
order because the auxiliary acceleration is carried over at its own instant.  Sources: Chung &
Hulbert 1993; Bruels, Cardona & Arnold 2012 (Lie group); Arnold & Hante 2017 (stabilised
index-2 form).  The loop ``advance`` runs compiled until it needs something, returns a code, and
is re-entered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.implicit_step import solve_step
from flexmbd.integrate.local_error import local_error
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.time_functions import evaluate_times

ORDER = 2

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_LONGEST = 0.5  # the longest step in characteristic times of the machine
_HOLD = 8  # steps without growth after a rejection


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Choice of the method: ``rho`` in [0, 1] is the spectral radius at infinite frequency.

    ``rho = 1`` does not dissipate; smaller values damp what the step does not resolve.

    Raises:
        SceneError: rho lies outside.
    """

    rho: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 <= self.rho <= 1.0:
            raise SceneError(f"rho must lie between 0 and 1, got {self.rho}")

    def coefficients(self) -> tuple[float, float, float, float]:
        """alpha_m, alpha_f, beta, gamma (Chung & Hulbert 1993, eq. 17, 20, 25)."""
        alpha_m = (2.0 * self.rho - 1.0) / (self.rho + 1.0)
        alpha_f = self.rho / (self.rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma


@kernel
def _accept(plan, state, groups, s, record, h):
    """Make the trial state the current one and write a row of the record."""
    number = state.numbers
    for k in range(state.v.shape[0]):
        state.earlier[k] = state.before[k]
        state.before[k] = state.a[k]
        state.v[k] = s.v[k]
        state.a[k] = s.a[k]
        state.auxiliary[k] = s.auxiliary[k]
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = s.multipliers[i]
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        if row[at.FLEX] >= 0:
            for k in range(plan.flex[row[at.FLEX], at.N_MODES]):
                g = groups.of[row[at.MODAL_V] + k]
                size = abs(state.x[row[at.MODAL_X] + k])
                groups.position[g] = max(groups.position[g], size)
    number[st.TIME] = number[st.TIME_END] if number[st.TIME_END] - number[st.TIME] <= h else number[st.TIME] + h
    number[st.STEP_EARLIER] = number[st.STEP_BEFORE]
    number[st.STEP_BEFORE] = h
    state.counts[st.KNOWN_BEFORE] = min(2, state.counts[st.KNOWN_BEFORE] + 1)
    state.counts[st.STEPS] += 1
    r = state.counts[st.STORED]
    record.t[r] = number[st.TIME]
    for k in range(state.x.shape[0]):
        record.x[r, k] = state.x[k]
    for k in range(state.v.shape[0]):
        record.v[r, k] = state.v[k]
        record.a[r, k] = state.a[k]
    for i in range(state.multipliers.shape[0]):
        record.multipliers[r, i] = state.multipliers[i]
    state.counts[st.STORED] = r + 1


@kernel
def _carry_auxiliary(state, h):
    """Give the auxiliary acceleration of a new step size the value that the method settles at.

    On a parabola a(t) the recursion settles at a(t + delay) + settle a'', each by the step; the
    parabola is that through the last true accelerations.  A mere scaling of the old deviation
    would leave an error of the old step's square.
    """
    number = state.numbers
    known = state.counts[st.KNOWN_BEFORE]
    if h == number[st.STEP_AUXILIARY] or known == 0:
        return
    number[st.STEP_AUXILIARY] = h
    alpha_m = number[st.ALPHA_M]
    alpha_f = number[st.ALPHA_F]
    share = alpha_m - alpha_f
    delay = share * h
    settle = 0.5 * h * h * (1.0 - alpha_f - (1.0 - alpha_m) * (1.0 + share) ** 2 - alpha_m * share**2)
    h1 = number[st.STEP_BEFORE]
    h2 = number[st.STEP_EARLIER]
    for k in range(state.v.shape[0]):
        slope = (state.a[k] - state.before[k]) / h1
        half_curve = 0.0
        if known > 1:
            half_curve = (slope - (state.before[k] - state.earlier[k]) / h2) / (h1 + h2)
            slope += half_curve * h1
        state.auxiliary[k] = (
            state.a[k] + delay * slope + (delay * delay + 2.0 * settle) * half_curve
        )


@part_of_kernel
def _start_auxiliary(plan, work, state, groups, s, h, tolerance):
    """Give the first step the auxiliary acceleration of its own instant, for full order.

    It belongs alpha_m - alpha_f steps after the true one; the trial's slope tells its value.
    """
    delay = state.numbers[st.ALPHA_M] - state.numbers[st.ALPHA_F]
    for _ in range(2):
        for k in range(state.a.shape[0]):
            state.auxiliary[k] = state.a[k] + delay * (s.a[k] - state.a[k])
        if not solve_step(plan, work, state, groups, s, h, tolerance):
            return False
    return True


@kernel
def advance(plan, work, state, groups, s, asked, record):
    """Step until the end, a full record, an input of a Python callable, or a failure.

    Returns a code of ``state``: DONE, OUTPUT, NEED_INPUT (values of the functions of time at
    INPUT_TIME wanted in ``asked``), STEP_FLOOR or NEWTON_FAILED (the step STEP at TIME, worst
    velocity WORST).
    """
    number = state.numbers
    count = state.counts
    while number[st.TIME] < number[st.TIME_END]:
        if count[st.STORED] == record.t.shape[0]:
            return st.OUTPUT
        h = number[st.STEP]
        rate = st.machine_rate(state, groups)
        if count[st.FIXED_STEP] == 0:
            h = min(h, _LONGEST / (rate + 1e-300))
        left = number[st.TIME_END] - number[st.TIME]
        if left <= h * (1.0 + 1e-6):  # no sliver of a step from rounding the time
            h = left
        elif left < 2.0 * h and count[st.FIXED_STEP] == 0:
            h = 0.5 * left
        t = number[st.TIME] + h
        if count[st.ASKS_INPUT] == 1 and number[st.INPUT_TIME] != t:
            number[st.INPUT_TIME] = t
            return st.NEED_INPUT
        _carry_auxiliary(state, h)
        evaluate_times(plan, t, asked, work.time)
        limit = max(number[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
        st.set_scales(state, groups, s, rate, limit)
        aim = max(_NEWTON_SHARE * limit, 5e-15)
        solved = solve_step(plan, work, state, groups, s, h, aim)
        if solved and count[st.KNOWN_BEFORE] == 0:
            solved = _start_auxiliary(plan, work, state, groups, s, h, aim)
        if not solved:
            count[st.REJECTED] += 1
            if count[st.FIXED_STEP] == 1:
                return st.NEWTON_FAILED
            if h <= number[st.STEP_FLOOR_SIZE]:
                return st.STEP_FLOOR
            number[st.STEP] = 0.25 * h
            continue
        if count[st.FIXED_STEP] == 1:
            _accept(plan, state, groups, s, record, h)
            continue
        ratio = local_error(plan, work, state, groups, s, h, rate)
        growth = 0.9 / np.sqrt(max(ratio, 1e-4))
        if not ratio <= 1.0:
            count[st.REJECTED] += 1
            count[st.HOLD] = _HOLD
            if h <= number[st.STEP_FLOOR_SIZE]:
                return st.STEP_FLOOR
            number[st.STEP] = h * max(0.2, growth) if np.isfinite(growth) else 0.2 * h
            continue
        _accept(plan, state, groups, s, record, h)
        # the step changes seldom, for each change costs a factorisation
        count[st.HOLD] -= 1
        if growth > 1.25 and count[st.HOLD] <= 0:
            number[st.STEP] = min(number[st.STEP_CEILING], h * min(growth, 2.0))
        else:
            number[st.STEP] = h if growth > 0.95 else 0.85 * h
    return st.DONE
