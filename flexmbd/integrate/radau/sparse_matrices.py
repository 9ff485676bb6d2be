"""The matrices of a Radau IIA step where they are sparse: M + s D + s^2 K for a real and a complex s."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.radau.coefficients import COMPLEX, REAL
from flexmbd.integrate.radau.stages import SPARSE_TANGENT
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.sparse.block_lu import add_product, factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.sparse_parts import set_shift


@kernel
def is_sparse(scratch):
    """Whether the matrices are sparse."""
    return scratch.kernels[SPARSE_TANGENT] != 0


@kernel
def _assemble(plan, work, scratch, i, per_x, per_v, per_a, values):
    """The weighted tangent at stage i into a sparse matrix; whether all is finite."""
    x, v, a, multipliers = scratch.x[i], scratch.v[i], scratch.a[i], scratch.multipliers[i]
    call_separate(
        scratch.kernels[SPARSE_TANGENT],
        (
            plan,
            work,
            scratch.tangent,
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
    total = 0.0
    for k in range(values.shape[0]):
        total += values[k]
    return np.isfinite(total)


@deferred_kernel(FLAG)
def take_blocks(plan, work, scratch, i):
    """The tangent's parts at stage i, for sparse matrices; whether all is finite."""
    parts = scratch.shifted
    finite = _assemble(plan, work, scratch, i, 1.0, 0.0, 0.0, parts.stiffness.values)
    finite = _assemble(plan, work, scratch, i, 0.0, 1.0, 0.0, parts.damping.values) and finite
    return _assemble(plan, work, scratch, i, 0.0, 0.0, 1.0, parts.mass.values) and finite


@deferred_kernel(FLAG)
def factor_both(scratch, h):
    """Factor both sparse iteration matrices; False if a pivot is worthless."""
    sparse, parts = scratch.sparse, scratch.shifted
    set_shift(parts, h / REAL, sparse.matrix)
    set_shift(parts, h / COMPLEX, parts.factors)
    return factor_sparse(sparse.pattern, sparse.matrix) and factor_sparse(sparse.pattern, parts.factors)


@deferred_kernel()
def solve_real_blocks(scratch):
    """Solve with the real factors for ``s.rhs_real``, in place."""
    solve_sparse(scratch.sparse.pattern, scratch.sparse.matrix, scratch.rhs_real)


@deferred_kernel()
def solve_complex_blocks(scratch):
    """Solve with the complex factors for ``s.rhs_complex``, in place."""
    solve_sparse(scratch.sparse.pattern, scratch.shifted.factors, scratch.rhs_complex)


@deferred_kernel()
def put_block_imbalance(scratch, step):
    """As ``matrix.put_imbalance``."""
    scratch.rhs_real[0, :] = 0.0
    pattern, parts, out = scratch.sparse.pattern, scratch.shifted, scratch.rhs_real[0]
    add_product(pattern, parts.mass, scratch.error_v, 1.0, out)
    add_product(pattern, parts.stiffness, scratch.error_x, -step, out)
