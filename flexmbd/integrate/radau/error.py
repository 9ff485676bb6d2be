"""The ratio of a Radau IIA step's local error to the tolerance."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.controller import SAFETY
from flexmbd.integrate.data_loads import mean_and_noise, push, put_pushes
from flexmbd.integrate.lasting import (
    begin_contacts,
    crosses_any,
    forget_passing,
    holds_any,
    is_crossed,
    judge_lasting,
    lets_go,
    unseen_touch,
)
from flexmbd.integrate.radau.coefficients import CURVATURE, ERROR_WEIGHTS, NODES, QUADRATURE, REAL, STAGES
from flexmbd.integrate.radau.matrix import put_imbalance, solve_real
from flexmbd.integrate.radau.newton import MAX_ITERATIONS
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.law_pieces import changes_piece
from flexmbd.multibody.kernels.inverse_dynamics.letting_go import mark_held, time_of_touch, time_to_touch
from flexmbd.round_off import EPSILON

_GAIN = 6.0  # true error over the estimate to the power 3/2, both relative: the largest measured, on tops
# Roughness over that of the steps before: the limit of a smooth motion; the most that a rough step adds.
_SMOOTH, _GROWTH = 4.0, 8.0
_FORGET = 0.5  # how it fades: an estimate passes through zero
_EVENT = 0.1  # of the tolerance of a radian: that of a step that is not smooth
_LITTLE = 1e-3  # of a roughness that allows the longest steps: the limit after a motion without any


@kernel
def _estimate(plan, state, groups, scratch, h):
    """The estimate: difference of the rates at the start and on the stages' parabola, times the step; filtered.

    The filter, the real iteration matrix, damps the difference in stiff parts of the machine (Hairer & Wanner 1996,
    eq. IV.8.19) and removes its part across the loops.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    step = h / REAL
    for j in range(nu):
        k = plan.free[j]
        gap_x = state.v[k] / REAL
        gap_v = state.a[k] / REAL
        curve = 0.0
        size = groups.acceleration[groups.of[k]]
        for i in range(3):
            size = max(size, abs(scratch.a[i, k]))
            gap_x += ERROR_WEIGHTS[i] * scratch.local_rate[i, k]
            gap_v += ERROR_WEIGHTS[i] * scratch.a[i, k]
            curve += CURVATURE[i] * scratch.a[i, k]
        scratch.error_x[j] = h * gap_x
        scratch.error_v[j] = h * gap_v
        # the frequency of a vibration with that curvature of its acceleration
        scratch.own_rate[k] = np.sqrt(abs(curve) / size) / h if size > 0.0 else 0.0
    put_imbalance(plan, scratch, step)
    solve_real(plan, scratch)
    for j in range(nu):
        shift = scratch.push_real[j] if m > 0 else 0.0
        scratch.error_v[j] = scratch.rhs_real[0, j]
        scratch.error_x[j] += step * (scratch.rhs_real[0, j] + shift)


@kernel
def widen_vibration_scales(state, groups, scratch, h, machine_rate):
    """Let Newton's corrections of a lasting vibration be as large, in proportion, as its local error may be."""
    share = min(1.0, h * machine_rate)
    for k in range(scratch.scale_x.shape[0]):
        own = scratch.memory.own_rate[k] * st.vibrating_share(groups, k, 1.0, state.numbers[st.LASTING])
        gain = min(1.0, h * max(machine_rate, own)) / share
        scratch.scale_x[k] *= gain
        scratch.scale_v[k] *= gain


@kernel
def _ratio(plan, state, groups, scratch, h, machine_rate):
    """Largest ratio of the local error to the tolerance: rtol per radian of the motion that causes it.

    The estimate is of order 3, the method of order 5: an estimate e stands for an error of e^(3/2), so that rtol means
    the same as for other methods (Hairer & Wanner change tolerances alike).  A vibration faster than the machine
    that lasts is measured per radian of its own, and its velocity by its displacement, for its error swings and does
    not drift.

    All that is true of smooth motions alone, in which e goes with the step's fourth power.  Where it is larger than
    that makes of the steps before, e itself counts as error, one that drifts, of an event that is over after the step:
    against a share of what a radian is given.
    """
    tolerance = state.numbers[st.TOLERANCE]
    largest = 0.0
    plain = 0.0
    rough = 0.0
    expected = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        g = groups.of[k]
        size = groups.position[g]
        own = st.own_rate(scratch.own_rate[k], scratch.memory.own_rate[k], machine_rate, h)
        own *= st.vibrating_share(groups, k, 1.0, state.numbers[st.STEP_LASTING])
        share = min(1.0, h * max(machine_rate, own))
        limit = (tolerance * share / _GAIN) ** (2.0 / 3.0)
        speed = st.group_speed(groups, g, machine_rate)
        own_speed = max(speed, own * size)
        # modes that hardly move are differences of the whole motion, with its round-off
        least = st.ROUND_OFF * groups.full[g]
        # a step moves stiff parts within h by round-off of their places
        moved = 4.0 * EPSILON * groups.full[g] / h
        part = abs(scratch.error_v[j]) / max(limit * own_speed, least * machine_rate, moved)
        position = abs(scratch.error_x[j]) if groups.kind[g] != kinds.GROUP_STATE else 0.0
        part = max(part, position / max(limit * size, least))
        if not part <= largest:
            largest = part
            state.counts[st.WORST] = k
        speed = max(speed, least / tolerance * machine_rate, moved / tolerance)
        rough = max(rough, abs(scratch.error_v[j]) / speed)
        expected = max(expected, scratch.memory.roughness[k] * h**4 / speed)
        plain = max(plain, rough, position / max(size, least / tolerance))
    known = scratch.memory.roughness_known[0] == 1
    scratch.memory.smooth[0] = 1 if not known or rough <= _SMOOTH * expected else 0
    return largest if scratch.memory.smooth[0] == 1 else max(largest, plain / (_EVENT * tolerance))


@kernel
def _find(plan, state, scratch, h, weights, means, defect):
    """Fill ``defect`` (times, 3) with a sum of data at the stages by ``weights`` (3,), less ``means`` times the mean.

    Returns whether there is any but round-off.
    """
    found = False
    begin = state.numbers[st.TIME]
    end = st.function_time(state.numbers, state.numbers[st.STEP_END])
    for i in range(plan.times.shape[0]):
        mean, noise = mean_and_noise(plan, i, begin, end)
        for c in range(3):
            defect[i, c] = 0.0
            if noise[c] > 0.0:
                lack = -means * mean[c]
                for k in range(3):
                    lack += weights[k] * scratch.time[k, i, c]
                if abs(lack) > 8.0 * noise[c]:
                    defect[i, c] = lack
                    found = True
    return found


@kernel
def _respond(plan, work, state, scratch):
    """Put into ``s.rhs_real`` the accelerations that data's defects make, filtered by the real iteration matrix."""
    end = 2
    push(plan, work, state, scratch.x[end], scratch.v[end], scratch.a[end], scratch.multipliers[end], scratch.data)
    put_pushes(plan, scratch.data, scratch.rhs_real)
    solve_real(plan, scratch)


@deferred_kernel(NUMBER)
def _ratio_with_loads(plan, work, state, groups, scratch, h, machine_rate, ratio):
    """The error's ratio where data act in the step: what they do is no vibration, and what is missed of them counts."""
    if _find(plan, state, scratch, h, CURVATURE, 0.0, scratch.data.defect):
        _respond(plan, work, state, scratch)
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            size = groups.acceleration[groups.of[k]]
            bent = np.sqrt(abs(scratch.rhs_real[0, j]) / size) / h if size > 0.0 else 0.0
            scratch.own_rate[k] = np.sqrt(max(0.0, scratch.own_rate[k] ** 2 - bent**2))
        ratio = _ratio(plan, state, groups, scratch, h, machine_rate)
    if ratio <= 1.0 and _find(plan, state, scratch, h, QUADRATURE, 1.0, scratch.data.defect):
        _respond(plan, work, state, scratch)
        limit = max(state.numbers[st.TOLERANCE] * min(1.0, h * machine_rate), st.ROUND_OFF)
        missed = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            speed = st.group_speed(groups, groups.of[k], machine_rate)
            missed = max(missed, abs(h * scratch.rhs_real[0, j]) / (limit * speed))
        ratio = max(ratio, missed ** (2.0 / 3.0))
    return ratio


@kernel
def _changes_piece(plan, work, state, scratch):
    """Whether the step leads through several pieces of a law."""
    for i in range(STAGES):
        if changes_piece(plan, work, state.x, scratch.x[i], scratch.v[i]):
            return True
    return False


@kernel
def _event_ratio(plan, state, groups, scratch, h, machine_rate, all_coordinates):
    """The ratio of a step onto another piece of a law: the gap between accelerations itself counts, as of an event.

    It is not filtered, for a stiffness that comes or goes within the step damps nothing.  Of contacts that set in or
    let go it is that of the coordinates which move them, not of ``all_coordinates``.
    """
    largest = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        if not (all_coordinates or is_crossed(groups, k)):
            continue
        gap = state.a[k] / REAL
        for i in range(STAGES):
            gap += ERROR_WEIGHTS[i] * scratch.a[i, k]
        least = st.ROUND_OFF * groups.full[groups.of[k]] / state.numbers[st.TOLERANCE]
        speed = max(st.group_speed(groups, groups.of[k], machine_rate), least * machine_rate)
        largest = max(largest, abs(h * gap) / speed)
    return largest / (_EVENT * state.numbers[st.TOLERANCE])


@kernel
def _judge_contacts(plan, work, state, groups, scratch, h):
    """Write which contacts touch at the step's start and at its stages, and which coordinates move them.

    Returns the ratio of a step that touches between these and does not know: see ``unseen_touch``.
    """
    begin_contacts(plan, work, state, groups)
    for i in range(groups.touched.shape[0]):
        groups.touched[i] += scratch.touched[i]
    mark_held(plan, groups.touched, STAGES + 1, groups.held)
    touch = time_of_touch(groups.gap_begin, scratch.gaps[0], NODES[0] * h)
    for i in range(1, STAGES):
        passed = NODES[i - 1] * h
        touch = min(touch, passed + time_of_touch(scratch.gaps[i - 1], scratch.gaps[i], NODES[i] * h - passed))
    return unseen_touch(plan, touch)


@deferred_kernel(NUMBER)
def _unresolved_ratio(plan, state, groups, scratch, h, machine_rate):
    """The ratio of what the step leaves unresolved of vibrations on contacts, which becomes velocity where they let go.

    Of a vibration of rate w the filter leaves 1 in 1 + (h w / REAL)^2 of an error.  The share s that it takes away
    where it is applied once more to the estimate is of order 6 while h w is small, as the method's error; and where h w
    is large it is the velocity of the vibration, which the method damps without following it.  So it counts as error
    itself.  What is damped is lost once, some s^4 of it in a step: all of it may be what a radian is given.
    """
    for j in range(plan.free.shape[0]):
        scratch.error_x[j] = 0.0
    put_imbalance(plan, scratch, h / REAL)
    solve_real(plan, scratch)
    largest = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        if groups.held[k] > 0.0:
            least = st.ROUND_OFF * groups.full[groups.of[k]]
            speed = st.group_speed(groups, groups.of[k], machine_rate)
            lost = abs(scratch.error_v[j] - scratch.rhs_real[0, j])
            share = min(1.0, lost / (abs(scratch.error_v[j]) + 1e-300))
            limit = state.numbers[st.TOLERANCE] * max(min(1.0, h * machine_rate), share**4)
            largest = max(largest, lost / max(limit * speed, least * machine_rate))
    return largest ** (2.0 / 3.0)


@kernel
def local_error(plan, work, state, groups, scratch, h, machine_rate):
    """Largest local error over what is tolerated, see ``_ratio``."""
    _estimate(plan, state, groups, scratch, h)
    if groups.stiffness.shape[0] > 0:
        least = 1.0
        for i in range(STAGES):  # a contact may lie between the step's ends
            judge_lasting(plan, work, state, groups, scratch.x[i], scratch.v[i])
            least = min(least, state.numbers[st.STEP_LASTING])
        state.numbers[st.STEP_LASTING] = least
    unseen = 0.0
    if lets_go(groups):
        unseen = _judge_contacts(plan, work, state, groups, scratch, h)
    ratio = _ratio(plan, state, groups, scratch, h, machine_rate)
    if ratio <= 1.0 and scratch.data.known[0] == 1:
        ratio = _ratio_with_loads(plan, work, state, groups, scratch, h, machine_rate, ratio)
    if ratio <= 1.0 and holds_any(groups):
        ratio = max(ratio, _unresolved_ratio(plan, state, groups, scratch, h, machine_rate))
    may_change = scratch.tangent_stiffness.shape[0] > 0 or plan.horizon[1] > 0.0
    if ratio <= 1.0:
        changes = may_change and _changes_piece(plan, work, state, scratch)
        if changes or crosses_any(groups):
            ratio = max(ratio, _event_ratio(plan, state, groups, scratch, h, machine_rate, changes))
    forget_passing(plan, state, groups, scratch.own_rate)
    return max(ratio, unseen)


@kernel
def remember_roughness(plan, state, groups, scratch, h):
    """Update roughness and own rates by an accepted step; one that was not smooth counts in part."""
    rate = state.numbers[st.RATE]
    smooth = scratch.memory.smooth[0] == 1
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        before = scratch.memory.roughness[k]
        now = abs(scratch.error_v[j]) / h**4
        if not smooth:
            now = min(now, max(_GROWTH * before, _LITTLE * st.group_speed(groups, groups.of[k], rate) * rate**4))
        scratch.memory.roughness[k] = max(now, _FORGET * before)
        scratch.memory.own_rate[k] = st.own_rate(
            scratch.own_rate[k] if smooth else 0.0, scratch.memory.own_rate[k], rate, h
        )
    scratch.memory.roughness_known[0] = 1


@kernel
def bound_next_step(plan, groups, scratch):
    """Let the step after an accepted one end no later than twice the time in which the first gap closes.

    Places of early stages are of a lower order than the end: a touch that is over before them is to lie behind one.
    """
    if lets_go(groups):
        plan.horizon[0] = min(plan.horizon[0], 2.0 * time_to_touch(scratch.gaps[STAGES - 1]))


@kernel
def set_safety(state, scratch):
    """Set the safety factor, smaller after a step of many iterations (Hairer & Wanner 1996, section IV.8)."""
    used = scratch.memory.newton_iterations[0]
    state.numbers[st.SAFETY] = SAFETY * (2.0 * MAX_ITERATIONS + 1.0) / (2.0 * MAX_ITERATIONS + used)
