"""Accelerations and multipliers at the end of a Radau IIA step, to order 5; those of the last stage have order 3.

M a + C^T nu = f and C a = -gamma at the stage's positions and velocities, solved by corrections of a and nu with
factors of M and of C M^-1 C^T; by these the positions and velocities have been brought onto the loops before.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import NO_REACTION, factor_rows, least_pivot
from flexmbd.integrate.newton_control import CONVERGED, NOT_FINITE, judge
from flexmbd.integrate.radau.coefficients import STAGES
from flexmbd.integrate.radau.matrix import derive
from flexmbd.integrate.radau.sparse_end import balance_sparse, close_sparse, factor_sparse_end
from flexmbd.integrate.radau.sparse_stages import is_sparse
from flexmbd.integrate.radau.stages import evaluate_stage
from flexmbd.multibody.kernels.algebra.rank_revealing import solve_block
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.native import factor_part, solve_part
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.plan_entries import holds_position
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, solve_blocks
from flexmbd.round_off import ROUND_OFF

_LAST = STAGES - 1
_MAX_ITERATIONS = 10
_RENEW = 0.05  # a slower contraction than this renews the factors
_ROUND_OFF = 10.0 * ROUND_OFF  # of the scales, as of the stages
_STALLED = 0.5  # a slower contraction counts as none


@kernel
def _factor_end(plan, work, state, scratch):
    """Factor M and C M^-1 C^T at the last stage, which was evaluated last; whether M is regular."""
    if is_sparse(scratch):
        return factor_sparse_end(plan, work, state, scratch)
    derive(plan, work, scratch, _LAST, 0.0, 0.0, 1.0)
    least = 1.0
    for c in range(scratch.bounds.shape[0] - 1):
        if not _factor_block(plan, scratch, c):
            return False
        above, below = between(scratch.tangent.blocks.rows, c)
        rank = factor_rows(scratch.memory.row_length, scratch.row_factors, above, below, scratch.row_order)
        least = min(least, least_pivot(scratch.row_factors, above, below, rank))
        # a nearly dependent direction keeps the stage's own values: its solution would be round-off
        while rank > 1 and scratch.row_factors[above + rank - 1, above + rank - 1] ** 2 < NO_REACTION:
            rank -= 1
        scratch.row_rank[c] = rank
    st.watch_pivot(state, least)
    for r in range(plan.rows.shape[0]):
        scratch.row_length[r] = scratch.memory.row_length[r]
    return True


@kernel
def _factor_block(plan, scratch, c):
    """Factor block c of M and write that of C M^-1 C^T; whether M is regular and all is finite."""
    blocks = scratch.tangent.blocks
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    matrix, pivot, sizes = scratch.end_mass, scratch.pivot_end, scratch.sizes
    for i in range(first, last):
        for j in range(first, last):
            matrix[i, j - first] = scratch.full_tangent[plan.free[i], plan.free[j]]
    if factor_part(plan.lapack, matrix, first, last, pivot, sizes) != 0:
        return False
    for r in range(above, below):
        for j in range(first, last):
            scratch.end_jacobian[r, j] = scratch.tangent.jacobian[r, plan.free[j]]
            scratch.end_response[r, j] = scratch.end_jacobian[r, j]
    solve_part(plan.lapack, matrix, first, last, pivot, sizes, scratch.end_response, above, below)
    for r in range(above, below):
        for q in range(above, r + 1):
            total = 0.0
            for j in range(first, last):
                total += scratch.end_jacobian[r, j] * scratch.end_response[q, j]
            scratch.row_factors[r, q] = total
        if not np.isfinite(scratch.row_factors[r, r]):
            return False
    return True


@kernel
def _solve_reactions(scratch):
    """Write the reactions (C M^-1 C^T)^-1 ``s.row_residual`` into ``s.reaction``."""
    blocks = scratch.tangent.blocks
    for c in range(scratch.bounds.shape[0] - 1):
        solve_block(
            scratch.row_factors,
            blocks.rows[c],
            blocks.rows[c + 1],
            scratch.row_rank[c],
            scratch.row_order,
            scratch.row_length,
            scratch.row_residual,
            scratch.row_scratch,
            scratch.reaction,
        )


@kernel
def _least_pivot(scratch):
    """The smallest pivot of C M^-1 C^T above round-off, of rows of unit length."""
    if is_sparse(scratch):
        return scratch.shifted.least_pivot[0]
    least = 1.0
    for c in range(scratch.bounds.shape[0] - 1):
        if scratch.row_rank[c] > 0:
            last = scratch.tangent.blocks.rows[c] + scratch.row_rank[c] - 1
            least = min(least, scratch.row_factors[last, last])
    return least


@kernel
def _close(plan, scratch, what, scale, rows, velocities):
    """Bring positions or velocities ``what`` (nv,) onto the loops, which ``rows`` (m,) open; the largest share moved.

    Positions are held by some of the rows, ``velocities`` by all.
    The stages' iteration, with slopes of another stage, converges slowly on nearly dependent rows.
    """
    if is_sparse(scratch):
        return close_sparse(plan, scratch, what, scale, rows, velocities)
    m = plan.rows.shape[0]
    for r in range(m):
        scratch.row_residual[r] = rows[r] if velocities or holds_position(plan.rows[r]) else 0.0
    _solve_reactions(scratch)
    blocks = scratch.tangent.blocks
    size = 0.0
    for c in range(scratch.bounds.shape[0] - 1):
        for j in range(*between(blocks.free, c)):
            k = plan.free[j]
            change = st.reaction_acceleration(
                scratch.end_response, scratch.reaction, j, blocks.rows[c], blocks.rows[c + 1]
            )
            what[k] -= change
            size = max(size, abs(change) / scale[k])
    return size


@kernel
def _balance(plan, state, scratch, h):
    """Correct a and nu; the largest share of the correction, and that of a unit relative round-off.

    Forces out of balance count by ``state.pushed``.
    """
    if is_sparse(scratch):
        return balance_sparse(plan, state, scratch, h)
    m = plan.rows.shape[0]
    for j in range(plan.free.shape[0]):
        scratch.rhs_end[0, j] = -scratch.equation[_LAST, j]
    blocks = scratch.tangent.blocks
    solve_blocks(plan.lapack, scratch.end_mass, blocks.free, scratch.pivot_end, scratch.sizes, scratch.rhs_end)
    for c in range(scratch.bounds.shape[0] - 1):
        for r in range(*between(blocks.rows, c)):
            scratch.row_residual[r] = scratch.phi_rate2[r]
            for j in range(*between(blocks.free, c)):
                scratch.row_residual[r] += scratch.end_jacobian[r, j] * scratch.rhs_end[0, j]
    _solve_reactions(scratch)
    size = 0.0
    noise = 1.0 / _least_pivot(scratch)
    for c in range(scratch.bounds.shape[0] - 1):
        above, below = between(blocks.rows, c)
        for j in range(*between(blocks.free, c)):
            k = plan.free[j]
            unbalanced = scratch.rhs_end[0, j]
            change = unbalanced - st.reaction_acceleration(scratch.end_response, scratch.reaction, j, above, below)
            weight = 0.0
            for r in range(above, below):
                weight += abs(scratch.end_response[r, j] * scratch.multipliers[_LAST, r])
            scratch.a[_LAST, k] += change
            part = max(abs(change), abs(unbalanced)) * h / scratch.scale_v[k]
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
            noise = max(noise, weight * h / scratch.scale_v[k])
    for r in range(m):
        scratch.multipliers[_LAST, r] += scratch.reaction[r]
    return size, noise


@kernel
def place_end(plan, work, state, scratch):
    """Write the configuration and the driven motions of the last stage, where its corrections have brought it."""
    retract(plan, state.x, scratch.local[_LAST], scratch.x[_LAST])
    drive(plan, work, scratch.x[_LAST], scratch.v[_LAST], scratch.a[_LAST])


@deferred_kernel(FLAG)
def close_end(plan, work, state, scratch, h, tolerance, doubts):
    """Solve for a and nu of the last stage, it on the loops; whether forces balance to the tolerance.

    ``doubts``: a stage that lies farther off the loops than the tolerance fails: the stages' factors were too old.
    """
    before = 0.0
    moved_before = np.inf
    contraction = np.inf
    for _ in range(_MAX_ITERATIONS):
        evaluate_stage(plan, work, state, scratch, _LAST)
        if contraction > _RENEW:
            before = 0.0
            if not _factor_end(plan, work, state, scratch):
                state.counts[st.OUTCOME] = st.RANK_LOST
                return False
        if moved_before > 0.0:
            moved = _close(plan, scratch, scratch.local[_LAST], scratch.scale_x, scratch.phi, False)
            moved = max(moved, _close(plan, scratch, scratch.v[_LAST], scratch.scale_v, scratch.phi_rate, True))
            if doubts and moved_before == np.inf and moved > max(tolerance, _ROUND_OFF / _least_pivot(scratch)):
                return False
            # where rows are nearly dependent, round-off moves the stage to and fro: then it stays
            moved_before = moved if moved > tolerance and moved < _STALLED * moved_before else 0.0
        size, noise = _balance(plan, state, scratch, h)
        # new factors leave next to nothing, unless what is measured says otherwise
        verdict, contraction = judge(size, before, 0.0, np.inf, tolerance, 0.0, 0)
        if verdict == NOT_FINITE:
            return False
        if moved_before == 0.0 and (verdict == CONVERGED or size <= _ROUND_OFF * noise):
            place_end(plan, work, state, scratch)
            return True
        before = size
    return False
