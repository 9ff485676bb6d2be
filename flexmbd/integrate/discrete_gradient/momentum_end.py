"""The end of an energy-momentum step: its mass matrix, velocities from momenta, accelerations, multipliers.

The mass matrix is that of the tangent, factored densely block by block or as a sparse one.  With constraint rows
momenta are projected, p - C^T mu, so that velocities close the loops too.  ``scratch`` is an
``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.discrete_gradient.sparse_matrices import factor_sparse_mass, is_sparse, solve_sparse_mass
from flexmbd.integrate.discrete_gradient.workspace import CONSTRAINTS, RESIDUAL, SINGULAR, TANGENT
from flexmbd.integrate.explicit.loop_dynamics import NO_REACTION
from flexmbd.multibody.kernels.algebra.rank_revealing import factor_block, solve_block
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.native import solve_part
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import driven_place
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, factor_blocks, solve_blocks


@entry_kernel
def factor_end_mass(plan, work, scratch):
    """Write M(s.x_end) into ``s.full_matrix`` and factor its free part; ``s.energy[SINGULAR]``: 1 if that failed.

    Leaves in ``work`` the positions there, at rest, and C in ``s.tangent.jacobian``.
    """
    none = scratch.zero_multipliers
    call_separate(
        scratch.kernels[RESIDUAL], (plan, work, scratch.x_end, scratch.zeros, scratch.zeros, none, scratch.scratch_v)
    )
    if is_sparse(scratch):
        scratch.energy[SINGULAR] = 0.0 if factor_sparse_mass(plan, work, scratch) else 1.0
        return
    call_separate(
        scratch.kernels[TANGENT],
        (
            plan,
            work,
            scratch.tangent,
            scratch.x_end,
            scratch.zeros,
            scratch.zeros,
            none,
            0.0,
            0.0,
            1.0,
            scratch.full_matrix,
        ),
    )
    free = plan.free
    bounds = scratch.tangent.blocks.free
    finite = True
    for c in range(bounds.shape[0] - 1):
        for i in range(*between(bounds, c)):
            for j in range(*between(bounds, c)):
                entry = scratch.full_matrix[free[i], free[j]]
                scratch.mass[i, j - bounds[c]] = entry
                finite = finite and np.isfinite(entry)
    scratch.energy[SINGULAR] = 1.0
    if finite and factor_blocks(plan.lapack, scratch.mass, bounds, scratch.mass_pivot, scratch.sizes):
        scratch.energy[SINGULAR] = 0.0


@kernel
def solve_end_mass(plan, scratch):
    """Solve with the factors of M at the end for ``s.mass_rhs``, in place."""
    if is_sparse(scratch):
        solve_sparse_mass(scratch)
        return
    bounds = scratch.tangent.blocks.free
    solve_blocks(plan.lapack, scratch.mass, bounds, scratch.mass_pivot, scratch.sizes, scratch.mass_rhs)


@kernel
def _factor_rows(plan, loops, scratch):
    """Factor C M^-1 C^T at the end, with the factors of M and the C that ``factor_end_mass`` left."""
    d = 0  # blocks that have rows
    for c in range(scratch.bounds.shape[0] - 1):
        if scratch.tangent.blocks.rows[c + 1] > scratch.tangent.blocks.rows[c]:
            loops.rank[d] = _factor_row_block(plan, loops, scratch, c)
            d += 1


@kernel
def _factor_row_block(plan, loops, scratch, c):
    """Block c of ``_factor_rows``; its rank."""
    blocks = scratch.tangent.blocks
    first, last = between(blocks.free, c)
    above, below = between(blocks.rows, c)
    response = scratch.response
    for i in range(above, below):
        for j in range(first, last):
            response[i, j] = scratch.tangent.jacobian[i, plan.free[j]]
    solve_part(
        plan.lapack, scratch.mass, first, last, scratch.mass_pivot, scratch.sizes, response, above, below
    )
    for i in range(above, below):
        for j in range(above, i + 1):
            total = 0.0
            for k in range(first, last):
                total += scratch.tangent.jacobian[i, plan.free[k]] * response[j, k]
            loops.row_factors[i, j] = total
            loops.row_factors[j, i] = total
        loops.row_norm[i] = np.sqrt(loops.row_factors[i, i])
    return factor_block(loops.row_factors, above, below, loops.row_order, loops.row_scale)


@kernel
def _minimum_norm_motion(plan, loops, scratch, ranks, rows, out):
    """out = M^-1 C^T (C M^-1 C^T)^-1 rows, with the factors at hand; the multipliers in ``loops.solution``."""
    blocks = scratch.tangent.blocks
    factors, order, scale = loops.row_factors, loops.row_order, loops.row_scale
    for k in range(out.shape[0]):
        out[k] = 0.0
    d = 0
    for c in range(scratch.bounds.shape[0] - 1):
        above, below = between(blocks.rows, c)
        if below == above:
            continue
        solve_block(factors, above, below, ranks[d], order, scale, rows, loops.scratch, loops.solution)
        d += 1
        for i in range(above, below):
            for j in range(*between(blocks.free, c)):
                out[plan.free[j]] += loops.solution[i] * scratch.response[i, j]


@entry_kernel
def close_velocities(plan, loops, scratch):
    """Write ``s.v_end``: the prescribed rates, and others by M v = p in their rows, projected onto the loops.

    ``s.p_end`` is projected as well.  ``factor_end_mass`` must have been called.
    """
    p = scratch.p_end
    for i in range(plan.driven.shape[0]):
        scratch.v_end[driven_place(plan.driven[i])[1]] = scratch.driven[i, 1]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.mass_rhs[0, j] = p[k]
        for i in range(plan.driven.shape[0]):
            scratch.mass_rhs[0, j] -= scratch.full_matrix[k, driven_place(plan.driven[i])[1]] * scratch.driven[i, 1]
    solve_end_mass(plan, scratch)
    for j in range(plan.free.shape[0]):
        scratch.v_end[plan.free[j]] = scratch.mass_rhs[0, j]
    if plan.rows.shape[0] > 0:
        _close_loops(plan, loops, scratch)


@deferred_kernel()
def _close_loops(plan, loops, scratch):
    """Project ``s.v_end`` and ``s.p_end`` onto the loops."""
    p = scratch.p_end
    _factor_rows(plan, loops, scratch)
    blocks = scratch.tangent.blocks
    jacobian = scratch.tangent.jacobian
    for c in range(scratch.bounds.shape[0] - 1):
        for i in range(*between(blocks.rows, c)):
            loops.phi[i] = -scratch.row_end[i, 1]
            for j in range(*between(blocks.free, c)):
                loops.phi[i] += jacobian[i, plan.free[j]] * scratch.v_end[plan.free[j]]
            for j in range(blocks.driven.shape[0]):
                loops.phi[i] += jacobian[i, blocks.driven[j]] * scratch.v_end[blocks.driven[j]]
    _minimum_norm_motion(plan, loops, scratch, loops.rank, loops.phi, loops.move)
    for k in range(p.shape[0]):
        scratch.v_end[k] -= loops.move[k]
    for c in range(scratch.bounds.shape[0] - 1):
        for i in range(*between(blocks.rows, c)):
            for j in range(*between(blocks.free, c)):
                p[plan.free[j]] -= jacobian[i, plan.free[j]] * loops.solution[i]
            for j in range(blocks.driven.shape[0]):
                p[blocks.driven[j]] -= jacobian[i, blocks.driven[j]] * loops.solution[i]


@kernel
def accelerate_end(plan, work, loops, scratch):
    """Write ``s.a_end`` and ``s.nu_end`` by ``s.x_end`` and ``s.v_end``, with the factors that belong to them.

    ``work.time`` must be that of the end.
    """
    none = scratch.zero_multipliers
    for k in range(scratch.a_end.shape[0]):
        scratch.a_end[k] = 0.0
    for i in range(plan.driven.shape[0]):
        scratch.a_end[driven_place(plan.driven[i])[1]] = scratch.driven[i, 2]
    call_separate(
        scratch.kernels[RESIDUAL], (plan, work, scratch.x_end, scratch.v_end, scratch.a_end, none, scratch.scratch_v)
    )
    for j in range(plan.free.shape[0]):
        scratch.mass_rhs[0, j] = -scratch.scratch_v[plan.free[j]]
    solve_end_mass(plan, scratch)
    for j in range(plan.free.shape[0]):
        scratch.a_end[plan.free[j]] = scratch.mass_rhs[0, j]
    if plan.rows.shape[0] > 0:
        _add_reactions(plan, work, loops, scratch)


@deferred_kernel()
def _add_reactions(plan, work, loops, scratch):
    """Find the multipliers at the tree's accelerations ``s.a_end`` and add what they cause."""
    none = scratch.zero_multipliers
    call_separate(
        scratch.kernels[RESIDUAL], (plan, work, scratch.x_end, scratch.v_end, scratch.a_end, none, scratch.scratch_v)
    )
    call_separate(scratch.kernels[CONSTRAINTS], (plan, work, loops.phi, loops.rate, loops.rate2))
    for d in range(loops.rank.shape[0]):
        rank, first = loops.rank[d], loops.paths.block[d]
        least = NO_REACTION * loops.usual_pivot[d]
        while rank > 1 and loops.row_factors[first + rank - 1, first + rank - 1] ** 2 < least:
            rank -= 1
        loops.effective_rank[d] = rank
    _minimum_norm_motion(plan, loops, scratch, loops.effective_rank, loops.rate2, loops.move)
    for i in range(scratch.nu_end.shape[0]):
        scratch.nu_end[i] = loops.solution[i]
    for k in range(scratch.a_end.shape[0]):
        scratch.a_end[k] -= loops.move[k]
