"""Newton's iteration for an energy-momentum step: the analytic matrix, round-off's floor, mixing, first guesses.

The matrix is the tangent's at the middle of the step: with a = 0 its parts are those of the canonical equations but
for h/2 dM/dt, which M(x_end) - M(x_mid) takes out.  ``s`` is ``discrete_gradient.Scratch``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.gradient import (
    CLOSE,
    DEAD,
    DEFECT,
    DEPTH,
    DONE,
    EVALUATE,
    KEEPS_ENERGY,
    KNOWN,
    LACK,
    LINEARISE,
    MOMENTUM,
    PLACE,
    REACTION,
    REMEMBERED,
    RESIDUAL,
    SINGULAR,
    SPEED,
    STEP_FACTORED,
    TANGENT,
    WAY,
    WEIGH,
    WORK,
    Scratch,
)
from flexmbd.integrate.discrete_gradient.momentum_balance import place, settle_momenta, vary_average_strain
from flexmbd.integrate.discrete_gradient.momentum_end import close_velocities, weigh_end
from flexmbd.integrate.discrete_gradient.step import evaluate
from flexmbd.integrate.explicit.loop_dynamics import Loops
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.multibody.kernels.base.separate import address_of, call_separate
from flexmbd.multibody.kernels.reading.plan_entries import driven_place, holds_position, modes_of
from flexmbd.multibody.kernels.tangent.residual_tangent import turn_columns

_MAX_ITERATIONS = 20
_MANY = 5  # more iterations than this renew the factors at the next step
_STARTS = 4  # first guesses
# Ways to foretell a step's velocities: none; those at its start, changed by half a step's acceleration; the last
# step's, changed by a step's acceleration, not at all, and on a line or a parabola.
REST, ACCELERATED, LEAP, SAME, LINE, PARABOLA = range(6)
_RENEWALS = 4  # of the matrix, from one first guess
_FAR = 1e-3  # larger corrections than this are far from a solution
_NEAR = 1e-6  # after a smaller one the next iterate may be the last
_SLOW = 0.1  # what two iterations leave at most, with old factors
_LEADING = 1.0  # with new ones
_EPSILON = 2.0**-52
_SIGNS = 4  # patterns of signs that probe what round-off makes of a correction
_WHOLE_FLOOR = 8.0  # times what they show


@part_of_kernel
def _put_matrix(plan, work, s, h):
    """Fill the iteration matrix at ``s.unknown``, and factor the mass matrix at the end that it leads to."""
    free = plan.free
    n = free.shape[0]
    m = plan.rows.shape[0]
    tw = s.tangent
    call_separate(s.kernels[RESIDUAL], (plan, work, s.x_mid, s.u, s.none, s.nu, s.out))
    call_separate(
        s.kernels[TANGENT],
        (plan, work, tw, s.x_mid, s.u, s.none, s.nu, 0.25 * h * h, 0.5 * h, 2.0, s.full),
    )
    vary_average_strain(plan, s, h)
    for i in range(n):
        for j in range(n):
            s.matrix[i, j] = s.full[free[i], free[j]]
        for k in range(m):
            s.matrix[i, n + k] = tw.jacobian[k, free[i]]
    for k in range(m):
        for j in range(n):
            s.matrix[n + k, j] = 2.0 / h * tw.rate_jacobian[k, free[j]]
        for j in range(m):
            s.matrix[n + k, n + j] = 0.0
    call_separate(s.kernels[WEIGH], (plan, work, s))
    for i in range(n):
        for j in range(n):
            s.matrix[i, j] -= s.full[free[i], free[j]]
    if m > 0:
        turn_columns(plan, s.move, tw.jacobian)
    for k in range(m):
        if holds_position(plan.rows[k]):
            for j in range(n):
                s.matrix[n + k, j] = tw.jacobian[k, free[j]]


@kernel
def _measure(free, scale_x, scale_v, correction, h, counts):
    """The largest of the corrections over the machine's sizes and speeds; not finite where one is not."""
    size = 0.0
    for j in range(free.shape[0]):
        k = free[j]
        move = abs(correction[0, j])
        part = max(move * h / scale_x[k], move / scale_v[k])
        if not part <= size:
            size = part
            counts[st.WORST] = k
    return size


@part_of_kernel
def _stiff_forces(plan, groups, s, h):
    """Write into ``s.bend`` the forces of the stiffness that the matrix holds: of deformations, and of whole sizes."""
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        s.bend[0, k] = 4.0 / (h * h) * abs(s.matrix[j, j] - s.full[k, k])
        s.bend[1, k] = groups.full[groups.of[k]]
    for i in range(plan.tree.shape[0]):
        n, qx, qv = modes_of(plan.tree[i], plan.flex)
        for k in range(n):
            s.bend[1, qv + k] = abs(s.x_mid[qx + k])
    for k in range(s.none.shape[0]):
        s.bend[0, k] *= s.bend[1, k]


@part_of_kernel
def _probe_round_off(plan, state, groups, s, h):
    """Write ``s.floor``: the size of the corrections that rounding of the summed terms causes.

    Terms: momenta, of which neighbours may cancel, as large as |p_k| <= (M_kk p.v)^(1/2); what `_stiff_forces` left;
    reactions; in rows, over the step, the lengths or angles that a residual is a difference of, however little the row
    moves with a coordinate, and what the rounding of the coordinates themselves adds.
    """
    n = plan.free.shape[0]
    p = state.memory[MOMENTUM]
    energy = 0.0
    for k in range(p.shape[0]):
        energy += p[k] * state.v[k]
    s.floor[0] = 0.0
    for pattern in range(_SIGNS):
        for i in range(s.unknown.shape[0]):
            size = 0.0
            if i < n:
                k = plan.free[i]
                size = 2.0 * np.sqrt(abs(s.full[k, k] * energy)) + 0.5 * h * s.bend[0, k]
                for j in range(s.nu.shape[0]):
                    size += abs(s.tangent.jacobian[j, k] * s.unknown[n + j])
            else:
                if holds_position(plan.rows[i - n]):
                    size = s.row_size[i - n] / h
                for j in range(n):
                    k = plan.free[j]
                    size += abs(s.tangent.jacobian[i - n, k]) * groups.full[groups.of[k]] / h
            # signs without a pattern: bits of multiples of the golden ratio
            odd = int((i + 1) * (2 * pattern + 1) * 0.6180339887498949 * 16.0) % 2
            s.correction[0, i] = _EPSILON * (size if odd == 1 else -size)
        solve(plan.lapack, s.matrix, s.pivot, s.sizes, s.correction)
        size = _measure(plan.free, s.scale_x, s.scale_v, s.correction, h, state.counts)
        s.floor[0] = max(s.floor[0], _WHOLE_FLOOR * size)


@kernel
def linearise(plan, work, state, groups, s, h):
    """Build and factor the iteration matrix at ``s.unknown``; ``s.energy[SINGULAR]`` tells of failure."""
    free = plan.free.shape[0]
    state.counts[st.FACTORISATIONS] += 1
    state.numbers[STEP_FACTORED] = h
    for j in range(free):
        s.u[plan.free[j]] = s.unknown[j]
    for i in range(s.nu.shape[0]):
        s.nu[i] = 2.0 / h * s.unknown[free + i]
    call_separate(s.kernels[PLACE], (plan, state.x, s, h))
    _put_matrix(plan, work, s, h)
    regular = s.energy[SINGULAR] == 0.0
    for i in range(s.unknown.shape[0]):
        for j in range(s.unknown.shape[0]):
            regular = regular and np.isfinite(s.matrix[i, j])
    s.energy[SINGULAR] = 1.0
    _stiff_forces(plan, groups, s, h)
    if regular and factor(plan.lapack, s.matrix, s.pivot, s.sizes) == 0:
        s.energy[SINGULAR] = 0.0
        _probe_round_off(plan, state, groups, s, h)


@kernel
def _dot(free, scale, a, b):
    """Product of two corrections of the velocities, over the machine's speeds."""
    total = 0.0
    for j in range(free.shape[0]):
        size = scale[free[j]]
        total += a[j] * b[j] / (size * size)
    return total


@part_of_kernel
def _improve(plan, s, iteration, kept):
    """Move ``s.unknown`` by the correction, mixed with those before so that their differences tell least.

    Anderson's acceleration (1965), by orthogonal differences: what the matrix lacks, the energy's correction above
    all, is of low rank.  Returns how many differences are kept.
    """
    n = s.unknown.shape[0]
    if iteration > 0 and kept < DEPTH:
        for j in range(n):
            s.mixed[kept, j] = s.correction[0, j] - s.before[1, j]
            s.gained[kept, j] = s.unknown[j] - s.before[0, j] - s.mixed[kept, j]
        whole = _dot(plan.free, s.scale_v, s.mixed[kept], s.mixed[kept])
        for i in range(kept):
            share = _dot(plan.free, s.scale_v, s.mixed[i], s.mixed[kept])
            for j in range(n):
                s.mixed[kept, j] -= share * s.mixed[i, j]
                s.gained[kept, j] -= share * s.gained[i, j]
        left = _dot(plan.free, s.scale_v, s.mixed[kept], s.mixed[kept])
        if left > 1e-8 * whole and left > 0.0:
            over = 1.0 / np.sqrt(left)
            for j in range(n):
                s.mixed[kept, j] *= over
                s.gained[kept, j] *= over
            kept += 1
    for j in range(n):
        s.before[0, j] = s.unknown[j]
        s.before[1, j] = s.correction[0, j]
        s.unknown[j] -= s.correction[0, j]
    for i in range(kept):
        share = _dot(plan.free, s.scale_v, s.mixed[i], s.before[1])
        for j in range(n):
            s.unknown[j] -= share * s.gained[i, j]
    return kept


@part_of_kernel
def _newton(plan, stored_plan, work, loops, state, s, h, tolerance, trusted, old):
    """Iterate with the factors at hand until ``s`` holds a solution.

    Far from it, unless the first guess is ``trusted``, the energy's correction is left out: it would lead astray.
    ``old``: the factors are those of an earlier step, and given up sooner.
    Returns 1 if converged, 0 if too slow, 2 if that near a solution, -1 if not finite.
    """
    number = state.numbers
    keeps = state.counts[KEEPS_ENERGY] == 1
    corrected = keeps and trusted
    before = np.inf
    earlier = np.inf
    kept = 0
    first = 0  # iteration with these equations
    for iteration in range(_MAX_ITERATIONS):
        near = before <= _NEAR
        call_separate(
            s.kernels[EVALUATE], (plan, stored_plan, work, loops, state, s, h, corrected, near)
        )
        number[WORK] = s.energy[DONE]
        state.counts[st.ITERATIONS] += 1
        for i in range(s.equation.shape[0]):
            s.correction[0, i] = s.equation[i]
        solve(plan.lapack, s.matrix, s.pivot, s.sizes, s.correction)
        size = _measure(plan.free, s.scale_x, s.scale_v, s.correction, h, state.counts)
        if not np.isfinite(size):
            return -1
        # where rounding is reached corrections shrink no more
        solved = size <= tolerance and s.energy[DEFECT] <= tolerance
        if solved or (size <= max(s.floor[0], tolerance) and size > 0.25 * before):
            if corrected == keeps and s.energy[LACK] <= s.energy[DEAD]:
                if iteration > _MANY:
                    number[STEP_FACTORED] = 0.0
                return 1
        elif iteration > first + 1 and size > s.floor[0] and size > (_SLOW if old else _LEADING) * earlier:
            return 2 if size <= _FAR else 0
        earlier = before
        before = size
        kept = _improve(plan, s, iteration - first, kept)
        if keeps and not corrected and size <= _FAR:
            corrected = True
            kept = 0
            first = iteration + 1
            before = np.inf
    return 2 if before <= _FAR else 0


@kernel
def _foretell(state, k, h, way):
    """Velocity k of the step to come in one of the ways named above."""
    memory = state.memory
    if way == REST:
        return 0.0
    if way == ACCELERATED:
        return state.v[k] + 0.5 * h * state.a[k]
    guess = memory[SPEED, k]
    if way == LEAP:
        return guess + h * state.a[k]
    if way == LINE or way == PARABOLA:
        guess += memory[SPEED, k] - memory[SPEED + 1, k]
    if way == PARABOLA:
        guess += memory[SPEED, k] - 2.0 * memory[SPEED + 1, k] + memory[SPEED + 2, k]
    return guess


@part_of_kernel
def _guess(plan, state, s, h, start):
    """First guess: the way that would have foretold the last step best, then in turn those for unresolved vibrations.

    Returns whether it is one to trust.
    """
    free = plan.free.shape[0]
    known = state.counts[KNOWN]
    equal = known > 0 and state.numbers[st.STEP_BEFORE] == h
    way = ACCELERATED
    if start == 0 and equal:
        way = state.counts[WAY]
    elif start == 1 and known > 0:
        way = SAME
    elif start == 3:
        way = REST
    for j in range(free):
        s.unknown[j] = _foretell(state, plan.free[j], h, way)
    for i in range(s.nu.shape[0]):
        nu = state.multipliers[i]
        if start == 0 and equal and known > 2:
            memory = state.memory
            nu = 3.0 * (memory[REACTION, i] - memory[REACTION + 1, i]) + memory[REACTION + 2, i]
        s.unknown[free + i] = 0.5 * h * nu
    for i in range(plan.driven.shape[0]):
        in_x, in_v = driven_place(plan.driven[i])
        s.u[in_v] = (s.driven[i, 0] - state.x[in_x]) / h
    for k in range(s.v_end.shape[0]):
        s.v_end[k] = state.v[k]
    for j in range(free):
        k = plan.free[j]
        s.v_end[k] = 2.0 * s.unknown[j] - state.v[k]
    return start == 0 and equal


@part_of_kernel
def remember(plan, state, s, h):
    """Keep the step's velocities and multipliers as the latest, and which way would have foretold them best.

    Those of steps of another length are forgotten.  ``state`` must still be the step's start.
    """
    memory = state.memory
    count = state.counts
    if state.numbers[st.STEP_BEFORE] != h:
        count[KNOWN] = 0
    least = np.inf
    for way in range(ACCELERATED, SAME + count[KNOWN] if count[KNOWN] > 0 else LEAP):
        error = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            part = (_foretell(state, k, h, way) - s.u[k]) / s.scale_v[k]
            error += part * part
        if error < least:
            least = error
            count[WAY] = way
    count[KNOWN] = min(REMEMBERED, count[KNOWN] + 1)
    for row in range(REMEMBERED - 1, 0, -1):
        for k in range(s.u.shape[0]):
            memory[SPEED + row, k] = memory[SPEED + row - 1, k]
        for i in range(s.nu.shape[0]):
            memory[REACTION + row, i] = memory[REACTION + row - 1, i]
    for k in range(s.u.shape[0]):
        memory[SPEED, k] = s.u[k]
    for i in range(s.nu.shape[0]):
        memory[REACTION, i] = s.nu[i]


@part_of_kernel
def solve_step(plan, stored_plan, work, loops, state, groups, s, h, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    ``work.time`` must hold the middle of the step, ``s.driven`` its end.  Returns whether it converged; if so
    ``s`` holds the step's end, momenta settled and velocities in ``s.v_end``.
    """
    for start in range(_STARTS):
        trusted = _guess(plan, state, s, h, start)
        for renewal in range(_RENEWALS):
            old = start == 0 and renewal == 0 and state.numbers[STEP_FACTORED] == h
            if not old:
                call_separate(s.kernels[LINEARISE], (plan, work, state, groups, s, h))
                if s.energy[SINGULAR] != 0.0:
                    state.counts[st.OUTCOME] = st.RANK_LOST
                    break
            outcome = _newton(plan, stored_plan, work, loops, state, s, h, tolerance, trusted, old)
            if outcome == 1:
                settle_momenta(plan, state.memory[MOMENTUM], s, h)
                call_separate(s.kernels[WEIGH], (plan, work, s))
                call_separate(s.kernels[CLOSE], (plan, loops, s))
                return s.energy[SINGULAR] == 0.0
            if plan.flag[0] != 0:
                return False
            if old:
                trusted = _guess(plan, state, s, h, start)
            elif outcome < 0:
                break
            else:
                trusted = outcome == 2
    state.numbers[STEP_FACTORED] = 0.0
    return False


def bind(
    plan: Plan, stored_plan: Plan, work: Work, loops: Loops, state: st.State, groups: st.Groups, s: Scratch
) -> None:
    """Compile the parts of a step and write their addresses into ``s.kernels``."""
    s.kernels[PLACE] = address_of(place, (plan, state.x, s, 1.0))
    s.kernels[WEIGH] = address_of(weigh_end, (plan, work, s))
    s.kernels[CLOSE] = address_of(close_velocities, (plan, loops, s))
    s.kernels[EVALUATE] = address_of(evaluate, (plan, stored_plan, work, loops, state, s, 1.0, True, True))
    s.kernels[LINEARISE] = address_of(linearise, (plan, work, state, groups, s, 1.0))
