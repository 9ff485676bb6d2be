"""The iteration matrix of a step of generalized-alpha: the tangent, the columns of the shifts, its factors."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.workspace import (
    coefficients,
    holds_position_alone,
    is_unshifted,
)
from flexmbd.integrate.explicit.loop_dynamics import factor_rows
from flexmbd.multibody.kernels.algebra.rank_revealing import RANK_FLOOR
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import augmented_stiffness, is_augmented
from flexmbd.multibody.kernels.tangent.residual_tangent import turn_columns
from flexmbd.multibody.kernels.tangent.tree_factor import factor_tree, solve_tree

_OF_TREE = -1  # in place of LAPACK's first pivot: the factors are those of the tree


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
    nu = plan.free.shape[0]
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
        for i in range(nu):
            for j in range(nu):
                scratch.tree_matrix[i, j] = -scratch.full_tangent[plan.free[i], plan.free[j]]
        turn_columns(plan, scratch.displacement, scratch.full_tangent)
        turn_columns(plan, scratch.displacement, tw.rate_jacobian)
        for i in range(nu):
            for j in range(nu):
                scratch.stiffness[i, j] = scratch.full_tangent[plan.free[i], plan.free[j]]
                scratch.tree_matrix[i, j] += scratch.stiffness[i, j]
        for i in range(m):
            for j in range(nu):
                scratch.rate_stiffness[i, j] = tw.rate_jacobian[i, plan.free[j]]
    for i in range(nu):
        for j in range(nu):
            scratch.matrix[i, j] = scratch.full_tangent[plan.free[i], plan.free[j]]
            if turned:
                scratch.matrix[i, j] += scratch.tree_matrix[i, j]
        for k in range(m):
            scratch.matrix[i, nu + k] = tw.jacobian[k, plan.free[i]]
    turn_columns(plan, scratch.displacement, tw.jacobian)


@kernel
def _put_shift_columns(plan, state, scratch, per_x, per_v):
    """Fill the columns of the shifts of positions along ``s.shift_direction``, and the rows that hold the loops."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    for k in range(m):
        for i in range(nu):
            t = 0.0
            for j in range(nu):
                t += scratch.stiffness[i, j] * scratch.shift_direction[k, j]
            scratch.matrix[i, nu + m + k] = t
    for i in range(m):
        unshifted = is_unshifted(plan, scratch, i)
        # the second row of a constraint: its rate, or what yields between its position, its rate and its reaction
        augmented = is_augmented(plan.rows[i])
        k_x, k_v = augmented_stiffness(plan.data, plan.rows[i]) if augmented else (0.0, 1.0)
        if holds_position_alone(plan, scratch, i):
            k_x, k_v = 1.0, 0.0
        total = k_x * per_x + k_v * per_v
        for j in range(nu):
            x = scratch.tangent.jacobian[i, plan.free[j]]
            scratch.matrix[nu + i, j] = 0.0 if unshifted else x
            v = scratch.tangent.rate_jacobian[i, plan.free[j]]
            scratch.matrix[nu + m + i, j] = (k_x * per_x * x + k_v * v) / total
        for k in range(m):
            t = 0.0
            r = 0.0
            for j in range(nu):
                x = scratch.tangent.jacobian[i, plan.free[j]]
                t += x * scratch.shift_direction[k, j]
                r += (k_x * per_x * x + k_v * scratch.rate_stiffness[i, j]) * scratch.shift_direction[k, j]
            own = 1.0 if i == k else 0.0
            scratch.matrix[nu + i, nu + k] = 0.0
            scratch.matrix[nu + m + i, nu + k] = -own / total if augmented else 0.0
            scratch.matrix[nu + i, nu + m + k] = own if unshifted else t
            scratch.matrix[nu + m + i, nu + m + k] = r / total


@kernel
def _measure_row_pivot(plan, state, scratch):
    """Write the rows' smallest pivot into ``s.least_pivot``, by ``s.shift_direction``."""
    m = plan.rows.shape[0]
    for i in range(m):
        for k in range(i + 1):
            scratch.row_factors[i, k] = 0.0
            for j in range(plan.free.shape[0]):
                scratch.row_factors[i, k] += scratch.tangent.jacobian[i, plan.free[j]] * scratch.shift_direction[k, j]
    rank = factor_rows(state, scratch.memory.row_length, scratch.row_factors, scratch.row_order)
    scratch.row_rank[0] = rank
    scratch.least_pivot[0] = scratch.row_factors[m - 1, m - 1] ** 2 if rank == m else RANK_FLOOR


@deferred_kernel(FLAG)
def _put_shifts(plan, state, scratch, per_x, per_v):
    """Find the motion by a unit reaction, along which positions are shifted, and fill its columns.

    False if the tree's matrix is singular.
    """
    for i in range(plan.free.shape[0]):
        for j in range(plan.free.shape[0]):
            scratch.tree_matrix[i, j] = scratch.matrix[i, j]
        for k in range(plan.rows.shape[0]):
            scratch.shift_direction[k, i] = scratch.matrix[i, plan.free.shape[0] + k]
    if factor(plan.lapack, scratch.tree_matrix, scratch.tree_pivot, scratch.sizes) != 0:
        return False
    solve(plan.lapack, scratch.tree_matrix, scratch.tree_pivot, scratch.sizes, scratch.shift_direction)
    _measure_row_pivot(plan, state, scratch)
    _put_shift_columns(plan, state, scratch, per_x, per_v)
    return True


@kernel
def linearise(plan, work, state, scratch, h):
    """Build and factor the iteration matrix at the last trial; False if it is singular."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    n = nu + 2 * m
    per_x, per_v = coefficients(scratch.memory.scheme, h)
    state.counts[st.FACTORISATIONS] += 1
    scratch.memory.step_factored[0] = h
    scratch.memory.contraction[0] = 1.0
    _put_derivatives(plan, work, scratch, per_x, per_v)
    if m > 0 and not _put_shifts(plan, state, scratch, per_x, per_v):
        return False
    for i in range(n):
        for j in range(n):
            if not np.isfinite(scratch.matrix[i, j]):
                return False
    scratch.pivot[0] = _OF_TREE
    if scratch.ancestors.shape[0] > 0 and factor_tree(scratch.ancestors, scratch.matrix):
        return True
    if scratch.ancestors.shape[0] > 0:  # it failed without pivoting, and is overwritten
        for i in range(nu):
            for j in range(nu):
                scratch.matrix[i, j] = scratch.full_tangent[plan.free[i], plan.free[j]]
    return factor(plan.lapack, scratch.matrix, scratch.pivot, scratch.sizes) == 0


@kernel
def solve_factored(plan, scratch, rhs):
    """Solve with the iteration matrix's factors; each row of ``rhs`` is one right-hand side, in place."""
    if scratch.pivot[0] == _OF_TREE:
        solve_tree(scratch.ancestors, scratch.matrix, rhs)
    else:
        solve(plan.lapack, scratch.matrix, scratch.pivot, scratch.sizes, rhs)
