"""Newton's iteration for an energy-momentum step: the matrix, its round-off, Anderson's acceleration.

The matrix is the tangent's at the middle of the step: with a = 0 its parts are those of the canonical equations but
for h/2 dM/dt, which M(x_end) - M(x_mid) takes out.  ``scratch`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.momentum_balance import conserve_momenta, place, vary_average_strain
from flexmbd.integrate.discrete_gradient.momentum_end import close_velocities, factor_end_mass
from flexmbd.integrate.discrete_gradient.momentum_predictors import first_guess
from flexmbd.integrate.discrete_gradient.polynomial_average import vary_average_polynomials
from flexmbd.integrate.discrete_gradient.sparse_matrices import (
    add_stiff_forces,
    end_mass_of,
    factor_iteration,
    is_sparse,
    put_middle,
    solve_iteration,
    take_end_mass,
)
from flexmbd.integrate.discrete_gradient.step import evaluate
from flexmbd.integrate.discrete_gradient.workspace import (
    ANDERSON_DEPTH,
    CLOSE_VELOCITIES,
    DEFECT,
    EVALUATE,
    FACTOR_MASS,
    KINETIC_ERROR,
    LINEARISE,
    PLACE,
    RESIDUAL,
    SINGULAR,
    TANGENT,
    TRIAL_WORK,
    UNRESOLVED,
    EnergyMomentumWorkspace,
)
from flexmbd.integrate.explicit.loop_dynamics import Loops
from flexmbd.integrate.newton_control import CONVERGED, NOT_FINITE, TOO_SLOW, has_stalled
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.native import solve
from flexmbd.multibody.kernels.base.separate import address_of, call_separate
from flexmbd.multibody.kernels.reading.evaluated_motion import farthest_place
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, modes_of
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, factor_blocks, solve_sorted
from flexmbd.multibody.kernels.tangent.residual_tangent import turn_row_columns

_MAX_ITERATIONS = 20
_MANY = 5  # more iterations than this renew the factors at the next step
_STARTS = 4  # first guesses
_RENEWALS = 4  # of the matrix, from one first guess
_FAR = 1e-3  # larger corrections than this are far from a solution
_NEAR = 1e-6  # after a smaller one the next iterate may be the last
_SLOW = 0.1  # largest ratio of corrections over two iterations, with old factors
_SLOW_NEW = 1.0  # with new ones
_EPSILON = 2.0**-52
_SIGNS = 4  # patterns of signs that probe a correction's round-off
_WHOLE_FLOOR = 8.0  # safety factor of the probe


@kernel
def _put_matrix(plan, work, scratch, h):
    """Fill the iteration matrix at ``s.unknown``, and factor the mass matrix at the end that it leads to."""
    tw = scratch.tangent
    call_separate(
        scratch.kernels[RESIDUAL], (plan, work, scratch.x_mid, scratch.u, scratch.zeros, scratch.nu, scratch.scratch_v)
    )
    if is_sparse(scratch):
        put_middle(plan, work, scratch, h)
        call_separate(scratch.kernels[FACTOR_MASS], (plan, work, scratch))
        take_end_mass(scratch)
        return
    call_separate(
        scratch.kernels[TANGENT],
        (
            plan,
            work,
            tw,
            scratch.x_mid,
            scratch.u,
            scratch.zeros,
            scratch.nu,
            0.25 * h * h,
            0.5 * h,
            2.0,
            scratch.full_matrix,
        ),
    )
    if plan.flex.shape[0] > 0:
        vary_average_strain(plan, scratch, h)
        vary_average_polynomials(plan, scratch, h)
    for c in range(scratch.bounds.shape[0] - 1):
        _put_block(plan, scratch, c, h)
    call_separate(scratch.kernels[FACTOR_MASS], (plan, work, scratch))
    if plan.rows.shape[0] > 0:
        turn_row_columns(plan, tw.blocks, scratch.increment, tw.jacobian)
    for c in range(scratch.bounds.shape[0] - 1):
        _change_block(plan, scratch, c)


@kernel
def _put_block(plan, scratch, c, h):
    """Block c of the matrix from the tangent at the middle."""
    blocks, free = scratch.tangent.blocks, plan.free
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    pushed = last - first - above  # where reactions stand in the block
    block = scratch.matrix[scratch.bounds[c] : scratch.bounds[c + 1]]
    for i in range(first, last):
        for j in range(first, last):
            block[i - first, j - first] = scratch.full_matrix[free[i], free[j]]
        for k in range(above, below):
            block[i - first, pushed + k] = scratch.tangent.jacobian[k, free[i]]
    for k in range(above, below):
        for j in range(first, last):
            block[pushed + k, j - first] = 2.0 / h * scratch.tangent.rate_jacobian[k, free[j]]
        for j in range(above, below):
            block[pushed + k, pushed + j] = 0.0


@kernel
def _change_block(plan, scratch, c):
    """Take M and C at the end into block c of the matrix."""
    blocks, free = scratch.tangent.blocks, plan.free
    first, last = between(blocks.free, c)
    pushed = last - first - blocks.rows[c]
    block = scratch.matrix[scratch.bounds[c] : scratch.bounds[c + 1]]
    for i in range(first, last):
        for j in range(first, last):
            block[i - first, j - first] -= scratch.full_matrix[free[i], free[j]]
    for k in range(*between(blocks.rows, c)):
        if holds_position(plan.rows[k]):
            for j in range(first, last):
                block[pushed + k, j - first] = scratch.tangent.jacobian[k, free[j]]


@kernel
def solve_factored(plan, scratch):
    """Solve with the factors of the iteration matrix for ``s.correction``, in place."""
    if scratch.bounds.shape[0] == 2:
        solve(plan.lapack, scratch.matrix, scratch.pivot, scratch.sizes, scratch.correction)
        return
    if is_sparse(scratch):
        solve_iteration(scratch)
        return
    blocks, bounds, sizes = scratch.tangent.blocks, scratch.bounds, scratch.sizes
    rhs, sorted_rhs = scratch.correction, scratch.sorted_rhs
    solve_sorted(plan.lapack, scratch.matrix, blocks, bounds, scratch.pivot, sizes, rhs, sorted_rhs)


@kernel
def _correction_norm(free, scale_x, scale_v, correction, h, counts):
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


@kernel
def _stiff_forces(plan, work, groups, scratch, h):
    """Write into ``s.modal_scratch`` the forces of the matrix's stiffness: of deformations, and of whole sizes.

    Of joints' shifts these are the largest place, whose rounding elements between bodies see (``work`` has the middle).
    A force that hangs on several coordinates takes the rounding of each.
    """
    force, size = scratch.modal_scratch[0], scratch.modal_scratch[1]
    place = farthest_place(plan, work)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        g = groups.of[k]
        size[k] = max(groups.full[g], place) if groups.kind[g] == kinds.GROUP_LENGTH else groups.full[g]
    for i in range(plan.tree.shape[0]):
        n, qx, qv = modes_of(plan.tree[i], plan.flex)
        for k in range(n):
            size[qv + k] = abs(scratch.x_mid[qx + k])
    if is_sparse(scratch):
        add_stiff_forces(plan, scratch, size, force)
        for j in range(plan.free.shape[0]):
            force[plan.free[j]] *= 4.0 / (h * h)
        return
    blocks = scratch.tangent.blocks
    for c in range(scratch.bounds.shape[0] - 1):
        begin = scratch.bounds[c]
        first, last = between(blocks.free, c)
        for j in range(first, last):
            k = plan.free[j]
            total = 0.0
            for i in range(first, last):
                other = plan.free[i]
                stiffness = abs(scratch.matrix[begin + j - first, i - first] - scratch.full_matrix[k, other])
                total += stiffness * size[other]
            force[k] = 4.0 / (h * h) * total


@kernel
def _end_mass(scratch, k):
    return end_mass_of(scratch, k) if is_sparse(scratch) else scratch.full_matrix[k, k]


@kernel
def _factor(plan, scratch):
    """Factor the iteration matrix; False if it is singular."""
    if is_sparse(scratch):
        return factor_iteration(scratch)
    bounds = scratch.bounds
    for c in range(bounds.shape[0] - 1):
        first, last = between(bounds, c)
        for i in range(first, last):
            for j in range(last - first):
                if not np.isfinite(scratch.matrix[i, j]):
                    return False
    return factor_blocks(plan.lapack, scratch.matrix, bounds, scratch.pivot, scratch.sizes)


@kernel
def _probe_round_off(plan, state, groups, scratch, h):
    """Write ``s.round_off_floor``: the size of the corrections that rounding of the summed terms causes.

    Terms: momenta, of which neighbours may cancel, as large as |p_k| <= (M_kk p.v)^(1/2); forces of `_stiff_forces`;
    reactions; in rows, over the step, the lengths or angles that a residual is a difference of, however little the row
    moves with a coordinate, and what the rounding of the coordinates themselves adds.
    """
    n = plan.free.shape[0]
    blocks = scratch.tangent.blocks
    p = scratch.memory.momentum
    energy = 0.0
    for k in range(p.shape[0]):
        energy += p[k] * state.v[k]
    scratch.round_off_floor[0] = 0.0
    for pattern in range(_SIGNS):
        for i in range(scratch.unknown.shape[0]):
            if i < n:
                size = 2.0 * np.sqrt(abs(_end_mass(scratch, plan.free[i]) * energy))
                size += 0.5 * h * scratch.modal_scratch[0, plan.free[i]]
            else:
                size = scratch.row_size[i - n] / h if holds_position(plan.rows[i - n]) else 0.0
            scratch.round_off[i] = size
        for c in range(scratch.bounds.shape[0] - 1):
            for i in range(*between(blocks.rows, c)):
                for j in range(*between(blocks.free, c)):
                    k = plan.free[j]
                    slope = abs(scratch.tangent.jacobian[i, k])
                    scratch.round_off[j] += slope * abs(scratch.unknown[n + i])
                    scratch.round_off[n + i] += slope * groups.full[groups.of[k]] / h
        for i in range(scratch.unknown.shape[0]):
            # signs without a pattern: bits of multiples of the golden ratio
            odd = int((i + 1) * (2 * pattern + 1) * 0.6180339887498949 * 16.0) % 2
            scratch.correction[0, i] = _EPSILON * (scratch.round_off[i] if odd == 1 else -scratch.round_off[i])
        solve_factored(plan, scratch)
        size = _correction_norm(plan.free, scratch.scale_x, scratch.scale_v, scratch.correction, h, state.counts)
        scratch.round_off_floor[0] = max(scratch.round_off_floor[0], _WHOLE_FLOOR * size)


@entry_kernel
def linearise(plan, work, state, groups, scratch, h):
    """Build and factor the iteration matrix at ``s.unknown``; ``s.energy[SINGULAR]`` is 1 if that failed, else 0."""
    free = plan.free.shape[0]
    state.counts[st.FACTORISATIONS] += 1
    scratch.memory.step_factored[0] = h
    for j in range(free):
        scratch.u[plan.free[j]] = scratch.unknown[j]
    for i in range(scratch.nu.shape[0]):
        scratch.nu[i] = 2.0 / h * scratch.unknown[free + i]
    call_separate(scratch.kernels[PLACE], (plan, state.x, scratch, h))
    _put_matrix(plan, work, scratch, h)
    regular = scratch.energy[SINGULAR] == 0.0
    scratch.energy[SINGULAR] = 1.0
    _stiff_forces(plan, work, groups, scratch, h)
    if regular and _factor(plan, scratch):
        scratch.energy[SINGULAR] = 0.0
        _probe_round_off(plan, state, groups, scratch, h)


@kernel
def _dot(free, scale, a, b):
    """Product of two corrections of the velocities, over the machine's speeds."""
    total = 0.0
    for j in range(free.shape[0]):
        size = scale[free[j]]
        total += a[j] * b[j] / (size * size)
    return total


@kernel
def _anderson_update(plan, scratch, iteration, kept):
    """Move ``s.unknown`` by the correction, combined with those before by least squares (Anderson 1965).

    By orthogonal differences.  The part of the Jacobian that the matrix lacks, above all the energy's correction, is of
    low rank.  Returns how many differences are kept.
    """
    n = scratch.unknown.shape[0]
    if iteration > 0 and kept < ANDERSON_DEPTH:
        for j in range(n):
            scratch.anderson_changes[kept, j] = scratch.correction[0, j] - scratch.previous[1, j]
            scratch.anderson_moves[kept, j] = (
                scratch.unknown[j] - scratch.previous[0, j] - scratch.anderson_changes[kept, j]
            )
        whole = _dot(plan.free, scratch.scale_v, scratch.anderson_changes[kept], scratch.anderson_changes[kept])
        for i in range(kept):
            share = _dot(plan.free, scratch.scale_v, scratch.anderson_changes[i], scratch.anderson_changes[kept])
            for j in range(n):
                scratch.anderson_changes[kept, j] -= share * scratch.anderson_changes[i, j]
                scratch.anderson_moves[kept, j] -= share * scratch.anderson_moves[i, j]
        left = _dot(plan.free, scratch.scale_v, scratch.anderson_changes[kept], scratch.anderson_changes[kept])
        if left > 1e-8 * whole and left > 0.0:
            over = 1.0 / np.sqrt(left)
            for j in range(n):
                scratch.anderson_changes[kept, j] *= over
                scratch.anderson_moves[kept, j] *= over
            kept += 1
    for j in range(n):
        scratch.previous[0, j] = scratch.unknown[j]
        scratch.previous[1, j] = scratch.correction[0, j]
        scratch.unknown[j] -= scratch.correction[0, j]
    for i in range(kept):
        share = _dot(plan.free, scratch.scale_v, scratch.anderson_changes[i], scratch.previous[1])
        for j in range(n):
            scratch.unknown[j] -= share * scratch.anderson_moves[i, j]
    return kept


@kernel
def _newton(plan, stored_plan, work, loops, state, scratch, h, tolerance, trusted, old):
    """Iterate with the factors at hand until ``scratch`` holds a solution.

    Far from it, unless the predictor is ``trusted``, the energy's correction is left out, for it would diverge.
    ``old``: the factors are those of an earlier step, and given up sooner.
    Returns a verdict of ``newton_control``, and whether a solution is near.  Corrections count as they are, not by what
    is left of them: energy is kept to their size; and they are compared over two iterations, for accelerated ones leap.
    """
    keeps = scratch.memory.keeps_energy[0] == 1
    corrected = keeps and trusted
    before = np.inf
    earlier = np.inf
    kept = 0
    first = 0  # iteration with these equations
    for iteration in range(_MAX_ITERATIONS):
        near = before <= _NEAR
        call_separate(scratch.kernels[EVALUATE], (plan, stored_plan, work, loops, state, scratch, h, corrected, near))
        scratch.memory.load_work[0] = scratch.energy[TRIAL_WORK]
        state.counts[st.ITERATIONS] += 1
        for i in range(scratch.equation.shape[0]):
            scratch.correction[0, i] = scratch.equation[i]
        solve_factored(plan, scratch)
        size = _correction_norm(plan.free, scratch.scale_x, scratch.scale_v, scratch.correction, h, state.counts)
        if not np.isfinite(size):
            return NOT_FINITE, False
        solved = size <= tolerance and scratch.energy[DEFECT] <= tolerance
        if solved or has_stalled(size / before, size, max(scratch.round_off_floor[0], tolerance)):
            if corrected == keeps and scratch.energy[KINETIC_ERROR] <= scratch.energy[UNRESOLVED]:
                if iteration > _MANY:
                    scratch.memory.step_factored[0] = 0.0
                return CONVERGED, True
        elif (
            iteration > first + 1
            and size > scratch.round_off_floor[0]
            and size > (_SLOW if old else _SLOW_NEW) * earlier
        ):
            return TOO_SLOW, size <= _FAR
        earlier = before
        before = size
        kept = _anderson_update(plan, scratch, iteration - first, kept)
        if keeps and not corrected and size <= _FAR:
            corrected = True
            kept = 0
            first = iteration + 1
            before = np.inf
    return TOO_SLOW, before <= _FAR


@kernel
def solve_step(plan, stored_plan, work, loops, state, groups, scratch, h, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    ``work.time`` must hold the middle of the step, ``s.driven`` its end.  Returns whether it converged; if so
    ``scratch`` holds the step's end, momenta in ``s.p_end`` and velocities in ``s.v_end``.
    """
    for start in range(_STARTS):
        trusted = first_guess(plan, state, scratch, h, start)
        for renewal in range(_RENEWALS):
            old = start == 0 and renewal == 0 and scratch.memory.step_factored[0] == h
            if not old:
                call_separate(scratch.kernels[LINEARISE], (plan, work, state, groups, scratch, h))
                if scratch.energy[SINGULAR] != 0.0:
                    state.counts[st.OUTCOME] = st.RANK_LOST
                    break
            verdict, near = _newton(plan, stored_plan, work, loops, state, scratch, h, tolerance, trusted, old)
            if verdict == CONVERGED:
                conserve_momenta(plan, scratch.memory.momentum, scratch, h)
                call_separate(scratch.kernels[FACTOR_MASS], (plan, work, scratch))
                call_separate(scratch.kernels[CLOSE_VELOCITIES], (plan, loops, scratch))
                return scratch.energy[SINGULAR] == 0.0
            if plan.flag[0] != 0:
                return False
            if old:
                trusted = first_guess(plan, state, scratch, h, start)
            elif verdict == NOT_FINITE:
                break
            else:
                trusted = near
    scratch.memory.step_factored[0] = 0.0
    return False


def bind(
    plan: Plan,
    stored_plan: Plan,
    work: Work,
    loops: Loops,
    state: st.State,
    groups: st.Groups,
    scratch: EnergyMomentumWorkspace,
) -> None:
    """Compile the parts of a step and write their addresses into ``s.kernels``."""
    scratch.kernels[PLACE] = address_of(place, (plan, state.x, scratch, 1.0))
    scratch.kernels[FACTOR_MASS] = address_of(factor_end_mass, (plan, work, scratch))
    scratch.kernels[CLOSE_VELOCITIES] = address_of(close_velocities, (plan, loops, scratch))
    scratch.kernels[EVALUATE] = address_of(evaluate, (plan, stored_plan, work, loops, state, scratch, 1.0, True, True))
    scratch.kernels[LINEARISE] = address_of(linearise, (plan, work, state, groups, scratch, 1.0))
