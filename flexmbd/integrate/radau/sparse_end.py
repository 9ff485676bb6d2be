"""A Radau IIA step's end (``end``) by a sparse matrix: of M with the rows, [M C^T; C 0]."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.radau.coefficients import STAGES
from flexmbd.integrate.radau.sparse_stages import assemble, put_slopes
from flexmbd.integrate.sparse_rows import least_row_pivot, tell_worthless
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, NUMBER, TUPLE2, deferred_kernel
from flexmbd.multibody.kernels.reading.plan_entries import holds_position
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.sparse_products import put_reactions

_LAST = STAGES - 1


@deferred_kernel(FLAG)
def factor_sparse_end(plan, work, state, scratch):
    """Factor at the last stage, which was evaluated last; False if a pivot is worthless."""
    sparse, end = scratch.sparse, scratch.shifted.end
    put_slopes(plan, scratch, False)
    assemble(plan, work, scratch, _LAST, 0.0, 0.0, 1.0, end.values)
    if not factor_sparse(sparse.pattern, end):
        tell_worthless(plan, state, scratch.tangent, sparse.to, end)
        return False
    least = least_row_pivot(plan, sparse.pattern, end, scratch.memory.row_length)
    st.watch_pivot(state, least)
    scratch.shifted.least_pivot[0] = least
    return True


@kernel
def _solve(scratch, motion, rows):
    """Solve for a right-hand side of these parts, (nu,) and (m,); leave it in ``s.shifted.unknown``."""
    y, nu = scratch.shifted.unknown[0], motion.shape[0]
    for k in range(y.shape[0]):
        y[k] = 0.0
    for j in range(nu):
        y[j] = motion[j]
    for r in range(rows.shape[0]):
        y[nu + r] = rows[r]
    solve_sparse(scratch.sparse.pattern, scratch.shifted.end, scratch.shifted.unknown)


@deferred_kernel(NUMBER)
def close_sparse(plan, scratch, what, scale, rows, velocities):
    """As ``end._close``."""
    for r in range(plan.rows.shape[0]):
        scratch.row_residual[r] = rows[r] if velocities or holds_position(plan.rows[r]) else 0.0
    scratch.rhs_end[0, :] = 0.0
    _solve(scratch, scratch.rhs_end[0], scratch.row_residual)
    size = 0.0
    for j in range(plan.free.shape[0]):
        k, change = plan.free[j], scratch.shifted.unknown[0, j]
        what[k] -= change
        size = max(size, abs(change) / scale[k])
    return size


@kernel
def _push(scratch, reactions):
    """Write what reactions (m,) accelerate within the step, stiffness included, into ``s.sparse.rhs``."""
    put_reactions(scratch.tangent, scratch.sparse.to, reactions, scratch.sparse.rhs[0])
    solve_sparse(scratch.sparse.pattern, scratch.shifted.tree, scratch.sparse.rhs)


@deferred_kernel(TUPLE2)
def balance_sparse(plan, state, scratch, h):
    """As ``end._balance``; what reactions push is measured within the step, stiffness included."""
    nu, m, pushed = plan.free.shape[0], plan.rows.shape[0], scratch.sparse.rhs[0]
    for j in range(nu):
        scratch.rhs_end[0, j] = -scratch.equation[_LAST, j]
    for r in range(m):
        scratch.row_residual[r] = -scratch.phi_rate2[r]
    _solve(scratch, scratch.rhs_end[0], scratch.row_residual)
    change = scratch.shifted.unknown[0]
    for r in range(m):
        scratch.reaction[r] = change[nu + r]
        scratch.multipliers[_LAST, r] += change[nu + r]
    _push(scratch, scratch.reaction)
    size = 0.0
    for j in range(nu):
        k = plan.free[j]
        scratch.a[_LAST, k] += change[j]
        part = max(abs(change[j]), abs(change[j] + pushed[j])) * h / scratch.scale_v[k]
        if not part <= size:
            size = part
            state.counts[st.WORST] = k
    _push(scratch, scratch.multipliers[_LAST])
    noise = 1.0 / scratch.shifted.least_pivot[0]
    for j in range(nu):
        noise = max(noise, abs(pushed[j]) * h / scratch.scale_v[plan.free[j]])
    return size, noise
