"""The ratio of an energy-momentum step's local error to the tolerance."""

from __future__ import annotations

import math

from flexmbd.integrate import state as st
from flexmbd.integrate.data_loads import find_defects, push, put_pushes
from flexmbd.integrate.discrete_gradient import workspace as step
from flexmbd.integrate.discrete_gradient.newton import solve_factored
from flexmbd.integrate.discrete_gradient.sparse_matrices import is_sparse, multiply_end_mass, solve_iteration
from flexmbd.integrate.discrete_gradient.step import ROUND_OFF
from flexmbd.integrate.filtered_error import filtered_ratio, misses_no_load, ratio_with_loads, vibration_rate
from flexmbd.integrate.lasting import forget_passing, is_crossed, judge_contacts, judge_lasting, lets_go
from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, store3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.physics.joints import spin_of
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between


@kernel
def _add_rotation_error(move, before, after, a_before, a_after, o, h, error):
    """Add the local error of the rotation ``move``, against a quadrature of order 4 with Magnus' first bracket."""
    turn = load3(move, o)
    angle = math.sqrt(dot3(turn, turn))
    share = 2.0 * math.atan(0.5 * angle) / angle if angle > 1e-8 else 1.0
    bracket = scale3(h * h * h / 12.0, cross3(load3(before, o), load3(a_before, o)))
    difference = add3(scale3(share - 1.0, turn), scale3(-1.0, bracket))
    store3(error, o, add3(load3(error, o), difference))


@kernel
def _filter(plan, scratch, error):
    """Filter an error (nv,) into ``s.correction`` by the iteration matrix.

    This damps the error in stiff parts and removes it across rows.  ``s.full_matrix``, or ``s.end_mass``, must hold the
    mass matrix.
    """
    free = plan.free
    if is_sparse(scratch):
        multiply_end_mass(plan, scratch, error)
        solve_iteration(scratch)
        return
    for i in range(scratch.correction.shape[1]):
        scratch.correction[0, i] = 0.0
    bounds = scratch.tangent.blocks.free
    for c in range(bounds.shape[0] - 1):
        for i in range(*between(bounds, c)):
            for j in range(*between(bounds, c)):
                scratch.correction[0, i] += scratch.full_matrix[free[i], free[j]] * error[free[j]]
    solve_factored(plan, scratch)


@kernel
def _ratio(plan, state, groups, scratch, h, rate, noise, lasting):
    rates = scratch.memory.own_rate
    return filtered_ratio(
        plan, state, groups, scratch.error_x, scratch.error_v, scratch.own_rate, rates, h, rate, noise, lasting
    )


@deferred_kernel(NUMBER)
def _ratio_with_loads(plan, work, state, groups, scratch, h, rate, noise, ratio):
    """The error's ratio where loads that are data act in the step, see ``data_loads``.

    Of motions a step misses nothing: its driven velocities are what they travel over its length.
    """
    found = find_defects(plan, state, h, state.numbers[st.STEP_BEFORE], scratch.data)
    errors = scratch.error_x, scratch.error_v, scratch.own_rate, scratch.memory.own_rate
    if misses_no_load(plan, state, groups, *errors, h, rate, noise, found):
        return ratio
    push(plan, work, state, scratch.x_end, scratch.v_end, scratch.a_end, scratch.zero_multipliers, scratch.data)
    put_pushes(plan, scratch.data, scratch.correction)
    solve_factored(plan, scratch)
    lasting = (1.0, state.numbers[st.STEP_LASTING])
    return ratio_with_loads(plan, state, groups, *errors, h, rate, noise, lasting, scratch.correction)


@kernel
def _take_filtered(plan, groups, scratch):
    """Take the filtered error of velocities; of what moves a contact that touches, what the contact may let go.

    A vibration of velocity v that a step h does not resolve, of h w >> 1, is h w v in the error and v / (h w) in what
    the filter leaves: v is the mean of both.  Where the contact sets in or lets go within the step it filters nothing.
    """
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        left = scratch.correction[0, j]
        if lets_go(groups) and groups.held[k] > 0.0:
            whole = abs(scratch.error_v[k])
            left = whole if is_crossed(groups, k) else math.sqrt(whole * abs(left))
        scratch.error_v[j] = left


@kernel
def local_error(plan, work, state, groups, scratch, a_end, h, rate, noise):
    """The ratio of the step's error to the tolerance, against quadratures of its velocities and accelerations.

    ``noise``: the share of scales that Newton's iteration leaves; no shorter step makes it less.
    """
    judge_lasting(plan, work, state, groups, scratch.x_end, scratch.v_end)
    unseen = 0.0
    if lets_go(groups):
        unseen = judge_contacts(plan, work, state, groups, scratch.x_end, scratch.v_end, h)
    h1 = state.numbers[st.STEP_BEFORE]
    v_end = scratch.v_end
    for k in range(a_end.shape[0]):
        correction = h * h / 12.0 * (state.a[k] - a_end[k])
        scratch.error_x[k] = scratch.increment[k] - 0.5 * h * (state.v[k] + v_end[k]) - correction
        # the integral of the parabola through the last three accelerations
        curve = 0.0
        if h1 > 0.0:
            slope = (state.a[k] - scratch.memory.before[k]) / h1
            curve = ((a_end[k] - state.a[k]) / h - slope) / (h + h1)
        mean = 0.5 * (state.a[k] + a_end[k]) - curve * h * h / 6.0
        scratch.error_v[k] = v_end[k] - state.v[k] - h * mean
        scratch.own_rate[k] = curve
    for i in range(plan.tree.shape[0]):
        o = spin_of(plan.tree[i])
        if o >= 0:
            _add_rotation_error(scratch.increment, state.v, v_end, state.a, a_end, o, h, scratch.error_x)
    for j in range(plan.free.shape[0]):
        scratch.error_x[j] = scratch.error_x[plan.free[j]]
    _filter(plan, scratch, scratch.own_rate)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.own_rate[k] = vibration_rate(groups, k, scratch.correction[0, j])
    _filter(plan, scratch, scratch.error_v)
    _take_filtered(plan, groups, scratch)
    ratio = _ratio(plan, state, groups, scratch, h, rate, noise, (1.0, state.numbers[st.STEP_LASTING]))
    if ratio <= 1.0 and scratch.data.known[0] == 1:
        ratio = _ratio_with_loads(plan, work, state, groups, scratch, h, rate, noise, ratio)
    forget_passing(plan, state, groups, scratch.own_rate)
    return max(ratio, unseen)


@kernel
def energy_noise(plan, groups, scratch, h, rate, newton):
    """The share of speeds that keeping the energy changes by its round-off and by what Newton's iteration left of it.

    A motion that comes to rest while others go on is changed the most, by no more than such an energy sets in motion;
    no shorter step makes it less.  Where there are states, whose links count in these sums of energy, none is known.
    """
    unresolved = scratch.energy[step.UNRESOLVED]
    left = min(abs(scratch.memory.surplus[0]), newton * unresolved / ROUND_OFF)
    capacity = scratch.energy[step.CAPACITY] + 1e-300
    share = (unresolved + left) / capacity
    share = min(share, math.sqrt(2.0 * share))
    largest = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        if groups.kind[groups.of[k]] == kinds.GROUP_STATE:
            return 0.0
        moves = scratch.increment[k] / h
        part = math.sqrt(min(1.0, abs(scratch.correction_direction[k] * moves) / capacity))
        largest = max(largest, share * part * abs(moves) / st.group_speed(groups, groups.of[k], rate))
    return largest
