"""One step of the energy-momentum method: its equations, their linearisation, Newton's iteration.

The unknowns are the velocities ``u`` of the step and the multipliers of constraint rows.  The velocities
give the positions in its middle and at its end; the momenta at its end follow from p_n + p_end =
2 M(x_mid) u, and the equations ask that their change be what the discrete gradient of the energy says.
The derivation stands in docs/integrators.md, "Energy-momentum".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import loop_dynamics
from flexmbd.integrate import state as st
from flexmbd.integrate.loop_dynamics import accelerate, respond
from flexmbd.integrate.momentum_balance import balance_momenta, place, settle_momenta, weigh
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.articulated import articulate, solve_mass
from flexmbd.multibody.kernels.canonical import canonical, momenta, potential_energy
from flexmbd.multibody.kernels.closure import constraints
from flexmbd.multibody.kernels.compiling import entry_kernel, kernel, part_of_kernel
from flexmbd.multibody.kernels.layout import Plan
from flexmbd.multibody.kernels.native import factor, solve
from flexmbd.multibody.kernels.recursion import forward

FloatArray = NDArray[np.float64]

# The method's entries of State.numbers: the step the factors belong to; the energy (J) that belongs to TIME; what
# loads and dampers did to it in the step.
STEP_FACTORED, ENERGY, WORK = range(st.METHOD, st.METHOD + 3)
# Its entries of State.counts: steps without growth left; whether the energy is kept; whether anything but what
# stores it acts.
HOLD, KEEPS_ENERGY, SPLITS = range(st.METHOD_COUNT, st.METHOD_COUNT + 3)
# Rows of State.memory after those of ``loop_dynamics``: momenta; accelerations at the step before.
MOMENTUM, BEFORE, N_MEMORY = range(loop_dynamics.N_MEMORY, loop_dynamics.N_MEMORY + 3)

_MAX_ITERATIONS = 25
_MANY = 6  # more iterations than this renew the factors at the next step
_EPSILON = 2.0**-52
_ROUND_OFF = 1e-10  # corrections above this are none of round-off
_DEAD = 32.0 * _EPSILON  # of all energy: what sums of it do not resolve
_STILL = 1e-8  # a motion below this share of a step's at the machine's rate counts as none


class Scratch(NamedTuple):
    """Work arrays of a step.

    u, half, none: (nv,) velocity of the step, half of it, zeros.  move: (nv,) increments over the step; of
    rotations twice the tangent of half the angle, along the axis.  x_mid, x_end: (nx,).
    p_mid, p_end: (nv,) momenta M(x_mid) u, and at the end.  v_end, right: (1, nv).  a_end: (nv,).
    force, stored: (nv,) -dT/dx + dV/dx - loads in the middle, and without loads and dampers.
    weight: (2 bodies + nv, 9) where the energy's correction may act: a matrix for the linear and one for the
    turning part of each joint, and a number for each coordinate (first column, from row 2 bodies).
    weighed: (nv,) that times the increments.
    nu, phi, rate, rate2: (m,) multipliers of the step; residuals of the constraint rows and their derivatives.
    row_end: (m, 2) what prescribes a row and its rate, at the end.  nu_end: (m,) multipliers there.
    unknown, equation: (free + m,) u and nu h / 2; the step's equations times h / 2, and residuals over h.
    """

    u: FloatArray
    half: FloatArray
    none: FloatArray
    move: FloatArray
    x_mid: FloatArray
    x_end: FloatArray
    p_mid: FloatArray
    p_end: FloatArray
    v_end: FloatArray
    a_end: FloatArray
    right: FloatArray
    force: FloatArray
    stored: FloatArray
    balance: FloatArray
    wrench: FloatArray
    part: FloatArray
    weight: FloatArray
    weighed: FloatArray
    nu: FloatArray
    phi: FloatArray
    rate: FloatArray
    rate2: FloatArray
    row_end: FloatArray
    nu_end: FloatArray
    unknown: FloatArray
    equation: FloatArray
    probe: FloatArray
    matrix: FloatArray
    correction: FloatArray
    mixed: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    driven: FloatArray
    driving: FloatArray
    pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]


def new_scratch(plan: Plan, nx: int, nv: int, weight: FloatArray) -> Scratch:
    """Allocate the work arrays of a step for ``plan``."""
    zeros = np.zeros
    free, bodies, m = len(plan.free), len(plan.tree), len(plan.rows)
    n = free + m
    return Scratch(
        u=zeros(nv),
        half=zeros(nv),
        none=zeros(nv),
        move=zeros(nv),
        x_mid=zeros(nx),
        x_end=zeros(nx),
        p_mid=zeros(nv),
        p_end=zeros(nv),
        v_end=zeros((1, nv)),
        a_end=zeros(nv),
        right=zeros((1, nv)),
        force=zeros(nv),
        stored=zeros(nv),
        balance=zeros(nv),
        wrench=zeros((bodies, 6)),
        part=zeros(6),
        weight=weight,
        weighed=zeros(nv),
        nu=zeros(m),
        phi=zeros(m),
        rate=zeros(m),
        rate2=zeros(m),
        row_end=zeros((m, 2)),
        nu_end=zeros(m),
        unknown=zeros(n),
        equation=zeros(n),
        probe=zeros(n),
        matrix=zeros((n, n)),
        correction=zeros((1, n)),
        mixed=zeros((2, n)),
        scale_x=zeros(nv),
        scale_v=zeros(nv),
        error_x=zeros(nv),
        error_v=zeros(nv),
        driven=zeros((len(plan.driven), 3)),
        driving=zeros(nv),
        pivot=zeros(max(1, n), np.int32),
        sizes=zeros(4, np.int32),
    )


@kernel
def factor_end(plan, work, aw, loops, s):
    """Factor the mass matrix, and that of the loops, at ``s.x_end``; accelerations and multipliers by ``s.v_end``."""
    accelerate(plan, work, aw, loops, s.x_end, s.v_end[0], s.a_end, s.nu_end)


@kernel
def _velocities(plan, work, aw, loops, s):
    """Write ``s.v_end``: the prescribed rates, and others so that M v = p in their rows, but for what loops forbid.

    That part leaves ``s.p_end`` as well.
    """
    p = s.p_end
    if plan.rows.shape[0] > 0:
        factor_end(plan, work, aw, loops, s)
    else:
        articulate(plan, work, aw, s.x_end)
    for k in range(p.shape[0]):
        s.right[0, k] = p[k]
    if plan.driven.shape[0] > 0:
        for i in range(plan.driven.shape[0]):
            s.driving[plan.driven[i, at.DRIVEN_V]] = s.driven[i, 1]
        momenta(plan, work, s.x_end, s.driving, s.none, s.right[0])
        for k in range(p.shape[0]):
            s.right[0, k] = p[k] - s.right[0, k]
    solve_mass(plan, work, aw, s.right, s.v_end)
    for i in range(plan.driven.shape[0]):
        s.v_end[0, plan.driven[i, at.DRIVEN_V]] = s.driven[i, 1]
    m = plan.rows.shape[0]
    if m == 0:
        return
    for i in range(m):
        loops.phi[i] = -s.row_end[i, 1]
        for k in range(p.shape[0]):
            loops.phi[i] += loops.paths.jacobian[i, k] * s.v_end[0, k]
    respond(plan, work, aw, loops, loops.rank[0], loops.phi, loops.move)
    for k in range(p.shape[0]):
        s.v_end[0, k] -= loops.move[k]
        for i in range(m):
            p[k] -= loops.paths.jacobian[i, k] * loops.solution[i]


@entry_kernel
def kinetic_energy(p, v):
    """p . v / 2."""
    t = 0.0
    for k in range(p.shape[0]):
        t += 0.5 * p[k] * v[k]
    return t


@part_of_kernel
def _missing_energy(plan, stored_plan, work, aw, loops, number, s, gained):
    """What the gradient in the middle lacks of the energy's change (J); 0 where sums do not resolve it."""
    _velocities(plan, work, aw, loops, s)
    forward(plan, work, s.x_end, s.none, s.none)
    kinetic = kinetic_energy(s.p_end, s.v_end[0])
    potential = potential_energy(stored_plan, work, s.x_end)
    missing = kinetic + potential - number[ENERGY] - gained
    for k in range(s.move.shape[0]):
        missing -= s.stored[k] * s.move[k]
    dead = _DEAD * (abs(kinetic) + abs(potential) + abs(number[ENERGY]))
    return missing - min(max(missing, -dead), dead)


@kernel
def _spread(plan, s, h, unknown):
    """Put velocities and multipliers where ``unknown`` says."""
    free = plan.free.shape[0]
    for j in range(free):
        s.u[plan.free[j]] = unknown[j]
    for i in range(s.nu.shape[0]):
        s.nu[i] = 2.0 / h * unknown[free + i]


@kernel
def _middle(plan, stored_plan, work, s, x, p, h, split):
    """Forces in the middle of the step, the momenta's balance, rows; returns what ``balance_momenta`` does."""
    _spread(plan, s, h, s.unknown)
    place(plan, x, s, h)
    canonical(plan, work, s.x_mid, s.u, s.half, s.none, s.nu, s.wrench, s.part, s.p_mid, s.force)
    if split:
        canonical(stored_plan, work, s.x_mid, s.u, s.half, s.none, s.nu, s.wrench, s.part, s.p_mid, s.stored)
    else:
        for k in range(s.force.shape[0]):
            s.stored[k] = s.force[k]
    if s.nu.shape[0] > 0:
        _rows(plan, work, s, h)
    return balance_momenta(plan, p, s, h)


@kernel
def _rows(plan, work, s, h):
    """Residuals of the rows: of position at the end, over h; of velocity in the middle, which ``work`` must hold."""
    free = plan.free.shape[0]
    constraints(plan, work, s.phi, s.rate, s.rate2)
    for i in range(s.nu.shape[0]):
        s.equation[free + i] = s.rate[i]
    forward(plan, work, s.x_end, s.none, s.none)
    constraints(plan, work, s.phi, s.rate, s.rate2)
    for i in range(s.nu.shape[0]):
        row = plan.rows[i]
        if row[at.ROW_LEVEL] == at.LEVEL_POSITION:
            residual = s.phi[i]
            if row[at.ROW_TIME] >= 0:
                residual += work.time[row[at.ROW_TIME], 0] - s.row_end[i, 0]
            s.equation[free + i] = residual / h


@part_of_kernel
def evaluate(plan, stored_plan, work, aw, loops, state, s, h, still):
    """Evaluate the step's equations at ``s.unknown``; returns the work (J) of all that does not store energy.

    The energy's correction goes along the step's motion, but for directions that energy does not depend on; it
    undoes the work that reactions in the middle do over the step as well.
    ``still`` is a motion, in the machine's sizes, that counts as none.
    """
    count = state.counts
    p = state.memory[MOMENTUM]
    gained = _middle(plan, stored_plan, work, s, state.x, p, h, count[SPLITS] == 1)
    count[st.EVALUATIONS] += 1
    done = 0.0
    if count[KEEPS_ENERGY] == 1:
        for k in range(s.move.shape[0]):
            done += (s.stored[k] - s.force[k]) * s.move[k]
        missing = _missing_energy(plan, stored_plan, work, aw, loops, state.numbers, s, gained)
        weigh(plan, s, s.weighed)
        size = still * still
        for k in range(s.move.shape[0]):
            size += s.weighed[k] * s.move[k]
        for k in range(s.move.shape[0]):
            correction = missing / size * s.weighed[k]
            s.force[k] += correction
            s.balance[k] += correction
    for j in range(plan.free.shape[0]):
        s.equation[j] = 0.5 * h * s.balance[plan.free[j]]
    return done


@part_of_kernel
def _linearise(plan, stored_plan, work, state, groups, s, h):
    """Build and factor the iteration matrix at ``s.unknown`` by differences, without the energy's correction."""
    number = state.numbers
    free = plan.free
    p = state.memory[MOMENTUM]
    state.counts[st.FACTORISATIONS] += 1
    number[STEP_FACTORED] = h
    n = s.unknown.shape[0]
    for column in range(-1, n):
        kept = s.unknown[column] if column >= 0 else 0.0
        delta = 1.0 + abs(kept)
        if column < 0:
            delta = 0.0
        elif column < free.shape[0]:
            delta = 1e-5 * groups.floor[groups.of[free[column]]] / h
        if column >= 0:
            s.unknown[column] = kept + delta
        _middle(plan, stored_plan, work, s, state.x, p, h, False)
        for i in range(n):
            value = 0.5 * h * s.balance[free[i]] if i < free.shape[0] else s.equation[i]
            if column < 0:
                s.probe[i] = value
            else:
                s.matrix[i, column] = (value - s.probe[i]) / delta
        if column >= 0:
            s.unknown[column] = kept
    for i in range(n):
        for j in range(n):
            if not np.isfinite(s.matrix[i, j]):
                return False
    return factor(plan.lapack, s.matrix, s.pivot, s.sizes) == 0


@part_of_kernel
def _improve(plan, s, iteration):
    """Move ``s.unknown`` by the correction, mixed with the one before so that their difference tells least.

    Anderson's acceleration of depth one: the iteration matrix lacks the energy's correction, which is of
    rank one but for small terms.
    """
    share = 0.0
    if iteration > 0:
        along = 0.0
        size = 0.0
        for j in range(plan.free.shape[0]):
            weight = 1.0 / (s.scale_v[plan.free[j]] * s.scale_v[plan.free[j]])
            change = s.correction[0, j] - s.mixed[1, j]
            along += weight * s.correction[0, j] * change
            size += weight * change * change
        if size > 0.0 and abs(along) < size:
            share = along / size
    for j in range(s.unknown.shape[0]):
        u = s.unknown[j]
        d = s.correction[0, j]
        s.unknown[j] = u - d - share * ((u - s.mixed[0, j]) - (d - s.mixed[1, j]))
        s.mixed[0, j] = u
        s.mixed[1, j] = d


@part_of_kernel
def _newton(plan, stored_plan, work, aw, loops, state, s, h, still, tolerance):
    """Iterate with the factors at hand until ``s`` holds a solution.

    Returns 1 if converged, 0 if too slow, -1 if not finite.
    """
    number = state.numbers
    least = np.inf
    stuck = 0
    for iteration in range(_MAX_ITERATIONS):
        number[WORK] = evaluate(plan, stored_plan, work, aw, loops, state, s, h, still)
        state.counts[st.ITERATIONS] += 1
        for i in range(s.equation.shape[0]):
            s.correction[0, i] = s.equation[i]
        solve(plan.lapack, s.matrix, s.pivot, s.sizes, s.correction)
        size = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            move = abs(s.correction[0, j])
            part = max(move * h / s.scale_x[k], move / s.scale_v[k])
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
        if not np.isfinite(size):
            return -1
        stuck = stuck + 1 if size > 0.5 * least else 0
        least = min(least, size)
        # round-off is reached where small corrections shrink no more
        if size <= tolerance or (stuck > 2 and size <= _ROUND_OFF):
            if iteration > _MANY:
                number[STEP_FACTORED] = 0.0
            return 1
        if stuck > 3:
            return 0
        _improve(plan, s, iteration)
    return 0


@part_of_kernel
def _guess(plan, state, s, h, share):
    """First guess: velocities a share of the step on, multipliers as they were; and prescribed velocities."""
    free = plan.free.shape[0]
    for j in range(free):
        k = plan.free[j]
        s.unknown[j] = state.v[k] + share * h * state.a[k]
    for i in range(s.nu.shape[0]):
        s.unknown[free + i] = 0.5 * h * state.multipliers[i]
    for i in range(plan.driven.shape[0]):
        row = plan.driven[i]
        s.u[row[at.DRIVEN_V]] = (s.driven[i, 0] - state.x[row[at.DRIVEN_X]]) / h


@kernel
def solve_step(plan, stored_plan, work, aw, loops, state, groups, s, h, rate, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    ``work.time`` must hold the middle of the step, ``s.driven`` its end.  Returns whether it converged; if so
    ``s`` holds the step's end, momenta settled and velocities in ``s.v_end``.
    """
    still = _STILL * min(1.0, h * rate)
    for attempt in range(5):
        if attempt == 0 and state.numbers[STEP_FACTORED] != h:
            continue
        # attempts 2 and 4 linearise where the iterations led; 3 for vibrations that the step does not resolve
        if attempt != 2 and attempt != 4:
            _guess(plan, state, s, h, 0.5 if attempt < 2 else 0.0)
        finite = True
        for j in range(s.unknown.shape[0]):
            finite = finite and np.isfinite(s.unknown[j])
        if not finite or (attempt > 0 and not _linearise(plan, stored_plan, work, state, groups, s, h)):
            continue
        if _newton(plan, stored_plan, work, aw, loops, state, s, h, still, tolerance) == 1:
            settle_momenta(plan, state.memory[MOMENTUM], s, h)
            _velocities(plan, work, aw, loops, s)
            return True
    state.numbers[STEP_FACTORED] = 0.0
    return False
