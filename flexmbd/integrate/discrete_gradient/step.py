"""The equations of an energy-momentum step, and the correction that keeps the energy.

The unknowns are the velocities ``u`` of the step and the multipliers of constraint rows.  The velocities
give the positions in its middle and at its end; the momenta at its end follow from p_n + p_end =
2 M(x_mid) u, and the equations ask that their change be what the discrete gradient of the energy says.
The derivation stands in docs/integrators.md, "Energy-momentum".  ``s`` is ``discrete_gradient.Scratch``.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.gradient import (
    CANONICAL,
    CLOSE,
    CONSTRAINTS,
    DEAD,
    DEFECT,
    DONE,
    ENERGY,
    LACK,
    MOMENTA,
    MOMENTUM,
    PLACE,
    POTENTIAL,
    SPLITS,
    STORED,
    WEIGH,
)
from flexmbd.integrate.discrete_gradient.momentum_balance import average_strain, balance_momenta, drop_symmetries
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, part_of_kernel
from flexmbd.multibody.kernels.base.native import solve
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, time_of_row

_EPSILON = 2.0**-52
_DEAD = 32.0 * _EPSILON  # of all energy: what sums of it do not resolve
_STILL = 1e-16  # of all energy: a motion in the middle of less than that counts as none
_ROUGH = 1e-6  # of the kinetic energy, where an iterate is far: what need not be known of it
_PASSES = 6  # of improving the velocities at the end


@entry_kernel
def kinetic_energy(p, v):
    """p . v / 2."""
    t = 0.0
    for k in range(p.shape[0]):
        t += 0.5 * p[k] * v[k]
    return t


@part_of_kernel
def _spread(plan, s, h):
    """Put velocities and multipliers where ``s.unknown`` says."""
    free = plan.free.shape[0]
    for j in range(free):
        s.u[plan.free[j]] = s.unknown[j]
    for i in range(s.nu.shape[0]):
        s.nu[i] = 2.0 / h * s.unknown[free + i]


@part_of_kernel
def _middle(plan, stored_plan, work, s, x, p, h, split):
    """Forces in the middle of the step, the momenta's balance, rows; returns what ``balance_momenta`` does."""
    _spread(plan, s, h)
    call_separate(s.kernels[PLACE], (plan, x, s, h))
    call_separate(
        s.kernels[CANONICAL],
        (plan, work, s.x_mid, s.u, s.half, s.none, s.nu, s.wrench, s.part, s.p_mid, s.force),
    )
    if split:
        call_separate(
            s.kernels[CANONICAL],
            (stored_plan, work, s.x_mid, s.u, s.half, s.none, s.nu, s.wrench, s.part, s.p_mid, s.stored),
        )
    else:
        for k in range(s.force.shape[0]):
            s.stored[k] = s.force[k]
    average_strain(plan, s, h)
    if s.nu.shape[0] > 0:
        _rows(plan, work, s, h)
    return balance_momenta(plan, p, s, h)


@part_of_kernel
def _rows(plan, work, s, h):
    """Residuals of the rows: of position at the end, over h; of velocity in the middle, which ``work`` must hold."""
    free = plan.free.shape[0]
    call_separate(s.kernels[CONSTRAINTS], (plan, work, s.phi, s.rate, s.rate2))
    for i in range(s.nu.shape[0]):
        s.equation[free + i] = s.rate[i]
    call_separate(s.kernels[MOMENTA], (plan, work, s.x_end, s.none, s.none, s.out))
    call_separate(s.kernels[CONSTRAINTS], (plan, work, s.phi, s.rate, s.rate2))
    for i in range(s.nu.shape[0]):
        row = plan.rows[i]
        if holds_position(row):
            value = s.phi[i]
            f = time_of_row(row)
            if f >= 0:
                value += work.time[f, 0] - s.row_end[i, 0]
            s.equation[free + i] = value / h


@part_of_kernel
def _missing_energy(plan, stored_plan, work, loops, number, s, gained, near):
    """What the gradient in the middle lacks of the energy's change (J); 0 where sums do not resolve it.

    Without rows the velocities at the end are improved by the factors at hand, a pass or a few each time.  The
    kinetic energy needs no better ones than their error's square is small.
    """
    kinetic = 0.0
    lack = 0.0
    if plan.rows.shape[0] > 0:
        call_separate(s.kernels[WEIGH], (plan, work, s))
        call_separate(s.kernels[POTENTIAL], (stored_plan, work, s.x_end, s.energy))
        call_separate(s.kernels[CLOSE], (plan, loops, s))
        kinetic = kinetic_energy(s.p_end, s.v_end)
    for part in range(_PASSES if plan.rows.shape[0] == 0 else 0):
        call_separate(s.kernels[MOMENTA], (plan, work, s.x_end, s.v_end, s.none, s.out))
        if part == 0:
            call_separate(s.kernels[POTENTIAL], (stored_plan, work, s.x_end, s.energy))
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            s.out[k] = s.p_end[k] - s.out[k]
            s.right[0, j] = s.out[k]
        solve(plan.lapack, s.mass, s.mass_pivot, s.sizes, s.right)
        before = lack
        lack = 0.0
        kinetic = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            kinetic += 0.5 * (s.p_end[k] + s.out[k]) * s.v_end[k]
            lack += 0.5 * s.out[k] * s.right[0, j]
            s.v_end[k] += s.right[0, j]
        kinetic += lack
        lack = abs(lack)
        if not lack > (_DEAD if near else _ROUGH) * abs(kinetic):
            break
        if part > 0 and not lack < 0.05 * before:
            call_separate(s.kernels[WEIGH], (plan, work, s))
    dead = _DEAD * (abs(kinetic) + abs(s.energy[STORED]) + abs(number[ENERGY]))
    s.energy[DEAD] = dead
    s.energy[LACK] = lack
    missing = kinetic + s.energy[STORED] - number[ENERGY] - gained
    for k in range(s.move.shape[0]):
        missing -= s.stored[k] * s.move[k]
    return missing - min(max(missing, -dead), dead)


@part_of_kernel
def _aim(plan, work, s, h):
    """Write ``s.direction``: momenta of the step's motion, but for what energy does not depend on; returns their work.

    By the mass matrix as metric every speed changes by the same share, which no soft direction makes large.
    """
    if s.plain[0] == 1:
        for k in range(s.move.shape[0]):
            s.direction[k] = s.p_mid[k]
    else:
        for k in range(s.move.shape[0]):
            s.course[k] = s.move[k] / h
        drop_symmetries(plan, s, s.course)
        call_separate(s.kernels[MOMENTA], (plan, work, s.x_mid, s.course, s.none, s.direction))
        drop_symmetries(plan, s, s.direction)
    along = 0.0
    for k in range(s.move.shape[0]):
        along += s.direction[k] * s.move[k]
    return along


@kernel
def evaluate(plan, stored_plan, work, loops, state, s, h, corrected, near):
    """Write the step's equations at ``s.unknown``, and into ``s.energy`` the work of all that does not store energy.

    ``corrected``: with what keeps the energy.  That correction goes along the step's motion, but for directions that
    energy does not depend on; it undoes the work that reactions in the middle do over the step as well.
    ``near``: whether the kinetic energy at the end should be known to round-off.
    """
    count = state.counts
    p = state.memory[MOMENTUM]
    gained = _middle(plan, stored_plan, work, s, state.x, p, h, count[SPLITS] == 1)
    count[st.EVALUATIONS] += 1
    s.energy[DONE] = 0.0
    s.energy[LACK] = 0.0
    s.energy[DEFECT] = 0.0
    if corrected:
        for k in range(s.move.shape[0]):
            s.energy[DONE] += (s.stored[k] - s.force[k]) * s.move[k]
        missing = _missing_energy(plan, stored_plan, work, loops, state.numbers, s, gained, near)
        along = _aim(plan, work, s, h)
        # at rest, where no energy is missing, there is none to compare with either
        share = missing / (along + h * _STILL / _DEAD * s.energy[DEAD]) if missing != 0.0 else 0.0
        for k in range(s.move.shape[0]):
            s.force[k] += share * s.direction[k]
            s.balance[k] += share * s.direction[k]
    for j in range(plan.free.shape[0]):
        s.equation[j] = 0.5 * h * s.balance[plan.free[j]]
    if corrected:
        defect = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            defect += abs(s.equation[j]) * (abs(s.u[k]) + abs(s.v_end[k]))
        s.energy[DEFECT] = defect * _DEAD / (s.energy[DEAD] + 1e-300)
