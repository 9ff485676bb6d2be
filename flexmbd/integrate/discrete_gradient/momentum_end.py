"""The end of an energy-momentum step: its mass matrix, velocities from momenta, accelerations, multipliers.

The mass matrix is that of the tangent, factored densely.  With constraint rows momenta are projected, p - C^T mu,
so that velocities close the loops too.  ``scratch`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.discrete_gradient.workspace import CONSTRAINTS, RESIDUAL, SINGULAR, TANGENT
from flexmbd.integrate.explicit.loop_dynamics import NO_REACTION
from flexmbd.multibody.kernels.algebra.rank_revealing import factor_semidefinite, solve_semidefinite
from flexmbd.multibody.kernels.base.compiling import kernel, separate_kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import driven_place


@separate_kernel
def factor_end_mass(plan, work, scratch):
    """Write M(s.x_end) into ``s.full_matrix`` and factor its free part; ``s.energy[SINGULAR]``: 1 if that failed.

    Leaves in ``work`` the positions there, at rest, and C in ``s.tangent.jacobian``.
    """
    none = scratch.zero_multipliers
    call_separate(
        scratch.kernels[RESIDUAL], (plan, work, scratch.x_end, scratch.zeros, scratch.zeros, none, scratch.scratch_v)
    )
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
    finite = True
    for i in range(free.shape[0]):
        for j in range(free.shape[0]):
            scratch.mass[i, j] = scratch.full_matrix[free[i], free[j]]
            finite = finite and np.isfinite(scratch.mass[i, j])
    scratch.energy[SINGULAR] = 1.0
    if finite and factor(plan.lapack, scratch.mass, scratch.mass_pivot, scratch.sizes) == 0:
        scratch.energy[SINGULAR] = 0.0


@kernel
def _factor_rows(plan, loops, scratch):
    """Factor C M^-1 C^T at the end, with the factors of M and the C that ``factor_end_mass`` left."""
    m = plan.rows.shape[0]
    for i in range(m):
        for k in range(scratch.zeros.shape[0]):
            scratch.response[i, k] = 0.0
        for j in range(plan.free.shape[0]):
            scratch.free_response[i, j] = scratch.tangent.jacobian[i, plan.free[j]]
    solve(plan.lapack, scratch.mass, scratch.mass_pivot, scratch.sizes, scratch.free_response)
    for i in range(m):
        for j in range(plan.free.shape[0]):
            scratch.response[i, plan.free[j]] = scratch.free_response[i, j]
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(scratch.zeros.shape[0]):
                total += scratch.tangent.jacobian[i, k] * scratch.response[j, k]
            loops.row_factors[i, j] = total
            loops.row_factors[j, i] = total
    for i in range(m):
        loops.row_norm[i] = np.sqrt(loops.row_factors[i, i])
    loops.rank[0] = factor_semidefinite(loops.row_factors, loops.row_order, loops.row_scale)


@kernel
def _minimum_norm_motion(loops, scratch, rank, rows, out):
    """out = M^-1 C^T (C M^-1 C^T)^-1 rows, with the factors at hand; the multipliers in ``loops.solution``."""
    solve_semidefinite(loops.row_factors, rank, loops.row_order, loops.row_scale, rows, loops.scratch, loops.solution)
    for k in range(out.shape[0]):
        out[k] = 0.0
    for i in range(rows.shape[0]):
        for k in range(out.shape[0]):
            out[k] += loops.solution[i] * scratch.response[i, k]


@separate_kernel
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
    solve(plan.lapack, scratch.mass, scratch.mass_pivot, scratch.sizes, scratch.mass_rhs)
    for j in range(plan.free.shape[0]):
        scratch.v_end[plan.free[j]] = scratch.mass_rhs[0, j]
    if plan.rows.shape[0] > 0:
        _close_loops(plan, loops, scratch)


@deferred_kernel()
def _close_loops(plan, loops, scratch):
    """Project ``s.v_end`` and ``s.p_end`` onto the loops."""
    m = plan.rows.shape[0]
    p = scratch.p_end
    _factor_rows(plan, loops, scratch)
    for i in range(m):
        loops.phi[i] = -scratch.row_end[i, 1]
        for k in range(p.shape[0]):
            loops.phi[i] += scratch.tangent.jacobian[i, k] * scratch.v_end[k]
    _minimum_norm_motion(loops, scratch, loops.rank[0], loops.phi, loops.move)
    for k in range(p.shape[0]):
        scratch.v_end[k] -= loops.move[k]
        for i in range(m):
            p[k] -= scratch.tangent.jacobian[i, k] * loops.solution[i]


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
    solve(plan.lapack, scratch.mass, scratch.mass_pivot, scratch.sizes, scratch.mass_rhs)
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
    rank = loops.rank[0]
    while rank > 1 and loops.row_factors[rank - 1, rank - 1] ** 2 < NO_REACTION * loops.usual_pivot[0]:
        rank -= 1
    _minimum_norm_motion(loops, scratch, rank, loops.rate2, loops.move)
    for i in range(scratch.nu_end.shape[0]):
        scratch.nu_end[i] = loops.solution[i]
    for k in range(scratch.a_end.shape[0]):
        scratch.a_end[k] -= loops.move[k]
