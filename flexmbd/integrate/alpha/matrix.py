"""The iteration matrix of a step of generalized-alpha: the tangent, the columns of the shifts, its factors."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.sparse_loops import (
    assemble,
    is_sparse,
    linearise_loops,
    solve_loops,
)
from flexmbd.integrate.alpha.workspace import (
    coefficients,
    holds_position_alone,
    is_unshifted,
)
from flexmbd.integrate.explicit.loop_dynamics import factor_rows, least_pivot
from flexmbd.integrate.sparse_rows import tell_worthless
from flexmbd.multibody.kernels.algebra.rank_revealing import RANK_FLOOR
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.native import factor_part, solve, solve_part
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import augmented_stiffness, is_augmented
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, factor_blocks, solve_sorted
from flexmbd.multibody.kernels.tangent.residual_tangent import turn_columns, turn_row_columns
from flexmbd.multibody.kernels.tangent.tree_recursion import factor_recursion, solve_recursion

# In place of LAPACK's first pivot: the factors are those of the recursion over the tree or of a sparse matrix.
_OF_RECURSION, _OF_SPARSE = -1, -2


@kernel
def _add_interiors(plan, scratch, per_x):
    """Add the stiffness of the interiors' wrenches to ``s.full_tangent``, velocities following positions."""
    for i in range(scratch.interior_stiffness.shape[0]):
        for j in range(scratch.interior_stiffness.shape[0]):
            scratch.full_tangent[plan.free[i], plan.free[j]] += per_x * scratch.interior_stiffness[i, j]


@kernel
def _put_derivatives(plan, work, scratch, per_x, per_v):
    """Fill the iteration matrix but for the shifts' columns, from the tangent at the last trial.

    Where loops have shifts, ``s.stiffness`` and ``s.rate_stiffness`` get the derivatives by positions alone.  In a
    tree without interiors the rotations within a step count as small, which changes the matrix by their share of its
    stiffness.
    """
    m = plan.rows.shape[0]
    tw = scratch.tangent
    added = scratch.interior_stiffness.shape[0] > 0
    turned = m > 0 or added
    for part in range(0 if turned else 1, 2):
        rates = float(part)
        call_separate(
            scratch.kernels[0],
            (
                plan,
                work,
                tw,
                scratch.x,
                scratch.v,
                scratch.a,
                scratch.multipliers,
                per_x,
                rates * per_v,
                rates,
                scratch.full_tangent,
            ),
        )
        if added:
            _add_interiors(plan, scratch, per_x)
        if part == 1:
            break
        _keep_stiffness(plan, scratch)
    for c in range(tw.blocks.velocity.shape[0]):
        first, last = between(tw.blocks.free, c)
        above, below = between(tw.blocks.rows, c)
        begin = scratch.bounds[c]
        for i in range(first, last):
            row = scratch.matrix[begin + i - first]
            for j in range(first, last):
                row[j - first] = scratch.full_tangent[plan.free[i], plan.free[j]]
                if turned:
                    row[j - first] += scratch.tree_matrix[i, j - first]
            for k in range(above, below):
                row[last - first + k - above] = tw.jacobian[k, plan.free[i]]
    turn_row_columns(plan, tw.blocks, scratch.displacement, tw.jacobian)


@kernel
def _keep_stiffness(plan, scratch):
    """From the tangent by positions alone, ``s.stiffness``, ``s.rate_stiffness`` and what the turns of a step change.

    The last is written into ``s.tree_matrix``.
    """
    tw = scratch.tangent
    for c in range(tw.blocks.velocity.shape[0]):
        first, last = between(tw.blocks.free, c)
        for i in range(first, last):
            for j in range(first, last):
                scratch.tree_matrix[i, j - first] = -scratch.full_tangent[plan.free[i], plan.free[j]]
    turn_columns(plan, tw.blocks, scratch.displacement, scratch.full_tangent)
    turn_row_columns(plan, tw.blocks, scratch.displacement, tw.rate_jacobian)
    for c in range(tw.blocks.velocity.shape[0]):
        first, last = between(tw.blocks.free, c)
        for i in range(first, last):
            for j in range(first, last):
                stiffness = scratch.full_tangent[plan.free[i], plan.free[j]]
                scratch.stiffness[i, j - first] = stiffness
                scratch.tree_matrix[i, j - first] += stiffness
        for i in range(*between(tw.blocks.rows, c)):
            for j in range(first, last):
                scratch.rate_stiffness[i, j - first] = tw.rate_jacobian[i, plan.free[j]]


@kernel
def _put_shift_columns(plan, scratch, c, per_x, per_v):
    """Fill the columns of the shifts of positions along ``s.shift_direction``, and the rows that hold the loops.

    Of block c.
    """
    blocks = scratch.tangent.blocks
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    # where unknowns of the block stand in it: coordinates from -first, reactions and shifts
    pushed = last - first - above
    shifted = pushed + below - above
    matrix = scratch.matrix[scratch.bounds[c] : scratch.bounds[c + 1]]
    for k in range(above, below):
        for i in range(first, last):
            t = 0.0
            for j in range(first, last):
                t += scratch.stiffness[i, j - first] * scratch.shift_direction[k, j]
            matrix[i - first, shifted + k] = t
    for i in range(above, below):
        unshifted = is_unshifted(plan, scratch, i)
        # the second row of a constraint: its rate, or what yields between its position, its rate and its reaction
        augmented = is_augmented(plan.rows[i])
        k_x, k_v = augmented_stiffness(plan.data, plan.rows[i]) if augmented else (0.0, 1.0)
        if holds_position_alone(plan, scratch, i):
            k_x, k_v = 1.0, 0.0
        total = k_x * per_x + k_v * per_v
        for j in range(first, last):
            x = scratch.tangent.jacobian[i, plan.free[j]]
            matrix[pushed + i, j - first] = 0.0 if unshifted else x
            v = scratch.tangent.rate_jacobian[i, plan.free[j]]
            matrix[shifted + i, j - first] = (k_x * per_x * x + k_v * v) / total
        for k in range(above, below):
            t = 0.0
            r = 0.0
            for j in range(first, last):
                x = scratch.tangent.jacobian[i, plan.free[j]]
                t += x * scratch.shift_direction[k, j]
                r += (k_x * per_x * x + k_v * scratch.rate_stiffness[i, j - first]) * scratch.shift_direction[k, j]
            same = 1.0 if i == k else 0.0
            matrix[pushed + i, pushed + k] = 0.0
            matrix[shifted + i, pushed + k] = -same / total if augmented else 0.0
            matrix[pushed + i, shifted + k] = same if unshifted else t
            matrix[shifted + i, shifted + k] = r / total


@kernel
def _measure_row_pivot(plan, state, scratch):
    """Factor C B^-1 C^T by ``s.shift_direction``, block by block; write its smallest pivot into ``s.least_pivot``."""
    blocks = scratch.tangent.blocks
    longest = scratch.memory.row_length
    least = 1.0
    for c in range(blocks.velocity.shape[0]):
        above, below = between(blocks.rows, c)
        for i in range(above, below):
            for k in range(above, i + 1):
                scratch.row_factors[i, k] = 0.0
                for j in range(*between(blocks.free, c)):
                    push = scratch.shift_direction[k, j]
                    scratch.row_factors[i, k] += scratch.tangent.jacobian[i, plan.free[j]] * push
        rank = factor_rows(longest, scratch.row_factors, above, below, scratch.row_order)
        scratch.row_rank[c] = rank
        least = min(least, least_pivot(scratch.row_factors, above, below, rank))
    st.watch_pivot(state, least)
    scratch.least_pivot[0] = least if least > 0.0 else RANK_FLOOR


@deferred_kernel(FLAG)
def _put_shifts(plan, state, scratch, per_x, per_v):
    """Find the motion by a unit reaction, along which positions are shifted, and fill its columns.

    False if the tree's matrix is singular.
    """
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        above, below = between(blocks.rows, c)
        begin = scratch.bounds[c]
        for i in range(first, last):
            row = scratch.matrix[begin + i - first]
            for j in range(first, last):
                scratch.tree_matrix[i, j - first] = row[j - first]
            for k in range(above, below):
                scratch.shift_direction[k, i] = row[last - first + k - above]
        if factor_part(plan.lapack, scratch.tree_matrix, first, last, scratch.tree_pivot, scratch.sizes) != 0:
            return False
        solve_part(
            plan.lapack,
            scratch.tree_matrix,
            first,
            last,
            scratch.tree_pivot,
            scratch.sizes,
            scratch.shift_direction,
            above,
            below,
        )
    _measure_row_pivot(plan, state, scratch)
    for c in range(blocks.velocity.shape[0]):
        _put_shift_columns(plan, scratch, c, per_x, per_v)
    return True


@kernel
def _is_finite(scratch):
    for c in range(scratch.bounds.shape[0] - 1):
        first, last = between(scratch.bounds, c)
        for i in range(first, last):
            for j in range(last - first):
                if not np.isfinite(scratch.matrix[i, j]):
                    return False
    return True


@deferred_kernel(FLAG)
def _recur(plan, work, scratch, per_x, per_v):
    """Factor by the recursion over the tree; False if a pivot is too small."""
    call_separate(
        scratch.kernels[1],
        (
            plan,
            work,
            scratch.tangent,
            scratch.recursion,
            scratch.x,
            scratch.v,
            scratch.a,
            per_x,
            per_v,
            1.0,
        ),
    )
    scratch.pivot[0] = _OF_RECURSION
    return factor_recursion(plan, scratch.recursion)


@deferred_kernel()
def _solve_recursion(plan, scratch, rhs):
    solve_recursion(plan, scratch.recursion, rhs)


@deferred_kernel(FLAG)
def _linearise_sparse(plan, work, state, scratch, per_x, per_v):
    """Build and factor the sparse matrix of a tree; False if a pivot is worthless."""
    assemble(plan, work, scratch, per_x, per_v, 1.0)
    if factor_sparse(scratch.sparse.pattern, scratch.sparse.matrix):
        return True
    tell_worthless(plan, state, scratch.tangent, scratch.sparse.to, scratch.sparse.matrix)
    return False


@deferred_kernel()
def _solve_sparse(scratch, rhs):
    """Solve with its factors; unknowns of cut bodies come last, and no force acts on them."""
    sparse = scratch.sparse
    right = sparse.rhs[0]
    for q in range(rhs.shape[0]):
        for i in range(rhs.shape[1]):
            right[i] = rhs[q, i]
        for i in range(rhs.shape[1], right.shape[0]):
            right[i] = 0.0
        solve_sparse(sparse.pattern, sparse.matrix, sparse.rhs)
        for i in range(rhs.shape[1]):
            rhs[q, i] = right[i]


@kernel
def linearise(plan, work, state, scratch, h):
    """Build and factor the iteration matrix at the last trial; False if it is singular."""
    m = plan.rows.shape[0]
    per_x, per_v = coefficients(scratch.memory.scheme, h)
    state.counts[st.FACTORISATIONS] += 1
    scratch.memory.step_factored[0] = h
    scratch.memory.contraction[0] = 1.0
    if scratch.recursion.number.shape[0] > 0 and _recur(plan, work, scratch, per_x, per_v):
        return True
    if is_sparse(scratch):
        scratch.pivot[0] = _OF_SPARSE
        if m > 0:
            return linearise_loops(plan, work, state, scratch, per_x, per_v)
        return _linearise_sparse(plan, work, state, scratch, per_x, per_v)
    _put_derivatives(plan, work, scratch, per_x, per_v)
    if m > 0 and not _put_shifts(plan, state, scratch, per_x, per_v):
        return False
    if not _is_finite(scratch):
        return False
    return factor_blocks(plan.lapack, scratch.matrix, scratch.bounds, scratch.pivot, scratch.sizes)


@kernel
def solve_factored(plan, scratch, rhs):
    """Solve with the iteration matrix's factors; each row of ``rhs`` is one right-hand side, in place."""
    if scratch.matrix.shape[0] == 1:  # where LAPACK's call would be most of the time
        for q in range(rhs.shape[0]):
            rhs[q, 0] /= scratch.matrix[0, 0]
    elif scratch.pivot[0] == _OF_RECURSION:
        _solve_recursion(plan, scratch, rhs)
    elif scratch.pivot[0] == _OF_SPARSE:
        if plan.rows.shape[0] > 0:
            solve_loops(plan, scratch, rhs)
        else:
            _solve_sparse(scratch, rhs)
    elif scratch.bounds.shape[0] == 2:
        solve(plan.lapack, scratch.matrix, scratch.pivot, scratch.sizes, rhs)
    else:
        _solve_blocks(plan, scratch, rhs)


@deferred_kernel()
def _solve_blocks(plan, scratch, rhs):
    blocks, bounds, pivot = scratch.tangent.blocks, scratch.bounds, scratch.pivot
    solve_sorted(plan.lapack, scratch.matrix, blocks, bounds, pivot, scratch.sizes, rhs, scratch.sorted_rhs)
