"""The matrices of a Radau IIA step where they are sparse, with or without loops: of a real and of a complex s.

With B = M + s D + s^2 K, C the rows, R the rates' derivatives by positions and p = D kappa the shift of positions along
B_r^-1 C^T, B_r that of the real s (see ``matrix``), the equations of one eigenvalue are

    B a + C^T nu + s^2 K p = r1,   C (a + p) = r2,   C a + s R (a + p) = r3.

With y = a + p all follow from solutions with the saddle matrix of B and C: a first y without p; p of B_r p + C^T q = 0,
C p = r2 - r3 + s R y; and y with it, of B y + C^T nu = r1 + (M + s D) p, C y = r2.  What p changes of R y is small of
higher order and left out.  Rows that hold velocities alone stand in the saddle matrix by s times the last equation.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.radau.coefficients import COMPLEX, REAL
from flexmbd.integrate.radau.workspace import SPARSE_TANGENT
from flexmbd.integrate.sparse_rows import tell_worthless
from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.reading.plan_entries import holds_position
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.sparse_assembly import put_rows
from flexmbd.multibody.kernels.tangent.sparse_parts import (
    CONSTANT,
    DAMPING,
    MASS,
    N_PARTS,
    STIFFNESS,
    combine,
)
from flexmbd.multibody.kernels.tangent.sparse_products import add_motions, multiply, multiply_rows


@kernel
def is_sparse(scratch):
    """Whether the matrices are sparse."""
    return scratch.kernels[SPARSE_TANGENT] != 0


@kernel
def put_slopes(plan, scratch, velocities):
    """What stands in the rows: C; ``velocities``: the derivative of their rates where they hold these alone."""
    slopes = scratch.shifted.slopes
    for r in range(plan.rows.shape[0]):
        slopes[r, 0], slopes[r, 1], slopes[r, 2] = 1.0, 0.0, 0.0
        if velocities and not holds_position(plan.rows[r]):
            slopes[r, 0], slopes[r, 1] = 0.0, 1.0


@kernel
def assemble(plan, work, scratch, i, per_x, per_v, per_a, values):
    """The weighted tangent at stage i, with its rows by ``put_slopes``, into a sparse matrix."""
    x, v, a, multipliers, tw = scratch.x[i], scratch.v[i], scratch.a[i], scratch.multipliers[i], scratch.tangent
    call_separate(
        scratch.kernels[SPARSE_TANGENT],
        (
            plan,
            work,
            tw,
            scratch.sparse.to,
            x,
            v,
            a,
            multipliers,
            per_x,
            per_v,
            per_a,
            values,
        ),
    )
    if plan.rows.shape[0] > 0:
        put_rows(plan, tw, scratch.sparse.to, tw.jacobian, scratch.shifted.slopes, 1.0, values)


@kernel
def _keep_rows(tw, shifted):
    for r in range(shifted.jacobian.shape[0]):
        for j in range(shifted.jacobian.shape[1]):
            shifted.jacobian[r, j] = tw.jacobian[r, j]
            shifted.rate_jacobian[r, j] = tw.rate_jacobian[r, j]


@summing_kernel
def _total(values):
    total = 0.0
    for k in range(values.shape[0]):
        total += values[k]
    return total


@deferred_kernel(FLAG)
def take_blocks(plan, work, scratch, i):
    """The tangent's parts at stage i, for sparse matrices; whether all is finite."""
    parts, to = scratch.shifted.parts, scratch.sparse.to
    put_slopes(plan, scratch, True)
    constant = plan.rows.shape[0] > 0 or to.starts[2] > to.starts[1]
    finite = True
    for part in range(CONSTANT if constant else STIFFNESS, N_PARTS):
        per_x, per_v = 1.0 if part == STIFFNESS else 0.0, 1.0 if part == DAMPING else 0.0
        per_a = 1.0 if part == MASS else 0.0
        assemble(plan, work, scratch, i, per_x, per_v, per_a, parts[part])
        if part == STIFFNESS:
            _keep_rows(scratch.tangent, scratch.shifted)
        if constant and part != CONSTANT:
            for k in range(parts.shape[1]):
                parts[part, k] -= parts[CONSTANT, k]
        finite = finite and np.isfinite(_total(parts[part]))
    return finite


@deferred_kernel(FLAG)
def factor_both(plan, state, scratch, h):
    """Factor both sparse iteration matrices; False if a pivot is worthless."""
    sparse, shifted, tw = scratch.sparse, scratch.shifted, scratch.tangent
    s, z = h / REAL, h / COMPLEX
    combine(shifted.parts, s * s, s, 1.0, sparse.matrix.values)
    combine(shifted.parts, z * z, z, 1.0, shifted.factors.values)
    if plan.rows.shape[0] > 0:
        for k in range(shifted.tree.values.shape[0]):
            shifted.tree.values[k] = sparse.matrix.values[k]
        shifted.slopes[:, 0] = 0.0
        shifted.slopes[:, 1] = 0.0
        shifted.slopes[:, 2] = 1.0
        put_rows(plan, tw, sparse.to, tw.jacobian, shifted.slopes, 0.0, shifted.tree.values)
        if not factor_sparse(sparse.pattern, shifted.tree):
            tell_worthless(plan, state, tw, sparse.to, shifted.tree)
            return False
    if not factor_sparse(sparse.pattern, sparse.matrix):
        tell_worthless(plan, state, tw, sparse.to, sparse.matrix)
        return False
    return factor_sparse(sparse.pattern, shifted.factors)


@kernel
def _begin(plan, scratch, matrix, right, shift, unknown):
    """Solve for y without p; ``unknown`` (1, unknowns)."""
    nu, m, y = plan.free.shape[0], plan.rows.shape[0], unknown[0]
    for k in range(y.shape[0]):
        y[k] = 0.0
    for j in range(nu):
        y[j] = right[j]
    for r in range(m):
        y[nu + r] = right[nu + r] if holds_position(plan.rows[r]) else shift * right[nu + m + r]
    solve_sparse(scratch.sparse.pattern, matrix, unknown)


@kernel
def _put_lacks(plan, scratch, right, shift, vector, row):
    """Write what p lacks of closing the rows, C p, into ``row``; whether there is a p."""
    nu, m, shifted, to = plan.free.shape[0], plan.rows.shape[0], scratch.shifted, scratch.sparse.to
    combine(shifted.parts, 1.0, 0.0, 0.0, shifted.product)
    add_motions(scratch.sparse.pattern, shifted.product, to, vector)
    multiply_rows(scratch.tangent, to, shifted.rate_jacobian, vector, row)
    shifts = False
    for r in range(m):
        holds = holds_position(plan.rows[r])
        shifts = shifts or holds
        row[r] = right[nu + r] - right[nu + m + r] + shift * row[r] if holds else 0.0
    return shifts


@kernel
def _end(plan, scratch, matrix, right, shift, unknown, moved, product, row):
    """Solve for y with p, which is ``moved``; leave a and nu in ``right``."""
    nu, m, y, shifted, to = plan.free.shape[0], plan.rows.shape[0], unknown[0], scratch.shifted, scratch.sparse.to
    combine(shifted.parts, 0.0, shift, 1.0, product)
    multiply(scratch.sparse.pattern, product, to, moved, y[:nu])
    multiply_rows(scratch.tangent, to, shifted.jacobian, moved, row)
    for j in range(nu):
        y[j] += right[j]
    for k in range(nu + m, y.shape[0]):
        y[k] = 0.0
    for r in range(m):
        y[nu + r] = right[nu + r] if holds_position(plan.rows[r]) else shift * (right[nu + m + r] + row[r])
    solve_sparse(scratch.sparse.pattern, matrix, unknown)
    for j in range(nu):
        y[j] -= moved[j]


@kernel
def _leave(right, unknown):
    """The solution in place of the right-hand side, without kappa."""
    known = unknown.shape[0]
    for k in range(right.shape[0]):
        right[k] = unknown[k] if k < known else 0.0


@kernel
def push(scratch, lacks):
    """Solve B_r p + C^T q = 0, C p = ``lacks`` (m,) into ``s.sparse.rhs``."""
    right = scratch.sparse.rhs[0]
    first = scratch.push_real.shape[0]
    for k in range(right.shape[0]):
        right[k] = 0.0
    for r in range(lacks.shape[0]):
        right[first + r] = lacks[r]
    solve_sparse(scratch.sparse.pattern, scratch.sparse.matrix, scratch.sparse.rhs)


@deferred_kernel()
def solve_real_blocks(plan, scratch):
    """Solve with the real factors for ``s.rhs_real``, in place but for kappa, of which ``s.push_real`` tells."""
    shifted, shift, right = scratch.shifted, scratch.memory.step_factored[0] / REAL, scratch.rhs_real[0]
    nu, m, matrix = plan.free.shape[0], plan.rows.shape[0], scratch.sparse.matrix
    _begin(plan, scratch, matrix, right, shift, shifted.unknown)
    if m > 0:
        scratch.push_real[:] = 0.0
        if _put_lacks(plan, scratch, right, shift, shifted.unknown[0], shifted.row):
            push(scratch, shifted.row)
            shifted.moved[:] = 0.0
            for j in range(nu):
                shifted.moved[j] = scratch.push_real[j] = scratch.sparse.rhs[0, j]
            _end(
                plan, scratch, matrix, right, shift, shifted.unknown, shifted.moved, shifted.product, shifted.row
            )
    _leave(right, shifted.unknown[0][: nu + m])


@deferred_kernel()
def solve_complex_blocks(plan, scratch):
    """Likewise with the complex factors for ``s.rhs_complex``; ``s.push_complex``."""
    shifted, shift, right = scratch.shifted, scratch.memory.step_factored[0] / COMPLEX, scratch.rhs_complex[0]
    nu, m, matrix = plan.free.shape[0], plan.rows.shape[0], shifted.factors
    unknown, row = shifted.complex_unknown, shifted.complex_row
    _begin(plan, scratch, matrix, right, shift, unknown)
    if m > 0:
        scratch.push_complex[:] = 0.0
        if _put_lacks(plan, scratch, right, shift, unknown[0], row):
            for r in range(m):
                shifted.row[r] = row[r].real
            push(scratch, shifted.row)
            for j in range(nu):
                scratch.push_complex[j] = scratch.sparse.rhs[0, j]
            for r in range(m):
                shifted.row[r] = row[r].imag
            push(scratch, shifted.row)
            for j in range(nu):
                scratch.push_complex[j] += 1j * scratch.sparse.rhs[0, j]
            shifted.complex_moved[:] = 0.0
            for j in range(nu):
                shifted.complex_moved[j] = scratch.push_complex[j]
            _end(plan, scratch, matrix, right, shift, unknown, shifted.complex_moved, shifted.complex_product, row)
    _leave(right, unknown[0][: nu + m])


@deferred_kernel()
def put_block_imbalance(plan, scratch, step):
    """As ``matrix.put_imbalance``."""
    shifted, pattern, to, right = scratch.shifted, scratch.sparse.pattern, scratch.sparse.to, scratch.rhs_real[0]
    nu, m, moved = plan.free.shape[0], plan.rows.shape[0], shifted.moved
    out = shifted.unknown[0][:nu]
    moved[:] = 0.0
    for j in range(nu):
        moved[j] = scratch.error_v[j]
    combine(shifted.parts, 0.0, 0.0, 1.0, shifted.product)
    multiply(pattern, shifted.product, to, moved, out)
    for j in range(nu):
        right[j] = out[j]
        moved[j] = scratch.error_x[j]
    combine(shifted.parts, 1.0, 0.0, 0.0, shifted.product)
    multiply(pattern, shifted.product, to, moved, out)
    for j in range(nu):
        right[j] -= step * out[j]
    multiply_rows(scratch.tangent, to, shifted.jacobian, moved, shifted.row)
    for r in range(m):
        right[nu + r] = -shifted.row[r] / step if holds_position(plan.rows[r]) else 0.0
    multiply_rows(scratch.tangent, to, shifted.rate_jacobian, moved, shifted.row)
    for r in range(m):
        right[nu + m + r] = -shifted.row[r]
