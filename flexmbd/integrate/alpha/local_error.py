"""The ratio of a generalized-alpha step's local error to the tolerance."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.matrix import solve_factored
from flexmbd.integrate.alpha.step import ROUND_OFF
from flexmbd.integrate.data_loads import SAMPLED, STRAIGHT, find_defects, push, put_pushes
from flexmbd.integrate.filtered_error import filtered_ratio, missed_impulse, vibration_rate, without_loads
from flexmbd.integrate.lasting import forget_passing, judge_lasting
from flexmbd.multibody.kernels.algebra.rank_revealing import solve_semidefinite
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.base.native import solve
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.plan_entries import is_augmented


@kernel
def _difference(plan, state, s, h):
    """Local error of position and velocity on the free coordinates, and the accelerations' curvature.

    Against the integral of the parabola through the last three true accelerations, which is one
    order better.
    """
    h_before = state.numbers[st.STEP_BEFORE]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        a0 = state.a[k]
        a1 = s.a[k]
        curve = 0.0
        if s.memory.known_steps[0] > 0:
            curve = ((a1 - a0) / h - (a0 - s.memory.before[k]) / h_before) / (h + h_before)
        speed = h * 0.5 * (a0 + a1) - h**3 / 6.0 * curve
        travel = h * h * (a0 / 3.0 + a1 / 6.0) - h**4 / 12.0 * curve
        s.error_x[j] = (s.displacement[k] - h * state.v[k]) - travel
        s.error_v[0, j] = (s.v[k] - state.v[k]) - speed
        s.curve[j] = curve


@kernel
def _filter(plan, work, state, s):
    """Filter the velocity error by the tree's iteration matrix, as Radau codes do.

    Vibrations that the method damps on purpose are not resolved.  The residual is linear in the
    accelerations and vanishes at the step's own, so it gives M times the error; the error is
    scaled up to the accelerations' size first, above the round-off of the sum.
    """
    nu = plan.free.shape[0]
    blown = 1.0
    largest = 0.0
    for j in range(nu):
        blown = max(blown, abs(s.a[plan.free[j]]))
        largest = max(largest, abs(s.error_v[0, j]))
    blown /= largest + 1e-300
    for k in range(s.probe_acceleration.shape[0]):
        s.probe_acceleration[k] = s.a[k]
    for j in range(nu):
        s.probe_acceleration[plan.free[j]] += blown * s.error_v[0, j]
    residual(plan, work, s.x, s.v, s.probe_acceleration, s.multipliers, s.residual)
    state.counts[st.EVALUATIONS] += 1
    for j in range(nu):
        s.error_v[0, j] = s.residual[plan.free[j]] / blown
    if plan.rows.shape[0] > 0:
        solve(plan.lapack, s.tree_matrix, s.tree_pivot, s.sizes, s.error_v)
    else:
        solve_factored(plan, s, s.error_v)


@kernel
def _remove_across_rows(plan, state, s, vector):
    """Remove from a vector (free,) what reactions of the rows would make: rows hold positions and velocities there."""
    for i in range(plan.rows.shape[0]):
        s.phi[i] = 0.0
        for j in range(plan.free.shape[0]):
            s.phi[i] += s.tangent.jacobian[i, plan.free[j]] * vector[j]
    solve_semidefinite(
        s.row_factors, s.row_rank[0], s.row_order, s.memory.row_length, s.phi, s.phi_rate, s.phi_rate2
    )
    for j in range(plan.free.shape[0]):
        vector[j] -= st.reaction_acceleration(s.shift_direction, s.phi_rate2, j)


@kernel
def _holds_velocities(plan):
    """Whether no row is an augmented Lagrangian's, which closes positions or velocities, not both."""
    for i in range(plan.rows.shape[0]):
        if is_augmented(plan.rows[i]):
            return False
    return True


@kernel
def _ratio(plan, state, groups, s, h, machine_rate, leniency):
    rates = s.memory.own_rate
    noise = ROUND_OFF / s.least_pivot[0]
    return filtered_ratio(
        plan, state, groups, s.error_x, s.error_v[0], s.own_rate, rates, h, machine_rate, noise, leniency
    )


@deferred_kernel(NUMBER)
def _ratio_with_loads(plan, work, state, groups, s, h, machine_rate, ratio):
    """The error's ratio where data act in the step, see ``data_loads``."""
    h_before = state.numbers[st.STEP_BEFORE] if s.memory.known_steps[0] > 0 else 0.0
    found = find_defects(plan, state, h, h_before, s.data)
    if found == STRAIGHT:
        return ratio
    if found == SAMPLED and _ratio(plan, state, groups, s, h, machine_rate, 0.0) <= 1.0:
        for k in range(s.own_rate.shape[0]):
            s.own_rate[k] = 0.0  # nothing asks whether it vibrates
        return ratio
    push(plan, work, state, s.x, s.v, s.a, s.multipliers, s.data)
    put_pushes(plan, s.data, s.correction)
    solve_factored(plan, s, s.correction)
    without_loads(plan, groups, s.own_rate, s.correction, h)
    seen = _ratio(plan, state, groups, s, h, machine_rate, 1.0)
    missed_impulse(plan, s.correction, h, s.error_x, s.error_v[0])
    return max(seen, _ratio(plan, state, groups, s, h, machine_rate, 0.0))


@kernel
def _put_own_rates(plan, groups, s):
    """Each coordinate's own rate, the frequency of a vibration with that curvature."""
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        s.own_rate[k] = vibration_rate(groups, k, s.curve[j])


@deferred_kernel(NUMBER)
def _across_rows(plan, state, groups, s, h, machine_rate):
    """The ratio of the whole error, its part across the rows included, at most 1; leaves the error along the loops.

    Rows hold positions and velocities, and accelerations and reactions swing about theirs.  What those swing by is of
    the step's order, so the steps after it get shorter; but a shorter step would not take away what the steps before
    have left, so it rejects none.  Where an augmented Lagrangian closes rows by their positions, velocities swing too,
    and never cease.
    """
    largest = 0.0
    if _holds_velocities(plan):
        largest = min(1.0, _ratio(plan, state, groups, s, h, machine_rate, 1.0))
    _remove_across_rows(plan, state, s, s.error_x)
    _remove_across_rows(plan, state, s, s.error_v[0])
    _remove_across_rows(plan, state, s, s.curve)
    _put_own_rates(plan, groups, s)
    return largest


@kernel
def local_error(plan, work, state, groups, s, h, machine_rate):
    """Largest ratio of the local error to the tolerance, see ``filtered_ratio``."""
    judge_lasting(plan, work, state, groups, s.x, s.v)
    _difference(plan, state, s, h)
    if s.memory.filters[0] == 1:
        _filter(plan, work, state, s)
    _put_own_rates(plan, groups, s)
    across = 0.0
    if plan.rows.shape[0] > 0:
        across = _across_rows(plan, state, groups, s, h, machine_rate)
    along = _ratio(plan, state, groups, s, h, machine_rate, 1.0)
    if along <= 1.0 and s.data.known[0] == 1:
        along = _ratio_with_loads(plan, work, state, groups, s, h, machine_rate, along)
    forget_passing(plan, state, groups, s.own_rate)
    return max(across, along)
