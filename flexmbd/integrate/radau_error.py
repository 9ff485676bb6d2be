"""The local error of a Radau IIA step over what rtol tolerates, and the step that follows from it."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.radau_coefficients import CURVATURE, ERROR_WEIGHTS, REAL
from flexmbd.integrate.radau_newton import MAX_ITERATIONS
from flexmbd.integrate.radau_stages import HOLD, NEWTON, RATE, RATIO_BEFORE, STEP_ACCEPTED
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.native import solve

_FADE = 0.95  # how a coordinate's own rate fades from step to step
_GAIN = 6.0  # true error over the estimate to the power 3/2, both relative: the most seen, on tops
_EXPONENT = 0.3  # of the step over the ratio: that to the power 3/2 goes with the step's fifth power


@kernel
def _estimate(plan, state, groups, s, h):
    """Gap between the rates at the start and what the stages' parabola makes of them, times the step; filtered.

    The filter, the real iteration matrix, takes out what stiff parts of the machine make of the gap (Hairer & Wanner
    1996, eq. IV.8.19), and what the loops do not let through.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    step = h / REAL
    for j in range(nu):
        k = plan.free[j]
        gap_x = state.v[k] / REAL
        gap_v = state.a[k] / REAL
        curve = 0.0
        for i in range(3):
            gap_x += ERROR_WEIGHTS[i] * s.p[i, k]
            gap_v += ERROR_WEIGHTS[i] * s.a[i, k]
            curve += CURVATURE[i] * s.a[i, k]
        s.error_x[j] = h * gap_x
        s.error_v[j] = h * gap_v
        # the frequency of a vibration with that curvature of its acceleration
        size = groups.acceleration[groups.of[k]]
        rate = np.sqrt(abs(curve) / size) / h if size > 0.0 else 0.0
        state.memory[RATE, k] = max(rate, _FADE * state.memory[RATE, k])
    for i in range(nu):
        total = 0.0
        for j in range(nu):
            total += s.mass[i, j] * s.error_v[j] - step * s.stiffness[i, j] * s.error_x[j]
        s.rhs_real[0, i] = total
    for r in range(m):
        opening = 0.0
        swing = 0.0
        for j in range(nu):
            opening -= s.reach[r, j] * s.error_x[j]
            swing -= s.turn[r, j] * s.error_x[j]
        holds = plan.rows[r, at.ROW_LEVEL] == at.LEVEL_POSITION
        s.rhs_real[0, nu + r] = opening / step if holds else 0.0
        s.rhs_real[0, nu + m + r] = swing
    solve(plan.lapack, s.real, s.pivot_real, s.sizes, s.rhs_real)
    for j in range(nu):
        shift = 0.0
        for r in range(m):
            shift += s.direction[r, j] * s.rhs_real[0, nu + m + r]
        s.error_v[j] = s.rhs_real[0, j]
        s.error_x[j] += step * (s.rhs_real[0, j] + shift)


@kernel
def widen_scales(state, s, h, machine_rate):
    """Let Newton's corrections of a vibration be as large, in proportion, as its local error may be."""
    share = min(1.0, h * machine_rate)
    for k in range(s.scale_x.shape[0]):
        gain = min(1.0, h * max(machine_rate, state.memory[RATE, k])) / share
        s.scale_x[k] *= gain
        s.scale_v[k] *= gain


@kernel
def local_error(plan, state, groups, s, h, machine_rate):
    """Largest local error over what is tolerated: rtol per radian of the motion that causes it.

    The estimate is of order 3, the method of order 5: an estimate e stands for an error of e^(3/2), so that rtol means
    the same as for other methods (Hairer & Wanner change tolerances alike).  A vibration faster than the machine is
    measured over its own radian, and its velocity by what it displaces, for it swings and does not drift.
    """
    _estimate(plan, state, groups, s, h)
    largest = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        g = groups.of[k]
        size = groups.position[g]
        own = state.memory[RATE, k]
        share = min(1.0, h * max(machine_rate, own))
        limit = (state.numbers[st.TOLERANCE] * share / _GAIN) ** (2.0 / 3.0)
        speed = max(st.group_speed(groups, g, machine_rate), own * size)
        # modes that hardly move are differences of the whole motion, with its round-off
        least = st.ROUND_OFF * groups.full[g]
        part = abs(s.error_v[j]) / max(limit * speed, least * machine_rate)
        part = max(part, abs(s.error_x[j]) / max(limit * size, least))
        if not part <= largest:
            largest = part
            state.counts[st.WORST] = k
    return largest


@kernel
def step_growth(state, h, ratio):
    """Factor from h to the next step: by the error, and by its trend over two steps (Gustafsson 1994)."""
    if not np.isfinite(ratio):
        return 0.2
    safety = 0.9 * (2.0 * MAX_ITERATIONS + 1.0) / (2.0 * MAX_ITERATIONS + state.counts[NEWTON])
    ratio = max(ratio, 1e-6)
    growth = safety * ratio**-_EXPONENT
    before = state.numbers[STEP_ACCEPTED]
    if before > 0.0 and ratio <= 1.0 and state.counts[HOLD] == 0:
        trend = safety * h / before * (state.numbers[RATIO_BEFORE] / ratio**2) ** _EXPONENT
        growth = min(growth, trend)
    return min(8.0, max(0.2, growth))
