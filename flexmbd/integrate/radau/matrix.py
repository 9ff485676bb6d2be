"""Iteration matrices of a Radau IIA step: the tangent, a real and a complex factorisation, their use."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.radau.coefficients import BASIS, BASIS_INVERSE, COMPLEX, REAL, STAGES
from flexmbd.integrate.radau.recursion_matrices import (
    factor_recursions,
    put_tree_imbalance,
    recurs,
    solve_complex_recursion,
    solve_real_recursion,
    take_parts,
)
from flexmbd.integrate.radau.sparse_stages import (
    factor_both,
    is_sparse,
    put_block_imbalance,
    solve_complex_blocks,
    solve_real_blocks,
    take_blocks,
)
from flexmbd.integrate.radau.stages import evaluate_stage
from flexmbd.integrate.radau.workspace import TANGENT_AFTER_RESIDUAL
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.native import factor_part, solve, solve_part
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.elements.changing_stiffness import take_stiffness
from flexmbd.multibody.kernels.inverse_dynamics.letting_go import count_touching
from flexmbd.multibody.kernels.reading.plan_entries import holds_position
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, factor_blocks, solve_sorted


@kernel
def _take_free(plan, scratch, out):
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for i in range(first, last):
            for j in range(first, last):
                out[i, j - first] = scratch.full_tangent[plan.free[i], plan.free[j]]


@kernel
def _take_rows(plan, blocks, rows, out):
    for c in range(blocks.velocity.shape[0]):
        for r in range(*between(blocks.rows, c)):
            for j in range(*between(blocks.free, c)):
                out[r, j] = rows[r, plan.free[j]]


@kernel
def derive(plan, work, scratch, i, per_x, per_v, per_a):
    """Weighted tangent at stage i, where the residual was evaluated last, into ``s.full_tangent``."""
    call_separate(
        scratch.kernels[TANGENT_AFTER_RESIDUAL],
        (
            plan,
            work,
            scratch.tangent,
            scratch.x[i],
            scratch.v[i],
            scratch.a[i],
            scratch.multipliers[i],
            per_x,
            per_v,
            per_a,
            scratch.full_tangent,
        ),
    )


@kernel
def take_tangent(plan, work, state, scratch, stage):
    """M, damping, stiffness and the rows' derivatives at the guess of stage ``stage``; whether all is finite."""
    scratch.uses_transform[0] = 0
    evaluate_stage(plan, work, state, scratch, stage)
    if scratch.tangent_stiffness.shape[0] > 0:
        take_stiffness(plan, work, scratch.scale_x, scratch.x[stage], scratch.v[stage], scratch.tangent_stiffness)
    if scratch.tangent_touched.shape[0] > 0:
        scratch.tangent_touched[:] = 0.0
        x, v = scratch.x[stage], scratch.v[stage]
        count_touching(plan, work, x, v, scratch.tangent_touched, scratch.gaps[stage])
        evaluate_stage(plan, work, state, scratch, stage)  # whose motion ``work`` is to hold
    scratch.memory.tangent_serves[0] = 1
    scratch.memory.step_factored[0] = 0.0
    if recurs(scratch):
        return take_parts(plan, work, scratch, stage)
    if is_sparse(scratch):
        return take_blocks(plan, work, scratch, stage)
    derive(plan, work, scratch, stage, 1.0, 0.0, 0.0)
    _take_free(plan, scratch, scratch.stiffness)
    _take_rows(plan, scratch.tangent.blocks, scratch.tangent.rate_jacobian, scratch.rate_jacobian)
    derive(plan, work, scratch, stage, 0.0, 1.0, 0.0)
    _take_free(plan, scratch, scratch.damping)
    derive(plan, work, scratch, stage, 0.0, 0.0, 1.0)
    _take_free(plan, scratch, scratch.mass)
    _take_rows(plan, scratch.tangent.blocks, scratch.tangent.jacobian, scratch.jacobian)
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for i in range(first, last):
            for j in range(last - first):
                if not np.isfinite(scratch.stiffness[i, j] + scratch.damping[i, j] + scratch.mass[i, j]):
                    return False
    return True


@kernel
def put_imbalance(plan, scratch, step):
    """Write M ``s.error_v`` - ``step`` K ``s.error_x``, and what ``s.error_x`` opens of rows, into ``s.rhs_real``."""
    if recurs(scratch):
        put_tree_imbalance(plan, scratch, step)
        return
    if is_sparse(scratch):
        put_block_imbalance(plan, scratch, step)
        return
    blocks = scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for i in range(first, last):
            total = 0.0
            for j in range(first, last):
                k = j - first
                total += scratch.mass[i, k] * scratch.error_v[j] - step * scratch.stiffness[i, k] * scratch.error_x[j]
            scratch.rhs_real[0, i] = total
    _put_openings(plan, scratch, step)


@kernel
def _put_openings(plan, scratch, step):
    """What ``s.error_x`` opens of the rows: of positions over the step, and of rates."""
    nu, m, blocks = plan.free.shape[0], plan.rows.shape[0], scratch.tangent.blocks
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for r in range(*between(blocks.rows, c)):
            opening = 0.0
            swing = 0.0
            for j in range(first, last):
                opening -= scratch.jacobian[r, j] * scratch.error_x[j]
                swing -= scratch.rate_jacobian[r, j] * scratch.error_x[j]
            holds = holds_position(plan.rows[r])
            scratch.rhs_real[0, nu + r] = opening / step if holds else 0.0
            scratch.rhs_real[0, nu + m + r] = swing


@kernel
def _fill_matrix(plan, scratch, step, matrix):
    """Iteration matrix of one eigenvalue, block by block: ``step`` is the step over it.

    Unknowns a, nu, kappa; rows of the motion, of positions over step^2, of rates over step.
    """
    for c in range(scratch.bounds.shape[0] - 1):
        _fill_block(plan, scratch, c, step, matrix)


@kernel
def _fill_block(plan, scratch, c, step, matrix):
    blocks = scratch.tangent.blocks
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    pushed = last - first - above  # where nu and kappa stand in the block
    shifted = pushed + below - above
    block = matrix[scratch.bounds[c] : scratch.bounds[c + 1]]
    for i in range(first, last):
        for j in range(first, last):
            k = j - first
            block[i - first, k] = scratch.mass[i, k] + step * (
                scratch.damping[i, k] + step * scratch.stiffness[i, k]
            )
        for r in range(above, below):
            push = 0.0
            for j in range(first, last):
                push += scratch.stiffness[i, j - first] * scratch.shift_direction[r, j]
            block[i - first, pushed + r] = scratch.jacobian[r, i]
            block[i - first, shifted + r] = step * step * push
    for r in range(above, below):
        for j in range(first, last):
            block[pushed + r, j - first] = scratch.jacobian[r, j]
            block[shifted + r, j - first] = scratch.jacobian[r, j] + step * scratch.rate_jacobian[r, j]
        for q in range(above, below):
            gain = 0.0
            swing = 0.0
            for j in range(first, last):
                gain += scratch.jacobian[r, j] * scratch.shift_direction[q, j]
                swing += scratch.rate_jacobian[r, j] * scratch.shift_direction[q, j]
            block[pushed + r, pushed + q] = 0.0
            block[shifted + r, pushed + q] = 0.0
            block[pushed + r, shifted + q] = gain
            block[shifted + r, shifted + q] = step * swing
        if not holds_position(plan.rows[r]):  # no position to shift: kappa = 0
            for j in range(first, last):
                block[pushed + r, j - first] = 0.0
            for q in range(above, below):
                block[pushed + r, shifted + q] = 1.0 if q == r else 0.0


@deferred_kernel(FLAG)
def _shift_directions(plan, scratch, h):
    """D: the motion within the step by a unit reaction, stiffness included; False if singular."""
    for c in range(scratch.bounds.shape[0] - 1):
        if not _block_shift_directions(plan, scratch, c, h / REAL):
            return False
    return True


@kernel
def _block_shift_directions(plan, scratch, c, step):
    blocks = scratch.tangent.blocks
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    for i in range(first, last):
        for j in range(first, last):
            k = j - first
            scratch.tree_matrix[i, k] = scratch.mass[i, k] + step * (
                scratch.damping[i, k] + step * scratch.stiffness[i, k]
            )
    for r in range(above, below):
        for j in range(first, last):
            scratch.row_response[r, j] = scratch.jacobian[r, j]
    matrix, pivot, sizes = scratch.tree_matrix, scratch.pivot_real, scratch.sizes
    if factor_part(plan.lapack, matrix, first, last, pivot, sizes) != 0:
        return False
    solve_part(plan.lapack, matrix, first, last, pivot, sizes, scratch.row_response, above, below)
    for r in range(above, below):
        holds = holds_position(plan.rows[r])
        for j in range(first, last):
            scratch.shift_direction[r, j] = scratch.row_response[r, j] if holds else 0.0
        for q in range(above, below):
            scratch.row_matrix[r, q] = 0.0
            for j in range(first, last):
                scratch.row_matrix[r, q] += scratch.jacobian[r, j] * scratch.row_response[q, j]
    return True


@kernel
def factor_step(plan, state, scratch, h):
    """Factor both iteration matrices for the step h with the tangent at hand; False if singular."""
    state.counts[st.FACTORISATIONS] += 1
    scratch.memory.step_factored[0] = h
    if recurs(scratch):
        return factor_recursions(plan, scratch, h)
    if is_sparse(scratch):
        return factor_both(plan, state, scratch, h)
    if plan.rows.shape[0] > 0 and not _shift_directions(plan, scratch, h):
        return False
    _fill_matrix(plan, scratch, h / REAL + 0.0, scratch.real_matrix)
    _fill_matrix(plan, scratch, h / COMPLEX, scratch.complex_matrix)
    bounds, sizes = scratch.bounds, scratch.sizes
    if not factor_blocks(plan.lapack, scratch.real_matrix, bounds, scratch.pivot_real, sizes):
        return False
    return factor_blocks(scratch.lapack_complex, scratch.complex_matrix, bounds, scratch.pivot_complex, sizes)


@kernel
def _put_push(scratch, rhs, push):
    """Write D times kappa, the last of a solution (n,), into ``push`` (nu,)."""
    blocks, direction = scratch.tangent.blocks, scratch.shift_direction
    begin = rhs.shape[0] - direction.shape[0]
    for c in range(blocks.velocity.shape[0]):
        first, last = between(blocks.free, c)
        for j in range(first, last):
            push[j] = 0.0
        for r in range(*between(blocks.rows, c)):
            kappa = rhs[begin + r]
            for j in range(first, last):
                push[j] += direction[r, j] * kappa


@kernel
def solve_real(plan, scratch):
    """Solve with the real iteration matrix for ``s.rhs_real``, in place; where there are rows, ``s.push_real``."""
    if recurs(scratch):
        solve_real_recursion(plan, scratch)
        return
    if is_sparse(scratch):
        solve_real_blocks(plan, scratch)
        return
    if scratch.bounds.shape[0] == 2:
        solve(plan.lapack, scratch.real_matrix, scratch.pivot_real, scratch.sizes, scratch.rhs_real)
    else:
        blocks, bounds, sizes = scratch.tangent.blocks, scratch.bounds, scratch.sizes
        rhs, sorted_rhs = scratch.rhs_real, scratch.sorted_real
        solve_sorted(plan.lapack, scratch.real_matrix, blocks, bounds, scratch.pivot_real, sizes, rhs, sorted_rhs)
    if plan.rows.shape[0] > 0:
        _put_push(scratch, scratch.rhs_real[0], scratch.push_real)


@kernel
def _solve_complex(plan, scratch):
    if recurs(scratch):
        solve_complex_recursion(plan, scratch)
        return
    if is_sparse(scratch):
        solve_complex_blocks(plan, scratch)
        return
    if scratch.bounds.shape[0] == 2:
        matrix, pivot = scratch.complex_matrix, scratch.pivot_complex
        solve(scratch.lapack_complex, matrix, pivot, scratch.sizes, scratch.rhs_complex)
    else:
        blocks, bounds, sizes = scratch.tangent.blocks, scratch.bounds, scratch.sizes
        rhs, sorted_rhs = scratch.rhs_complex, scratch.sorted_complex
        matrix, pivot = scratch.complex_matrix, scratch.pivot_complex
        solve_sorted(scratch.lapack_complex, matrix, blocks, bounds, pivot, sizes, rhs, sorted_rhs)
    if plan.rows.shape[0] > 0:
        _put_push(scratch, scratch.rhs_complex[0], scratch.push_complex)


@kernel
def _add_pushes(scratch):
    """Add the corrections' pushes to those of the stages."""
    for j in range(scratch.push_real.shape[0]):
        w0, w1, w2 = scratch.push_real[j], scratch.push_complex[j].real, scratch.push_complex[j].imag
        for i in range(STAGES):
            scratch.pushed[i, j] += BASIS[i, 0] * w0 + BASIS[i, 1] * w1 + BASIS[i, 2] * w2


@kernel
def _transform_rows(scratch, nu, m):
    """Multiply the stages' row residuals by T_i, for the rows of the tangent (see ``row_transforms``)."""
    blocks = scratch.tangent.blocks
    for i in range(STAGES):
        for c in range(scratch.bounds.shape[0] - 1):
            for r in range(*between(blocks.rows, c)):
                scratch.transformed[0, r] = 0.0
                scratch.transformed[1, r] = 0.0
                for q in range(*between(blocks.rows, c)):
                    scratch.transformed[0, r] += scratch.row_transform[i, r, q] * scratch.equation[i, nu + q]
                    scratch.transformed[1, r] += scratch.row_transform[i, r, q] * scratch.equation[i, nu + m + q]
        for r in range(m):
            scratch.equation[i, nu + r] = scratch.transformed[0, r]
            scratch.equation[i, nu + m + r] = scratch.transformed[1, r]


@kernel
def correct_stages(plan, scratch, h):
    """One Newton correction of the stages' unknowns by their equations (Hairer & Wanner 1996, eq. IV.8.8-8.10)."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    n = nu + 2 * m
    equation = scratch.equation
    if scratch.uses_transform[0] == 1:
        _transform_rows(scratch, nu, m)
    for j in range(n):
        factor_real = -1.0
        factor_complex = complex(-1.0, 0.0)
        if j >= nu + m:
            factor_real *= REAL / h
            factor_complex *= COMPLEX / h
        elif j >= nu:
            if not holds_position(plan.rows[j - nu]):
                for i in range(STAGES):
                    equation[i, j] = scratch.shift[i, j - nu]
            else:
                factor_real *= (REAL / h) ** 2
                factor_complex *= (COMPLEX / h) ** 2
        e0, e1, e2 = equation[0, j], equation[1, j], equation[2, j]
        scratch.rhs_real[0, j] = factor_real * (
            BASIS_INVERSE[0, 0] * e0 + BASIS_INVERSE[0, 1] * e1 + BASIS_INVERSE[0, 2] * e2
        )
        scratch.rhs_complex[0, j] = factor_complex * complex(
            BASIS_INVERSE[1, 0] * e0 + BASIS_INVERSE[1, 1] * e1 + BASIS_INVERSE[1, 2] * e2,
            BASIS_INVERSE[2, 0] * e0 + BASIS_INVERSE[2, 1] * e1 + BASIS_INVERSE[2, 2] * e2,
        )
    solve_real(plan, scratch)
    _solve_complex(plan, scratch)
    for j in range(n):
        w0 = scratch.rhs_real[0, j]
        w1 = scratch.rhs_complex[0, j].real
        w2 = scratch.rhs_complex[0, j].imag
        for i in range(STAGES):
            change = BASIS[i, 0] * w0 + BASIS[i, 1] * w1 + BASIS[i, 2] * w2
            if j < nu:
                scratch.a[i, plan.free[j]] += change
            elif j < nu + m:
                if scratch.uses_transform[0] == 0:
                    scratch.multipliers[i, j - nu] += change
                else:
                    for r in range(m):  # zeros apart from the row's own block
                        scratch.multipliers[i, r] += scratch.row_transform[i, j - nu, r] * change
            else:
                scratch.shift[i, j - nu - m] += change
    if m > 0:
        _add_pushes(scratch)
