"""The equations of an energy-momentum step, and the correction that keeps the energy.

The unknowns are the velocities ``u`` of the step and the multipliers of constraint rows.  The velocities
give the positions in its middle and at its end; the momenta at its end follow from p_n + p_end =
2 M(x_mid) u, and the equations ask that their change be what the discrete gradient of the energy says.
The derivation stands in docs/integrators.md, "Energy-momentum".  ``s`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.momentum_balance import average_strain, balance_momenta, project_out_symmetries
from flexmbd.integrate.discrete_gradient.workspace import (
    CANONICAL,
    CLOSE_VELOCITIES,
    CONSTRAINTS,
    DEFECT,
    FACTOR_MASS,
    KINETIC_ERROR,
    MOMENTA,
    PLACE,
    POTENTIAL,
    POTENTIAL_END,
    TRIAL_WORK,
    UNRESOLVED,
)
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, separate_kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.native import solve
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, time_of_row

_EPSILON = 2.0**-52
_UNRESOLVED = 32.0 * _EPSILON  # of all energy: round-off of its sums
_AT_REST = 1e-16  # of all energy: a motion in the middle of less than that counts as none
_ROUGH = 1e-6  # of the kinetic energy: its tolerance where an iterate is far
_PASSES = 6  # of improving the velocities at the end


@entry_kernel
def kinetic_energy(p, v):
    """p . v / 2."""
    t = 0.0
    for k in range(p.shape[0]):
        t += 0.5 * p[k] * v[k]
    return t


@kernel
def _unpack_unknowns(plan, s, h):
    """Put velocities and multipliers where ``s.unknown`` says."""
    free = plan.free.shape[0]
    for j in range(free):
        s.u[plan.free[j]] = s.unknown[j]
    for i in range(s.nu.shape[0]):
        s.nu[i] = 2.0 / h * s.unknown[free + i]


@kernel
def _evaluate_middle(plan, stored_plan, work, s, x, p, h, split):
    """Forces in the middle of the step, the momenta's balance, rows; returns what ``balance_momenta`` does."""
    _unpack_unknowns(plan, s, h)
    call_separate(s.kernels[PLACE], (plan, x, s, h))
    call_separate(
        s.kernels[CANONICAL],
        (plan, work, s.x_mid, s.u, s.half_velocity, s.zeros, s.nu, s.wrench, s.scratch6, s.p_mid, s.gradient),
    )
    if split:
        call_separate(
            s.kernels[CANONICAL],
            (
                stored_plan, work, s.x_mid, s.u, s.half_velocity, s.zeros, s.nu, s.wrench, s.scratch6, s.p_mid,
                s.stored_gradient,
            ),
        )
    else:
        for k in range(s.gradient.shape[0]):
            s.stored_gradient[k] = s.gradient[k]
    if plan.flex.shape[0] > 0:
        average_strain(plan, s, h)
    if s.nu.shape[0] > 0:
        _evaluate_rows(plan, work, s, h)
    return balance_momenta(plan, p, s, h)


@deferred_kernel()
def _evaluate_rows(plan, work, s, h):
    """Residuals of the rows: of position at the end, over h; of velocity in the middle, which ``work`` must hold."""
    free = plan.free.shape[0]
    call_separate(s.kernels[CONSTRAINTS], (plan, work, s.phi, s.phi_rate, s.phi_rate2))
    for i in range(s.nu.shape[0]):
        s.equation[free + i] = s.phi_rate[i]
    call_separate(s.kernels[MOMENTA], (plan, work, s.x_end, s.zeros, s.zeros, s.scratch_v))
    call_separate(s.kernels[CONSTRAINTS], (plan, work, s.phi, s.phi_rate, s.phi_rate2))
    for i in range(s.nu.shape[0]):
        row = plan.rows[i]
        if holds_position(row):
            value = s.phi[i]
            f = time_of_row(row)
            if f >= 0:
                value += work.time[f, 0] - s.row_end[i, 0]
            s.equation[free + i] = value / h


@kernel
def _missing_energy(plan, stored_plan, work, loops, number, s, gained, near):
    """The energy's change less that by the gradient in the middle (J); 0 where it is round-off.

    Without rows the velocities at the end are improved by the factors at hand, a pass or a few each time.  The
    kinetic energy needs no better ones than their error's square is small.
    """
    kinetic = 0.0
    kinetic_error = 0.0
    if plan.rows.shape[0] > 0:
        call_separate(s.kernels[FACTOR_MASS], (plan, work, s))
        call_separate(s.kernels[POTENTIAL], (stored_plan, work, s.x_end, s.energy))
        call_separate(s.kernels[CLOSE_VELOCITIES], (plan, loops, s))
        kinetic = kinetic_energy(s.p_end, s.v_end)
    for part in range(_PASSES if plan.rows.shape[0] == 0 else 0):
        call_separate(s.kernels[MOMENTA], (plan, work, s.x_end, s.v_end, s.zeros, s.scratch_v))
        if part == 0:
            call_separate(s.kernels[POTENTIAL], (stored_plan, work, s.x_end, s.energy))
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            s.scratch_v[k] = s.p_end[k] - s.scratch_v[k]
            s.mass_rhs[0, j] = s.scratch_v[k]
        solve(plan.lapack, s.mass, s.mass_pivot, s.sizes, s.mass_rhs)
        before = kinetic_error
        kinetic_error = 0.0
        kinetic = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            kinetic += 0.5 * (s.p_end[k] + s.scratch_v[k]) * s.v_end[k]
            kinetic_error += 0.5 * s.scratch_v[k] * s.mass_rhs[0, j]
            s.v_end[k] += s.mass_rhs[0, j]
        kinetic += kinetic_error
        kinetic_error = abs(kinetic_error)
        if not kinetic_error > (_UNRESOLVED if near else _ROUGH) * abs(kinetic):
            break
        if part > 0 and not kinetic_error < 0.05 * before:
            call_separate(s.kernels[FACTOR_MASS], (plan, work, s))
    unresolved = _UNRESOLVED * (abs(kinetic) + abs(s.energy[POTENTIAL_END]) + abs(s.memory.energy[0]))
    s.energy[UNRESOLVED] = unresolved
    s.energy[KINETIC_ERROR] = kinetic_error
    missing = kinetic + s.energy[POTENTIAL_END] - s.memory.energy[0] - gained
    for k in range(s.increment.shape[0]):
        missing -= s.stored_gradient[k] * s.increment[k]
    return missing - min(max(missing, -unresolved), unresolved)


@kernel
def _correction_direction(plan, work, s, h):
    """Write ``s.correction_direction``: momenta of the step's motion without symmetries; returns their work.

    By the mass matrix as metric every speed changes by the same share, which no soft direction makes large.
    """
    if s.no_symmetries[0] == 1:
        for k in range(s.increment.shape[0]):
            s.correction_direction[k] = s.p_mid[k]
    else:
        for k in range(s.increment.shape[0]):
            s.corrected_velocity[k] = s.increment[k] / h
        project_out_symmetries(plan, s, s.corrected_velocity)
        call_separate(s.kernels[MOMENTA], (plan, work, s.x_mid, s.corrected_velocity, s.zeros, s.correction_direction))
        project_out_symmetries(plan, s, s.correction_direction)
    along = 0.0
    for k in range(s.increment.shape[0]):
        along += s.correction_direction[k] * s.increment[k]
    return along


@separate_kernel
def evaluate(plan, stored_plan, work, loops, state, s, h, corrected, near):
    """Write the step's equations at ``s.unknown``, and the work of loads and dampers into ``s.energy``.

    ``corrected``: with the correction that keeps the energy, along the step's motion but for directions that energy
    does not depend on; it undoes the work that reactions in the middle do over the step as well.
    ``near``: whether the kinetic energy at the end should be known to round-off.
    """
    count = state.counts
    p = s.memory.momentum
    gained = _evaluate_middle(plan, stored_plan, work, s, state.x, p, h, s.memory.nonconservative[0] == 1)
    count[st.EVALUATIONS] += 1
    s.energy[TRIAL_WORK] = 0.0
    s.energy[KINETIC_ERROR] = 0.0
    s.energy[DEFECT] = 0.0
    if corrected:
        for k in range(s.increment.shape[0]):
            s.energy[TRIAL_WORK] += (s.stored_gradient[k] - s.gradient[k]) * s.increment[k]
        missing = _missing_energy(plan, stored_plan, work, loops, state.numbers, s, gained, near)
        along = _correction_direction(plan, work, s, h)
        # at rest, where no energy is missing, there is none to compare with either
        share = missing / (along + h * _AT_REST / _UNRESOLVED * s.energy[UNRESOLVED]) if missing != 0.0 else 0.0
        for k in range(s.increment.shape[0]):
            s.gradient[k] += share * s.correction_direction[k]
            s.balance[k] += share * s.correction_direction[k]
    for j in range(plan.free.shape[0]):
        s.equation[j] = 0.5 * h * s.balance[plan.free[j]]
    if corrected:
        defect = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            defect += abs(s.equation[j]) * (abs(s.u[k]) + abs(s.v_end[k]))
        s.energy[DEFECT] = defect * _UNRESOLVED / (s.energy[UNRESOLVED] + 1e-300)
