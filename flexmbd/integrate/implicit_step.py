"""One implicit step of generalized-alpha: its equations, their linearisation, Newton's iteration.

The unknowns are the new accelerations, the multipliers, and shifts of the positions along the
loops' reactions, which close the loops at position level while velocities fulfil them too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.closure import constraints
from flexmbd.multibody.kernels.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Plan, Work
from flexmbd.multibody.kernels.native import factor, solve
from flexmbd.multibody.kernels.residual import drive, residual
from flexmbd.multibody.kernels.separate import address_of, call_separate
from flexmbd.multibody.kernels.tangent import tangent_after_residual, turn_columns
from flexmbd.multibody.kernels.tangent_layout import TangentWork, new_tangent_work
from flexmbd.multibody.kernels.tree_factor import ancestors, factor_tree, pays, solve_tree

FloatArray = NDArray[np.float64]

# The method's entries of State.numbers: its coefficients; the step the factors belong to; the step
# that the auxiliary acceleration belongs to; the step before the last; how much a Newton iteration
# with the factors at hand leaves of the error.
ALPHA_M, ALPHA_F, BETA, GAMMA = st.METHOD, st.METHOD + 1, st.METHOD + 2, st.METHOD + 3
STEP_FACTORED, STEP_AUXILIARY, STEP_EARLIER, CONTRACTION = range(st.METHOD + 4, st.METHOD + 8)
# Its entries of State.counts: how many accelerations it remembers; whether it filters its error;
# steps without growth left; steps left to be linearised anew, for old factors did not serve, and how many next time.
KNOWN_BEFORE, FILTERS, HOLD, RENEWALS, PATIENCE = range(st.METHOD_COUNT, st.METHOD_COUNT + 5)
# Rows of State.memory: the method's acceleration; the true one one, two and three steps ago; each
# coordinate's own rate (1/s).
AUXILIARY, BEFORE, EARLIER, EARLIEST, RATE, N_MEMORY = range(6)

_MAX_ITERATIONS = 10
_OF_TREE = -1  # no pivot of LAPACK's: the factors are those of the tree
_RENEW = 0.15  # a slower contraction than this renews the factors at the next step
_LONGEST_RENEWAL = 32  # steps in a row that do not try old factors, where trying failed again and again


class Scratch(NamedTuple):
    """Work arrays of a step: trial states, the iteration matrix and its factors."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    multipliers: FloatArray
    known: FloatArray
    lacking: FloatArray
    move: FloatArray
    out: FloatArray
    probe: FloatArray
    unknown: FloatArray
    equation: FloatArray
    matrix: FloatArray
    full: FloatArray
    block: FloatArray
    stiffness: FloatArray
    rate_stiffness: FloatArray
    direction: FloatArray
    correction: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    phi: FloatArray
    phi_rate: FloatArray
    phi_rate2: FloatArray
    pivot: NDArray[np.int32]
    block_pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]
    lines: NDArray[np.int64]
    kernels: NDArray[np.int64]
    tangent: TangentWork


def new_scratch(plan: Plan, work: Work, nx: int, nv: int) -> Scratch:
    """Allocate the work arrays of a step for ``plan``."""
    m, nu = len(plan.rows), len(plan.free)
    n = nu + 2 * m
    zeros = np.zeros
    tangent = new_tangent_work(plan, nv)
    full = zeros((nv, nv))
    state = (zeros(nx), zeros(nv), zeros(nv), zeros(m))
    return Scratch(
        x=zeros(nx),
        v=zeros(nv),
        a=zeros(nv),
        auxiliary=zeros(nv),
        multipliers=zeros(m),
        known=zeros(m),
        lacking=zeros(m),
        move=zeros(nv),
        out=zeros(nv),
        probe=zeros(nv),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=zeros((n, n)),
        full=full,
        block=zeros((nu, nu)),
        stiffness=zeros((nu, nu) if m else (0, 0)),
        rate_stiffness=zeros((m, nu)),
        direction=zeros((m, nu)),
        correction=zeros((1, n)),
        error_x=zeros(nu),
        error_v=zeros((1, nu)),
        scale_x=zeros(nv),
        scale_v=zeros(nv),
        phi=zeros(m),
        phi_rate=zeros(m),
        phi_rate2=zeros(m),
        pivot=zeros(max(1, n), np.int32),
        block_pivot=zeros(max(1, nu), np.int32),
        sizes=zeros(4, np.int32),
        lines=_lines(plan),
        kernels=np.array([address_of(tangent_after_residual, (plan, work, tangent, *state, 0.0, 0.0, 0.0, full))]),
        tangent=tangent,
    )


def _lines(plan: Plan) -> NDArray[np.int64]:
    """Ancestors of the unknowns where the tree's own factors pay; without rows elsewhere."""
    lines = ancestors(plan)
    return lines if len(plan.rows) == 0 and pays(lines) else lines[:0]


@kernel
def coefficients(number, h):
    """Position and velocity per unit of the new true acceleration."""
    share = (1.0 - number[ALPHA_F]) / (1.0 - number[ALPHA_M])
    return number[BETA] * share * h * h, number[GAMMA] * share * h


@kernel
def update(plan, work, state, s, h, unknown):
    """Put x, v, a of the step's end where ``unknown`` = (new a, multipliers, shifts) says."""
    number = state.numbers
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    beta = number[BETA]
    gamma = number[GAMMA]
    per_x, _ = coefficients(number, h)
    for k in range(s.move.shape[0]):
        s.move[k] = 0.0
    for j in range(nu):
        k = plan.free[j]
        new = unknown[j]
        auxiliary = (
            (1.0 - number[ALPHA_F]) * new
            + number[ALPHA_F] * state.a[k]
            - number[ALPHA_M] * state.memory[AUXILIARY, k]
        ) / (1.0 - number[ALPHA_M])
        s.a[k] = new
        s.auxiliary[k] = auxiliary
        s.move[k] = h * state.v[k] + h * h * (
            (0.5 - beta) * state.memory[AUXILIARY, k] + beta * auxiliary
        )
        s.v[k] = state.v[k] + h * ((1.0 - gamma) * state.memory[AUXILIARY, k] + gamma * auxiliary)
    for i in range(m):
        s.multipliers[i] = unknown[nu + i]
        shift = per_x * unknown[nu + m + i]
        for j in range(nu):
            s.move[plan.free[j]] += shift * s.direction[i, j]
    retract(plan, state.x, s.move, s.x)
    drive(plan, work, s.x, s.v, s.a)


@kernel
def is_unshifted(plan, i):
    """Whether row i has no position to be shifted: it holds velocities alone, or yields."""
    return plan.rows[i, at.ROW_LEVEL] == at.LEVEL_VELOCITY or plan.rows[i, at.ROW_HOLD] > 0


@kernel
def trial(plan, work, state, s, h, unknown, equation):
    """Evaluate the step's equations at ``unknown``."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    per_x, per_v = coefficients(state.numbers, h)
    update(plan, work, state, s, h, unknown)
    residual(plan, work, s.x, s.v, s.a, s.multipliers, s.out)
    state.counts[st.EVALUATIONS] += 1
    for j in range(nu):
        equation[j] = s.out[plan.free[j]]
    if m > 0:
        constraints(plan, work, s.phi, s.phi_rate, s.phi_rate2)
        for i in range(m):
            if is_unshifted(plan, i):
                equation[nu + i] = unknown[nu + m + i]
            else:
                equation[nu + i] = s.phi[i] / per_x
            equation[nu + m + i] = s.phi_rate[i] / per_v
            o = plan.rows[i, at.ROW_HOLD]
            if o > 0:  # the reaction is what stiffness and damping give, beyond that of the pass before
                k = plan.data[o + at.HOLD_STIFFNESS]
                c = plan.data[o + at.HOLD_DAMPING]
                gap = s.known[i] + k * s.phi[i] + c * s.phi_rate[i] - unknown[nu + i]
                equation[nu + m + i] = gap / (k * per_x + c * per_v)


@part_of_kernel
def _put_derivatives(plan, work, s, per_x, per_v):
    """Fill the iteration matrix but for the shifts' columns, from the tangent at the last trial.

    Where loops have shifts, ``s.stiffness`` and ``s.rate_stiffness`` get what positions alone bring.  In a tree the
    turns within a step count as small, which changes the matrix by their share of its stiffness.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    tw = s.tangent
    for part in range(0 if m > 0 else 1, 2):
        rates = float(part)
        call_separate(
            s.kernels[0],
            (plan, work, tw, s.x, s.v, s.a, s.multipliers, per_x, rates * per_v, rates, s.full),
        )
        if part == 1:
            break
        for i in range(nu):
            for j in range(nu):
                s.block[i, j] = -s.full[plan.free[i], plan.free[j]]
        turn_columns(plan, s.move, s.full)
        turn_columns(plan, s.move, tw.rate_jacobian)
        for i in range(nu):
            for j in range(nu):
                s.stiffness[i, j] = s.full[plan.free[i], plan.free[j]]
                s.block[i, j] += s.stiffness[i, j]
        for i in range(m):
            for j in range(nu):
                s.rate_stiffness[i, j] = tw.rate_jacobian[i, plan.free[j]]
    for i in range(nu):
        for j in range(nu):
            s.matrix[i, j] = s.full[plan.free[i], plan.free[j]]
            if m > 0:
                s.matrix[i, j] += s.block[i, j]
        for k in range(m):
            s.matrix[i, nu + k] = tw.jacobian[k, plan.free[i]]
    turn_columns(plan, s.move, tw.jacobian)


@part_of_kernel
def _put_shifts(plan, s, per_x, per_v):
    """Fill the columns of the shifts of positions along ``s.direction``, and the rows that hold the loops."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    for k in range(m):
        for i in range(nu):
            t = 0.0
            for j in range(nu):
                t += s.stiffness[i, j] * s.direction[k, j]
            s.matrix[i, nu + m + k] = t
    for i in range(m):
        unshifted = is_unshifted(plan, i)
        # the second row of a constraint: its rate, or what yields between its position, its rate and its reaction
        o = plan.rows[i, at.ROW_HOLD]
        k_x = plan.data[o + at.HOLD_STIFFNESS] if o > 0 else 0.0
        k_v = plan.data[o + at.HOLD_DAMPING] if o > 0 else 1.0
        total = k_x * per_x + k_v * per_v
        for j in range(nu):
            x = s.tangent.jacobian[i, plan.free[j]]
            s.matrix[nu + i, j] = 0.0 if unshifted else x
            v = s.tangent.rate_jacobian[i, plan.free[j]]
            s.matrix[nu + m + i, j] = (k_x * per_x * x + k_v * v) / total
        for k in range(m):
            t = 0.0
            r = 0.0
            for j in range(nu):
                x = s.tangent.jacobian[i, plan.free[j]]
                t += x * s.direction[k, j]
                r += (k_x * per_x * x + k_v * s.rate_stiffness[i, j]) * s.direction[k, j]
            own = 1.0 if i == k else 0.0
            s.matrix[nu + i, nu + k] = 0.0
            s.matrix[nu + m + i, nu + k] = -own / total if o > 0 else 0.0
            s.matrix[nu + i, nu + m + k] = own if unshifted else t
            s.matrix[nu + m + i, nu + m + k] = r / total


@part_of_kernel
def _linearise(plan, work, state, s, h):
    """Build and factor the iteration matrix at the last trial; False if it is singular."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    n = nu + 2 * m
    per_x, per_v = coefficients(state.numbers, h)
    state.counts[st.FACTORISATIONS] += 1
    state.numbers[STEP_FACTORED] = h
    state.numbers[CONTRACTION] = 1.0
    _put_derivatives(plan, work, s, per_x, per_v)
    if m > 0:
        # a shift of the positions goes along what a unit reaction would move
        for i in range(nu):
            for j in range(nu):
                s.block[i, j] = s.matrix[i, j]
            for k in range(m):
                s.direction[k, i] = s.matrix[i, nu + k]
        if factor(plan.lapack, s.block, s.block_pivot, s.sizes) != 0:
            return False
        solve(plan.lapack, s.block, s.block_pivot, s.sizes, s.direction)
        _put_shifts(plan, s, per_x, per_v)
    for i in range(n):
        for j in range(n):
            if not np.isfinite(s.matrix[i, j]):
                return False
    s.pivot[0] = _OF_TREE
    if s.lines.shape[0] > 0 and factor_tree(s.lines, s.matrix):
        return True
    if s.lines.shape[0] > 0:  # without pivots it failed, and is spoilt
        for i in range(nu):
            for j in range(nu):
                s.matrix[i, j] = s.full[plan.free[i], plan.free[j]]
    return factor(plan.lapack, s.matrix, s.pivot, s.sizes) == 0


@kernel
def solve_factored(plan, s, rhs):
    """Solve with the iteration matrix's factors; each row of ``rhs`` is one right-hand side, in place."""
    if s.pivot[0] == _OF_TREE:
        solve_tree(s.lines, s.matrix, rhs)
    else:
        solve(plan.lapack, s.matrix, s.pivot, s.sizes, rhs)


@part_of_kernel
def _newton(plan, work, state, s, h, tolerance, evaluated):
    """Iterate with the factors at hand: 1 converged, 0 too slow, -1 not finite.

    ``evaluated``: ``s.equation`` is that of the first guess.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    per_x, per_v = coefficients(state.numbers, h)
    before = 0.0
    # what the same factors did in the step before lets a good guess pass after one iteration
    contraction = max(state.numbers[CONTRACTION], 1e-3) ** 0.8
    for iteration in range(_MAX_ITERATIONS):
        if iteration > 0 or not evaluated:
            trial(plan, work, state, s, h, s.unknown, s.equation)
        state.counts[st.ITERATIONS] += 1
        for i in range(s.equation.shape[0]):
            s.correction[0, i] = s.equation[i]
        solve_factored(plan, s, s.correction)
        size = 0.0
        for i in range(s.unknown.shape[0]):
            s.unknown[i] -= s.correction[0, i]
        for j in range(nu):
            k = plan.free[j]
            move = s.correction[0, j]
            part = max(abs(move) * per_x / s.scale_x[k], abs(move) * per_v / s.scale_v[k])
            for i in range(m):
                part = max(
                    part,
                    abs(s.correction[0, nu + m + i] * s.direction[i, j]) * per_x / s.scale_x[k],
                )
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
        if not np.isfinite(size):
            return -1
        if iteration > 0:
            contraction = size / before if before > 0.0 else 0.0
            if contraction > 0.7 and size > tolerance:
                return 0
        before = size
        # the error left after a linear iteration, and round-off of a vanishing correction
        left = contraction / (1.0 - contraction) if contraction < 1.0 else 1.0
        if size * left <= tolerance or size <= 1e-15:
            update(plan, work, state, s, h, s.unknown)
            if iteration == 0:  # unmeasured, so it is trusted a little less at each step
                state.numbers[CONTRACTION] = min(1.3 * contraction, 1.0)
                return 1
            state.numbers[CONTRACTION] = min(contraction, 1.0)
            if contraction > _RENEW:
                state.numbers[STEP_FACTORED] = 0.0
            return 1
    return 0


@kernel
def _foretell(state, k, h):
    """Coordinate k's next acceleration, on the parabola through the last three."""
    h1 = state.numbers[st.STEP_BEFORE]
    h2 = state.numbers[STEP_EARLIER]
    slope = (state.a[k] - state.memory[BEFORE, k]) / h1
    half_curve = (slope - (state.memory[BEFORE, k] - state.memory[EARLIER, k]) / h2) / (h1 + h2)
    return state.a[k] + h * (slope + (h + h1) * half_curve)


@kernel
def _foretell_as_before(state, k):
    """Coordinate k's next acceleration after equal steps, by what would have foretold the last one best.

    Where a step does not resolve a vibration that is no change at all, and where it does a line or a parabola.
    """
    memory = state.memory
    first = state.a[k] - memory[BEFORE, k]
    before = memory[BEFORE, k] - memory[EARLIER, k]
    second = first - before
    third = second - (before - (memory[EARLIER, k] - memory[EARLIEST, k]))
    guess = state.a[k]
    if abs(second) < abs(first):
        guess += first
        if abs(third) < abs(second):
            guess += second
    return guess


@part_of_kernel
def _start_newton(plan, state, s, h, extrapolate):
    """First guess: multipliers as they were, accelerations too or as their last ones foretell.

    With a fixed step in trees alone: what multipliers as they were leave of the error would not shrink with the guess.
    """
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    known = state.counts[KNOWN_BEFORE]
    fixed = state.counts[st.FIXED_STEP] == 1
    for j in range(nu):
        k = plan.free[j]
        s.unknown[j] = state.a[k]
        if extrapolate and known > 2 and fixed and m == 0:
            s.unknown[j] = _foretell_as_before(state, k)
        elif extrapolate and known > 1 and not fixed:
            s.unknown[j] = _foretell(state, k, h)
    for i in range(m):
        s.unknown[nu + i] = state.multipliers[i]
        s.unknown[nu + m + i] = 0.0


@kernel
def solve_step(plan, work, state, s, h, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    Returns whether it converged; if so ``s`` holds the step's end.
    """
    renew = state.counts[RENEWALS] > 0
    for attempt in range(3):
        if attempt == 0:
            if renew or state.numbers[STEP_FACTORED] != h:
                continue
            _start_newton(plan, state, s, h, True)
        elif attempt == 1:
            _start_newton(plan, state, s, h, renew)
        finite = True
        for i in range(s.unknown.shape[0]):
            finite = finite and np.isfinite(s.unknown[i])
        if not finite:
            break
        # the second time linearised where the first iterations led
        if attempt > 0:
            trial(plan, work, state, s, h, s.unknown, s.equation)
            if not _linearise(plan, work, state, s, h):
                break
        if _newton(plan, work, state, s, h, tolerance, attempt > 0 and plan.rows.shape[0] == 0) == 1:
            if renew:
                state.counts[RENEWALS] -= 1
            elif attempt == 0:
                state.counts[PATIENCE] = 0
            return True
        if attempt == 0:
            state.counts[RENEWALS] = state.counts[PATIENCE]
            state.counts[PATIENCE] = min(_LONGEST_RENEWAL, 2 * state.counts[PATIENCE] + 1)
    state.numbers[STEP_FACTORED] = 0.0
    return False
