"""The ratio of a generalized-alpha step's local error to the tolerance."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.matrix import solve_factored
from flexmbd.integrate.alpha.sparse_loops import is_sparse, remove_across_sparse, solve_tree_sparse
from flexmbd.integrate.data_loads import find_defects, push, put_pushes
from flexmbd.integrate.filtered_error import filtered_ratio, misses_no_load, ratio_with_loads, vibration_rate
from flexmbd.integrate.lasting import forget_passing, judge_contacts, judge_lasting, lets_go
from flexmbd.multibody.kernels.algebra.rank_revealing import solve_block
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, TUPLE2, deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.plan_entries import is_augmented
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, solve_blocks
from flexmbd.round_off import ROUND_OFF

_SWINGING = (1.0, 1.0)  # across rows all swings, with the steps


@kernel
def _difference(plan, state, scratch, h):
    """Local error of position and velocity on the free coordinates, and the accelerations' curvature.

    Against the integral of the parabola through the last three true accelerations, which is one
    order better.
    """
    h_before = state.numbers[st.STEP_BEFORE]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        a0 = state.a[k]
        a1 = scratch.a[k]
        curve = 0.0
        if scratch.memory.known_steps[0] > 0:
            curve = ((a1 - a0) / h - (a0 - scratch.memory.before[k]) / h_before) / (h + h_before)
        speed = h * 0.5 * (a0 + a1) - h**3 / 6.0 * curve
        travel = h * h * (a0 / 3.0 + a1 / 6.0) - h**4 / 12.0 * curve
        scratch.error_x[j] = (scratch.displacement[k] - h * state.v[k]) - travel
        scratch.error_v[0, j] = (scratch.v[k] - state.v[k]) - speed
        scratch.curve[j] = curve


@kernel
def _filter(plan, work, state, scratch):
    """Filter the velocity error by the tree's iteration matrix, as Radau codes do.

    Vibrations that the method damps on purpose are not resolved.  The residual is linear in the
    accelerations and vanishes at the step's own, so it gives M times the error; the error is
    scaled up to the accelerations' size first, above the round-off of the sum.
    """
    nu = plan.free.shape[0]
    blown = 1.0
    largest = 0.0
    for j in range(nu):
        blown = max(blown, abs(scratch.a[plan.free[j]]))
        largest = max(largest, abs(scratch.error_v[0, j]))
    blown /= largest + 1e-300
    for k in range(scratch.probe_acceleration.shape[0]):
        scratch.probe_acceleration[k] = scratch.a[k]
    for j in range(nu):
        scratch.probe_acceleration[plan.free[j]] += blown * scratch.error_v[0, j]
    residual(plan, work, scratch.x, scratch.v, scratch.probe_acceleration, scratch.multipliers, scratch.residual)
    state.counts[st.EVALUATIONS] += 1
    for j in range(nu):
        scratch.error_v[0, j] = scratch.residual[plan.free[j]] / blown
    if plan.rows.shape[0] > 0:
        _solve_tree(plan, scratch)
    else:
        solve_factored(plan, scratch, scratch.error_v)


@deferred_kernel()
def _solve_tree(plan, scratch):
    """Solve with the tree's iteration matrix for ``s.error_v``, in place."""
    if is_sparse(scratch):
        solve_tree_sparse(plan, scratch, scratch.error_v)
        return
    free = scratch.tangent.blocks.free
    solve_blocks(plan.lapack, scratch.tree_matrix, free, scratch.tree_pivot, scratch.sizes, scratch.error_v)


@kernel
def _remove_across_rows(plan, state, scratch, vector):
    """Remove from a vector (free,) what reactions of the rows would make: rows hold positions and velocities there."""
    if is_sparse(scratch):
        remove_across_sparse(plan, scratch, vector)
        return
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        above, below = between(blocks.rows, c)
        for i in range(above, below):
            scratch.phi[i] = 0.0
            for j in range(first, last):
                scratch.phi[i] += scratch.tangent.jacobian[i, plan.free[j]] * vector[j]
        solve_block(
            scratch.row_factors,
            above,
            below,
            scratch.row_rank[c],
            scratch.row_order,
            scratch.memory.row_length,
            scratch.phi,
            scratch.phi_rate,
            scratch.phi_rate2,
        )
        for j in range(first, last):
            vector[j] -= st.reaction_acceleration(scratch.shift_direction, scratch.phi_rate2, j, above, below)


@kernel
def _holds_velocities(plan):
    """Whether no row is an augmented Lagrangian's, which closes positions or velocities, not both."""
    for i in range(plan.rows.shape[0]):
        if is_augmented(plan.rows[i]):
            return False
    return True


@kernel
def _ratio(plan, state, groups, scratch, h, machine_rate, lasting):
    """The ratio of the error at hand, see ``filtered_ratio``."""
    rates = scratch.memory.own_rate
    noise = ROUND_OFF / scratch.least_pivot[0]
    return filtered_ratio(
        plan,
        state,
        groups,
        scratch.error_x,
        scratch.error_v[0],
        scratch.own_rate,
        rates,
        h,
        machine_rate,
        noise,
        lasting,
    )


@deferred_kernel(NUMBER)
def _ratio_with_loads(plan, work, state, groups, scratch, h, machine_rate, ratio):
    """The error's ratio where data act in the step, see ``data_loads``."""
    h_before = state.numbers[st.STEP_BEFORE] if scratch.memory.known_steps[0] > 0 else 0.0
    found = find_defects(plan, state, h, h_before, scratch.data)
    errors = scratch.error_x, scratch.error_v[0], scratch.own_rate, scratch.memory.own_rate
    noise = ROUND_OFF / scratch.least_pivot[0]
    if misses_no_load(plan, state, groups, *errors, h, machine_rate, noise, found):
        return ratio
    push(plan, work, state, scratch.x, scratch.v, scratch.a, scratch.multipliers, scratch.data)
    put_pushes(plan, scratch.data, scratch.correction)
    solve_factored(plan, scratch, scratch.correction)
    lasting = (1.0, state.numbers[st.STEP_LASTING])
    return ratio_with_loads(plan, state, groups, *errors, h, machine_rate, noise, lasting, scratch.correction)


@kernel
def _put_own_rates(plan, groups, scratch):
    """Each coordinate's own rate, the frequency of a vibration with that curvature."""
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.own_rate[k] = vibration_rate(groups, k, scratch.curve[j])


@deferred_kernel(TUPLE2)
def _across_rows(plan, state, groups, scratch, h, machine_rate):
    """Ratios of the whole error, its part across the rows included; leaves the error along the loops.

    The first, at most 1, takes what swings for what it is, the second for an error as others are.
    Rows hold positions and velocities, and accelerations and reactions swing about theirs.  What those swing by is of
    the step's order, so the steps after it get shorter; but a shorter step would not take away what the steps before
    have left, so it rejects none.  Where an augmented Lagrangian closes rows by their positions, velocities swing too,
    and never cease.
    """
    whole = _ratio(plan, state, groups, scratch, h, machine_rate, (1.0, state.numbers[st.STEP_LASTING]))
    swing = 0.0
    if _holds_velocities(plan):
        swing = whole
        if state.numbers[st.STEP_LASTING] < 1.0:
            swing = _ratio(plan, state, groups, scratch, h, machine_rate, _SWINGING)
        swing = min(1.0, swing)
    _remove_across_rows(plan, state, scratch, scratch.error_x)
    _remove_across_rows(plan, state, scratch, scratch.error_v[0])
    _remove_across_rows(plan, state, scratch, scratch.curve)
    _put_own_rates(plan, groups, scratch)
    return swing, whole


@kernel
def local_error(plan, work, state, groups, scratch, h, machine_rate):
    """Largest ratio of the local error to the tolerance, see ``filtered_ratio``."""
    judge_lasting(plan, work, state, groups, scratch.x, scratch.v)
    unseen = 0.0
    if lets_go(groups):
        unseen = judge_contacts(plan, work, state, groups, scratch.x, scratch.v, h)
    _difference(plan, state, scratch, h)
    if scratch.memory.filters[0] == 1:
        _filter(plan, work, state, scratch)
    _put_own_rates(plan, groups, scratch)
    swing = 0.0
    whole = 0.0
    if plan.rows.shape[0] > 0:
        swing, whole = _across_rows(plan, state, groups, scratch, h, machine_rate)
    along = _ratio(plan, state, groups, scratch, h, machine_rate, (1.0, state.numbers[st.STEP_LASTING]))
    if along <= 1.0 and scratch.data.known[0] == 1:
        along = _ratio_with_loads(plan, work, state, groups, scratch, h, machine_rate, along)
    forget_passing(plan, state, groups, scratch.own_rate)
    # rows turn within the step, so that of a swing across them a part seems to lie along
    return max(unseen, swing, along - whole * min(1.0, h * machine_rate))
