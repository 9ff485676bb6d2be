"""A stage of an implicit step by a ``relation``: its equations, the predictor, Newton's iteration.

The unknowns are the new accelerations, the multipliers, and shifts of the positions along the
loops' reactions, which close the loops at position level while velocities fulfil them too.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.matrix import linearise, solve_factored
from flexmbd.integrate.alpha.relation import A
from flexmbd.integrate.alpha.sparse_loops import is_sparse, shift_positions, sizes_of_correction
from flexmbd.integrate.alpha.workspace import coefficients, holds_position_alone, is_unshifted
from flexmbd.integrate.newton_control import (
    CONVERGED,
    NOT_FINITE,
    TOO_SLOW,
    contraction_to_remember,
    count_solved_step,
    expected_contraction,
    give_up_old_factors,
    judge,
    remaining_error,
)
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.changing_stiffness import stiffness_change, take_stiffness
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.plan_entries import augmented_stiffness, is_augmented
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between
from flexmbd.round_off import ROUND_OFF

_MAX_ITERATIONS = 10
_FORETOLD = 4  # the first iteration by which those to come are judged: new factors cost as much as several
_RENEW = 0.15  # a slower contraction than this renews the factors at the next step


@kernel
def update_end(plan, work, state, scratch, h, unknown):
    """Put x, v, a of the stage's end where ``unknown`` = (new a, multipliers, shifts) says."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    known = scratch.relation.known
    per_x, per_v = coefficients(scratch.memory.scheme, h)
    for k in range(scratch.displacement.shape[0]):
        scratch.displacement[k] = 0.0
    for j in range(nu):
        k = plan.free[j]
        new = unknown[j]
        scratch.a[k] = new
        scratch.displacement[k] = known[0, k] + per_x * new
        scratch.v[k] = known[1, k] + per_v * new
    if m > 0 and is_sparse(scratch):
        for i in range(m):
            scratch.multipliers[i] = unknown[nu + i]
        shift_positions(plan, scratch, unknown[nu + m :], per_x, scratch.displacement)
        retract(plan, state.x, scratch.displacement, scratch.x)
        drive(plan, work, scratch.x, scratch.v, scratch.a)
        return
    blocks = scratch.tangent.blocks
    free, displacement, direction = plan.free, scratch.displacement, scratch.shift_direction
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for i in range(*between(blocks.rows, c)):
            scratch.multipliers[i] = unknown[nu + i]
            shift = per_x * unknown[nu + m + i]
            for j in range(first, last):
                displacement[free[j]] += shift * direction[i, j]
    retract(plan, state.x, scratch.displacement, scratch.x)
    drive(plan, work, scratch.x, scratch.v, scratch.a)


@kernel
def evaluate_step(plan, work, state, scratch, h, unknown, equation):
    """Evaluate the step's equations at ``unknown``."""
    nu = plan.free.shape[0]
    update_end(plan, work, state, scratch, h, unknown)
    residual(plan, work, scratch.x, scratch.v, scratch.a, scratch.multipliers, scratch.residual)
    state.counts[st.EVALUATIONS] += 1
    for j in range(nu):
        equation[j] = scratch.residual[plan.free[j]]
    if plan.rows.shape[0] > 0:
        _evaluate_rows(plan, work, state, scratch, h, unknown, equation)


@deferred_kernel()
def _evaluate_rows(plan, work, state, scratch, h, unknown, equation):
    """The equations of the rows; ``work`` must hold the motion."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    per_x, per_v = coefficients(scratch.memory.scheme, h)
    constraints(plan, work, scratch.phi, scratch.phi_rate, scratch.phi_rate2)
    for i in range(m):
        if is_unshifted(plan, scratch, i):
            equation[nu + i] = unknown[nu + m + i]
        else:
            equation[nu + i] = scratch.phi[i] / per_x
        equation[nu + m + i] = scratch.phi_rate[i] / per_v
        if holds_position_alone(plan, scratch, i):
            equation[nu + m + i] = scratch.phi[i] / per_x
        if is_augmented(plan.rows[i]):
            # the reaction is that of the pass before and of stiffness and damping
            k, c = augmented_stiffness(plan.data, plan.rows[i])
            gap = scratch.known_reaction[i] + k * scratch.phi[i] + c * scratch.phi_rate[i] - unknown[nu + i]
            equation[nu + m + i] = gap / (k * per_x + c * per_v)


@kernel
def correct(plan, state, scratch, h):
    """Add Newton's correction with the factors at hand to ``s.unknown``; its largest parts over the scales.

    Returns the motion's and, where there are loops, that of the forces out of balance (``state.pushed``).
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    per_x, per_v = coefficients(scratch.memory.scheme, h)
    for i in range(scratch.equation.shape[0]):
        scratch.correction[0, i] = scratch.equation[i]
    solve_factored(plan, scratch, scratch.correction)
    size = 0.0
    imbalance = 0.0
    for i in range(scratch.unknown.shape[0]):
        scratch.unknown[i] -= scratch.correction[0, i]
    if m > 0 and is_sparse(scratch):
        return sizes_of_correction(plan, state, scratch, per_x, per_v)
    reactions = scratch.correction[0, nu : nu + m]
    correction, direction = scratch.correction[0], scratch.shift_direction
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        above, below = between(blocks.rows, c)
        for j in range(*between(blocks.free, c)):
            k = plan.free[j]
            move = correction[j]
            part = max(abs(move) * per_x / scratch.scale_x[k], abs(move) * per_v / scratch.scale_v[k])
            if below > above:
                pushed = st.reaction_acceleration(direction, reactions, j, above, below)
                imbalance = max(imbalance, abs(move + pushed) * per_v / scratch.scale_v[k])
            for i in range(above, below):
                shift = correction[nu + m + i] * direction[i, j]
                part = max(part, abs(shift) * per_x / scratch.scale_x[k])
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
    return size, imbalance


@kernel
def _linearise(plan, work, state, scratch, h):
    """Factor the iteration matrix where the step was evaluated last; False, with the outcome, if it is singular."""
    if scratch.tangent_stiffness.shape[0] > 0:
        take_stiffness(plan, work, scratch.scale_x, scratch.x, scratch.v, scratch.tangent_stiffness)
    if not linearise(plan, work, state, scratch, h):
        state.counts[st.OUTCOME] = st.RANK_LOST
        return False
    return True


@kernel
def _doubt(plan, work, scratch):
    """The least error that old factors leave in their first iteration, over the correction.

    Near singular positions they lose their worth within a step; those that hold a contact which the machine has left
    correct next to nothing, however much is wrong.
    """
    doubt = 1.0 if plan.rows.shape[0] > 0 else 0.0
    if scratch.tangent_stiffness.shape[0] > 0:
        change = stiffness_change(plan, work, scratch.scale_x, scratch.x, scratch.v, scratch.tangent_stiffness)
        doubt = max(doubt, remaining_error(change))
    return doubt


@kernel
def _newton(plan, work, state, scratch, h, tolerance, evaluated, last, full):
    """Iterate with the factors at hand until they have converged; a verdict of ``newton_control``.

    ``evaluated``: ``s.equation`` is that of the first guess.  ``last``: round-off that stalls it ends it.
    ``full``: with new factors at each iteration, whose first corrections may grow.
    """
    before = 0.0
    imbalance_before = 0.0
    contraction = expected_contraction(scratch.memory.contraction[0])
    for iteration in range(_MAX_ITERATIONS):
        if iteration > 0 or not evaluated:
            evaluate_step(plan, work, state, scratch, h, scratch.unknown, scratch.equation)
        if full and iteration > 0 and not _linearise(plan, work, state, scratch, h):
            return NOT_FINITE
        state.counts[st.ITERATIONS] += 1
        size, imbalance = correct(plan, state, scratch, h)
        left = _MAX_ITERATIONS - 1.0 - iteration if iteration >= _FORETOLD else np.inf
        # where rows are nearly dependent, round-off moves positions, and velocities by the rows' slopes
        noise = ROUND_OFF / scratch.least_pivot[0] if last else 0.0
        doubt = _doubt(plan, work, scratch) if iteration == 0 else 0.0
        verdict, contraction = judge(size, before, contraction, doubt, tolerance, noise, left)
        if plan.rows.shape[0] > 0:
            verdict = min(verdict, judge(imbalance, imbalance_before, 0.5, 1.0, tolerance, noise, left)[0])
        if verdict == CONVERGED:
            update_end(plan, work, state, scratch, h, scratch.unknown)
            scratch.memory.contraction[0] = contraction_to_remember(contraction, iteration + 1)
            if iteration > 0 and (full or contraction > _RENEW):
                scratch.memory.step_factored[0] = 0.0
            return CONVERGED
        if verdict == NOT_FINITE or (verdict == TOO_SLOW and not full):
            return verdict
        before = size
        imbalance_before = imbalance
    return TOO_SLOW


@kernel
def _extrapolate(h1, h2, h, now, before, earlier):
    """Predictor: the next value on the parabola through the last three, steps h1 and h2 apart."""
    slope = (now - before) / h1
    half_curve = (slope - (before - earlier) / h2) / (h1 + h2)
    return now + h * (slope + (h + h1) * half_curve)


@kernel
def _predict_equal_steps(node, now, before, earlier, earliest):
    """Predictor after equal steps: of constant, line and parabola the one that was best for the last value.

    Where a step does not resolve a vibration that is the constant.  ``node``: how far ahead, in steps.
    """
    first = now - before
    second = first - (before - earlier)
    third = second - (before - 2.0 * earlier + earliest)
    guess = now
    if abs(second) < abs(first):
        guess += node * first
        if abs(third) < abs(second):
            guess += 0.5 * node * (node + 1.0) * second
    return guess


@kernel
def predict(plan, state, scratch, h, extrapolate):
    """Predictor of accelerations and multipliers: the last ones, or extrapolated if ``extrapolate``."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    memory, relation = scratch.memory, scratch.relation
    if relation.stage[0] > 0:
        _predict_stage(plan, state, scratch, h, extrapolate)
        return
    known = memory.known_steps[0]
    fixed = state.counts[st.FIXED_STEP] == 1
    h1, h2 = state.numbers[st.STEP_BEFORE], memory.step_earlier[0]
    node = relation.nodes[0]
    follows = extrapolate and known > 1 and not fixed
    for j in range(nu):
        k = plan.free[j]
        scratch.unknown[j] = state.a[k]
        if follows:
            scratch.unknown[j] = _extrapolate(h1, h2, node * h, state.a[k], memory.before[k], memory.earlier[k])
        elif extrapolate and known > 2 and fixed:
            before, earlier = memory.before[k], memory.earlier[k]
            scratch.unknown[j] = _predict_equal_steps(node, state.a[k], before, earlier, memory.earliest[k])
    for i in range(m):
        now = state.multipliers[i]
        before, earlier = memory.reactions_before[i], memory.reactions_earlier[i]
        scratch.unknown[nu + i] = now
        if follows:
            scratch.unknown[nu + i] = _extrapolate(h1, h2, node * h, now, before, earlier)
        elif extrapolate and known > 2 and fixed:
            scratch.unknown[nu + i] = _predict_equal_steps(node, now, before, earlier, memory.reactions_earliest[i])
        scratch.unknown[nu + m + i] = 0.0


@deferred_kernel()
def _predict_stage(plan, state, scratch, h, extrapolate):
    """Predictor of a stage after the first: that of the stage before, or extrapolated if ``extrapolate``.

    By the stage before and the ends of the last two steps.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    memory, relation = scratch.memory, scratch.relation
    i = relation.stage[0]
    passed = relation.nodes[i - 1] * h
    ahead = relation.nodes[i] * h - passed
    follows = extrapolate and passed > 0.0 and ahead > 0.0 and memory.known_steps[0] > 0
    before = state.numbers[st.STEP_BEFORE]
    for j in range(nu):
        k = plan.free[j]
        now = relation.points[i - 1, A, k]
        scratch.unknown[j] = now
        if follows:
            scratch.unknown[j] = _extrapolate(passed, before, ahead, now, state.a[k], memory.before[k])
    for r in range(m):
        now = relation.reactions[i - 1, r]
        scratch.unknown[nu + r] = now
        if follows:
            start, earlier = state.multipliers[r], memory.reactions_before[r]
            scratch.unknown[nu + r] = _extrapolate(passed, before, ahead, now, start, earlier)
        scratch.unknown[nu + m + r] = 0.0


@kernel
def solve_step(plan, work, state, scratch, h, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    Returns whether it converged; if so ``scratch`` holds the step's end.
    """
    renew = scratch.memory.renewals[0] > 0
    for attempt in range(3):
        full = attempt == 2 and state.counts[st.FIXED_STEP] == 1
        if attempt == 0:
            if renew or scratch.memory.step_factored[0] != h:
                continue
            predict(plan, state, scratch, h, True)
        elif attempt == 1:
            predict(plan, state, scratch, h, renew)
        elif full:
            predict(plan, state, scratch, h, False)
        finite = True
        for i in range(scratch.unknown.shape[0]):
            finite = finite and np.isfinite(scratch.unknown[i])
        if not finite:
            break
        # the second time linearised where the first iterations led; a step that is given, and cannot be made
        # shorter, is begun anew with Newton's full iteration, which converges from farther away
        if attempt > 0:
            evaluate_step(plan, work, state, scratch, h, scratch.unknown, scratch.equation)
            if not _linearise(plan, work, state, scratch, h):
                break
        evaluated = attempt > 0 and plan.rows.shape[0] == 0
        if _newton(plan, work, state, scratch, h, tolerance, evaluated, attempt == 2, full) == CONVERGED:
            count_solved_step(scratch.memory, renew, attempt == 0)
            return True
        if attempt == 0:
            give_up_old_factors(scratch.memory, 0)
    scratch.memory.step_factored[0] = 0.0
    return False
