"""The equations of an energy-momentum step, and the correction that keeps the energy.

The unknowns are the velocities ``u`` of the step and the multipliers of constraint rows.  The velocities
give the positions in its middle and at its end; the momenta at its end follow from p_n + p_end =
2 M(x_mid) u, and the equations ask that their change be what the discrete gradient of the energy says.
The derivation stands in docs/integrators.md, "Energy-momentum".  ``scratch`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.momentum_balance import average_strain, balance_momenta, project_out_symmetries
from flexmbd.integrate.discrete_gradient.momentum_end import solve_end_mass
from flexmbd.integrate.discrete_gradient.polynomial_average import average_polynomials
from flexmbd.integrate.discrete_gradient.workspace import (
    CANONICAL,
    CAPACITY,
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
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, time_of_row

_EPSILON = 2.0**-52
ROUND_OFF = _UNRESOLVED = 32.0 * _EPSILON  # of all energy: round-off of its sums
_AT_REST = 1e-16  # of all energy: a motion in the middle of less than that counts as none
_REPAID = 1e-3  # of the corrected motion's speeds: the largest change in a step by energy that earlier steps left
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
def _unpack_unknowns(plan, scratch, h):
    """Put velocities and multipliers where ``s.unknown`` says."""
    free = plan.free.shape[0]
    for j in range(free):
        scratch.u[plan.free[j]] = scratch.unknown[j]
    for i in range(scratch.nu.shape[0]):
        scratch.nu[i] = 2.0 / h * scratch.unknown[free + i]


@kernel
def _evaluate_middle(plan, stored_plan, work, scratch, x, p, h, split):
    """Forces in the middle of the step, the momenta's balance, rows; returns what ``balance_momenta`` does."""
    _unpack_unknowns(plan, scratch, h)
    call_separate(scratch.kernels[PLACE], (plan, x, scratch, h))
    call_separate(
        scratch.kernels[CANONICAL],
        (
            plan,
            work,
            scratch.x_mid,
            scratch.u,
            scratch.half_velocity,
            scratch.zeros,
            scratch.nu,
            scratch.wrench,
            scratch.scratch6,
            scratch.p_mid,
            scratch.gradient,
        ),
    )
    if split:
        call_separate(
            scratch.kernels[CANONICAL],
            (
                stored_plan,
                work,
                scratch.x_mid,
                scratch.u,
                scratch.half_velocity,
                scratch.zeros,
                scratch.nu,
                scratch.wrench,
                scratch.scratch6,
                scratch.p_mid,
                scratch.stored_gradient,
            ),
        )
    else:
        for k in range(scratch.gradient.shape[0]):
            scratch.stored_gradient[k] = scratch.gradient[k]
    if plan.flex.shape[0] > 0:
        average_strain(plan, scratch, h)
        average_polynomials(plan, scratch)
    if scratch.nu.shape[0] > 0:
        _evaluate_rows(plan, work, scratch, h)
    return balance_momenta(plan, p, scratch, h)


@deferred_kernel()
def _evaluate_rows(plan, work, scratch, h):
    """Residuals of the rows: of position at the end, over h; of velocity in the middle, which ``work`` must hold."""
    free = plan.free.shape[0]
    call_separate(scratch.kernels[CONSTRAINTS], (plan, work, scratch.phi, scratch.phi_rate, scratch.phi_rate2))
    for i in range(scratch.nu.shape[0]):
        scratch.equation[free + i] = scratch.phi_rate[i]
    call_separate(
        scratch.kernels[MOMENTA], (plan, work, scratch.x_end, scratch.zeros, scratch.zeros, scratch.scratch_v)
    )
    call_separate(scratch.kernels[CONSTRAINTS], (plan, work, scratch.phi, scratch.phi_rate, scratch.phi_rate2))
    for i in range(scratch.nu.shape[0]):
        row = plan.rows[i]
        if holds_position(row):
            value = scratch.phi[i]
            f = time_of_row(row)
            if f >= 0:
                value += work.time[f, 0] - scratch.row_end[i, 0]
            scratch.equation[free + i] = value / h


@kernel
def _resolved(energy, unresolved):
    """What of an energy (J) is more than round-off."""
    return energy - min(max(energy, -unresolved), unresolved)


@kernel
def _missing_energy(plan, stored_plan, work, loops, scratch, gained, near, capacity):
    """The energy's change less that by the gradient in the middle, and some of what earlier steps left of it (J).

    0 where it is round-off.  The step's own part vanishes with the motion that can be corrected; what is left from
    before does not, so that no more of it is asked for than changes that motion by little.  ``capacity``: twice that
    motion's kinetic energy (J).

    Without rows the velocities at the end are improved by the factors at hand, a pass or a few each time.  The
    kinetic energy needs no better ones than their error's square is small.
    """
    kinetic = 0.0
    kinetic_error = 0.0
    if plan.rows.shape[0] > 0:
        call_separate(scratch.kernels[FACTOR_MASS], (plan, work, scratch))
        call_separate(scratch.kernels[POTENTIAL], (stored_plan, work, scratch.x_end, scratch.energy))
        call_separate(scratch.kernels[CLOSE_VELOCITIES], (plan, loops, scratch))
        kinetic = kinetic_energy(scratch.p_end, scratch.v_end)
    for part in range(_PASSES if plan.rows.shape[0] == 0 else 0):
        call_separate(
            scratch.kernels[MOMENTA], (plan, work, scratch.x_end, scratch.v_end, scratch.zeros, scratch.scratch_v)
        )
        if part == 0:
            call_separate(scratch.kernels[POTENTIAL], (stored_plan, work, scratch.x_end, scratch.energy))
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            scratch.scratch_v[k] = scratch.p_end[k] - scratch.scratch_v[k]
            scratch.mass_rhs[0, j] = scratch.scratch_v[k]
        solve_end_mass(plan, scratch)
        before = kinetic_error
        kinetic_error = 0.0
        kinetic = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            kinetic += 0.5 * (scratch.p_end[k] + scratch.scratch_v[k]) * scratch.v_end[k]
            kinetic_error += 0.5 * scratch.scratch_v[k] * scratch.mass_rhs[0, j]
            scratch.v_end[k] += scratch.mass_rhs[0, j]
        kinetic += kinetic_error
        kinetic_error = abs(kinetic_error)
        if not kinetic_error > (_UNRESOLVED if near else _ROUGH) * abs(kinetic):
            break
        if part > 0 and not kinetic_error < 0.05 * before:
            call_separate(scratch.kernels[FACTOR_MASS], (plan, work, scratch))
    unresolved = _UNRESOLVED * (abs(kinetic) + abs(scratch.energy[POTENTIAL_END]) + abs(scratch.memory.energy[0]))
    scratch.energy[UNRESOLVED] = unresolved
    scratch.energy[CAPACITY] = abs(capacity)
    scratch.energy[KINETIC_ERROR] = kinetic_error
    surplus = scratch.memory.surplus[0]
    missing = kinetic + scratch.energy[POTENTIAL_END] - (scratch.memory.energy[0] + surplus) - gained
    for k in range(scratch.increment.shape[0]):
        missing -= scratch.stored_gradient[k] * scratch.increment[k]
    most = _REPAID * abs(capacity)
    return _resolved(missing, unresolved) + min(max(_resolved(surplus, unresolved), -most), most)


@kernel
def _correction_direction(plan, work, scratch, h):
    """Write ``s.correction_direction``: momenta of the step's motion without symmetries; returns their work.

    By the mass matrix as metric every speed changes by the same share, which no soft direction makes large.
    """
    if scratch.no_symmetries[0] == 1:
        for k in range(scratch.increment.shape[0]):
            scratch.correction_direction[k] = scratch.p_mid[k]
    else:
        for k in range(scratch.increment.shape[0]):
            scratch.corrected_velocity[k] = scratch.increment[k] / h
        project_out_symmetries(plan, scratch, scratch.corrected_velocity)
        call_separate(
            scratch.kernels[MOMENTA],
            (plan, work, scratch.x_mid, scratch.corrected_velocity, scratch.zeros, scratch.correction_direction),
        )
        project_out_symmetries(plan, scratch, scratch.correction_direction)
    along = 0.0
    for k in range(scratch.increment.shape[0]):
        along += scratch.correction_direction[k] * scratch.increment[k]
    return along


@entry_kernel
def evaluate(plan, stored_plan, work, loops, state, scratch, h, corrected, near):
    """Write the step's equations at ``s.unknown``, and the work of loads and dampers into ``s.energy``.

    ``corrected``: with the correction that keeps the energy, along the step's motion but for directions that energy
    does not depend on; it undoes the work that reactions in the middle do over the step as well.
    ``near``: whether the kinetic energy at the end should be known to round-off.
    """
    count = state.counts
    p = scratch.memory.momentum
    gained = _evaluate_middle(plan, stored_plan, work, scratch, state.x, p, h, scratch.memory.nonconservative[0] == 1)
    count[st.EVALUATIONS] += 1
    scratch.energy[TRIAL_WORK] = 0.0
    scratch.energy[KINETIC_ERROR] = 0.0
    scratch.energy[DEFECT] = 0.0
    scratch.energy[CAPACITY] = np.inf
    if corrected:
        for k in range(scratch.increment.shape[0]):
            scratch.energy[TRIAL_WORK] += (scratch.stored_gradient[k] - scratch.gradient[k]) * scratch.increment[k]
        along = _correction_direction(plan, work, scratch, h)
        missing = _missing_energy(plan, stored_plan, work, loops, scratch, gained, near, along / h)
        # at rest, where no energy is missing, there is none to compare with either
        share = missing / (along + h * _AT_REST / _UNRESOLVED * scratch.energy[UNRESOLVED]) if missing != 0.0 else 0.0
        for k in range(scratch.increment.shape[0]):
            scratch.gradient[k] += share * scratch.correction_direction[k]
            scratch.balance[k] += share * scratch.correction_direction[k]
    for j in range(plan.free.shape[0]):
        scratch.equation[j] = 0.5 * h * scratch.balance[plan.free[j]]
    if corrected:
        defect = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            defect += abs(scratch.equation[j]) * (abs(scratch.u[k]) + abs(scratch.v_end[k]))
        scratch.energy[DEFECT] = defect * _UNRESOLVED / (scratch.energy[UNRESOLVED] + 1e-300)
