"""The end of an energy-momentum step: its mass matrix, velocities from momenta, accelerations, multipliers.

The mass matrix is that of the tangent, factored densely.  With constraint rows momenta are projected, p - C^T mu,
so that velocities close the loops too.  ``s`` is an ``EnergyMomentumWorkspace``.
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
def factor_end_mass(plan, work, s):
    """Write M(s.x_end) into ``s.full_matrix`` and factor its free part; ``s.energy[SINGULAR]``: 1 if that failed.

    Leaves in ``work`` the positions there, at rest, and C in ``s.tangent.jacobian``.
    """
    none = s.zero_multipliers
    call_separate(s.kernels[RESIDUAL], (plan, work, s.x_end, s.zeros, s.zeros, none, s.scratch_v))
    call_separate(
        s.kernels[TANGENT], (plan, work, s.tangent, s.x_end, s.zeros, s.zeros, none, 0.0, 0.0, 1.0, s.full_matrix)
    )
    free = plan.free
    finite = True
    for i in range(free.shape[0]):
        for j in range(free.shape[0]):
            s.mass[i, j] = s.full_matrix[free[i], free[j]]
            finite = finite and np.isfinite(s.mass[i, j])
    s.energy[SINGULAR] = 1.0
    if finite and factor(plan.lapack, s.mass, s.mass_pivot, s.sizes) == 0:
        s.energy[SINGULAR] = 0.0


@kernel
def _factor_rows(plan, loops, s):
    """Factor C M^-1 C^T at the end, with the factors of M and the C that ``factor_end_mass`` left."""
    m = plan.rows.shape[0]
    for i in range(m):
        for k in range(s.zeros.shape[0]):
            s.response[i, k] = 0.0
        for j in range(plan.free.shape[0]):
            s.free_response[i, j] = s.tangent.jacobian[i, plan.free[j]]
    solve(plan.lapack, s.mass, s.mass_pivot, s.sizes, s.free_response)
    for i in range(m):
        for j in range(plan.free.shape[0]):
            s.response[i, plan.free[j]] = s.free_response[i, j]
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(s.zeros.shape[0]):
                total += s.tangent.jacobian[i, k] * s.response[j, k]
            loops.row_factors[i, j] = total
            loops.row_factors[j, i] = total
    for i in range(m):
        loops.row_norm[i] = np.sqrt(loops.row_factors[i, i])
    loops.rank[0] = factor_semidefinite(loops.row_factors, loops.row_order, loops.row_scale)


@kernel
def _minimum_norm_motion(loops, s, rank, rows, out):
    """out = M^-1 C^T (C M^-1 C^T)^-1 rows, with the factors at hand; the multipliers in ``loops.solution``."""
    solve_semidefinite(loops.row_factors, rank, loops.row_order, loops.row_scale, rows, loops.scratch, loops.solution)
    for k in range(out.shape[0]):
        out[k] = 0.0
    for i in range(rows.shape[0]):
        for k in range(out.shape[0]):
            out[k] += loops.solution[i] * s.response[i, k]


@separate_kernel
def close_velocities(plan, loops, s):
    """Write ``s.v_end``: the prescribed rates, and others by M v = p in their rows, projected onto the loops.

    ``s.p_end`` is projected as well.  ``factor_end_mass`` must have been called.
    """
    p = s.p_end
    for i in range(plan.driven.shape[0]):
        s.v_end[driven_place(plan.driven[i])[1]] = s.driven[i, 1]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        s.mass_rhs[0, j] = p[k]
        for i in range(plan.driven.shape[0]):
            s.mass_rhs[0, j] -= s.full_matrix[k, driven_place(plan.driven[i])[1]] * s.driven[i, 1]
    solve(plan.lapack, s.mass, s.mass_pivot, s.sizes, s.mass_rhs)
    for j in range(plan.free.shape[0]):
        s.v_end[plan.free[j]] = s.mass_rhs[0, j]
    if plan.rows.shape[0] > 0:
        _close_loops(plan, loops, s)


@deferred_kernel()
def _close_loops(plan, loops, s):
    """Project ``s.v_end`` and ``s.p_end`` onto the loops."""
    m = plan.rows.shape[0]
    p = s.p_end
    _factor_rows(plan, loops, s)
    for i in range(m):
        loops.phi[i] = -s.row_end[i, 1]
        for k in range(p.shape[0]):
            loops.phi[i] += s.tangent.jacobian[i, k] * s.v_end[k]
    _minimum_norm_motion(loops, s, loops.rank[0], loops.phi, loops.move)
    for k in range(p.shape[0]):
        s.v_end[k] -= loops.move[k]
        for i in range(m):
            p[k] -= s.tangent.jacobian[i, k] * loops.solution[i]


@kernel
def accelerate_end(plan, work, loops, s):
    """Write ``s.a_end`` and ``s.nu_end`` by ``s.x_end`` and ``s.v_end``, with the factors that belong to them.

    ``work.time`` must be that of the end.
    """
    none = s.zero_multipliers
    for k in range(s.a_end.shape[0]):
        s.a_end[k] = 0.0
    for i in range(plan.driven.shape[0]):
        s.a_end[driven_place(plan.driven[i])[1]] = s.driven[i, 2]
    call_separate(s.kernels[RESIDUAL], (plan, work, s.x_end, s.v_end, s.a_end, none, s.scratch_v))
    for j in range(plan.free.shape[0]):
        s.mass_rhs[0, j] = -s.scratch_v[plan.free[j]]
    solve(plan.lapack, s.mass, s.mass_pivot, s.sizes, s.mass_rhs)
    for j in range(plan.free.shape[0]):
        s.a_end[plan.free[j]] = s.mass_rhs[0, j]
    if plan.rows.shape[0] > 0:
        _add_reactions(plan, work, loops, s)


@deferred_kernel()
def _add_reactions(plan, work, loops, s):
    """Find the multipliers at the tree's accelerations ``s.a_end`` and add what they cause."""
    none = s.zero_multipliers
    call_separate(s.kernels[RESIDUAL], (plan, work, s.x_end, s.v_end, s.a_end, none, s.scratch_v))
    call_separate(s.kernels[CONSTRAINTS], (plan, work, loops.phi, loops.rate, loops.rate2))
    rank = loops.rank[0]
    while rank > 1 and loops.row_factors[rank - 1, rank - 1] ** 2 < NO_REACTION * loops.usual_pivot[0]:
        rank -= 1
    _minimum_norm_motion(loops, s, rank, loops.rate2, loops.move)
    for i in range(s.nu_end.shape[0]):
        s.nu_end[i] = loops.solution[i]
    for k in range(s.a_end.shape[0]):
        s.a_end[k] -= loops.move[k]
