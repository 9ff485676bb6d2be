"""The matrices of an energy-momentum step where they are sparse: of trees of rigid bodies without prescribed motions.

No body is cut: the iteration matrix takes the masses at the end from those in the middle entry by entry.
``scratch`` is an ``EnergyMomentumWorkspace``; unknowns are the free velocities, in their order.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.discrete_gradient.workspace import SPARSE_TANGENT
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse, solve_sparse
from flexmbd.multibody.kernels.tangent.sparse_products import multiply


@kernel
def is_sparse(scratch):
    """Whether the matrices are sparse."""
    return scratch.kernels[SPARSE_TANGENT] != 0


@kernel
def _assemble(plan, work, scratch, x, v, multipliers, per_x, per_v, per_a, values):
    call_separate(
        scratch.kernels[SPARSE_TANGENT],
        (
            plan,
            work,
            scratch.tangent,
            scratch.sparse.to,
            x,
            v,
            scratch.zeros,
            multipliers,
            per_x,
            per_v,
            per_a,
            values,
        ),
    )


@kernel
def _is_finite(values):
    for k in range(values.shape[0]):
        if not np.isfinite(values[k]):
            return False
    return True


@deferred_kernel()
def put_middle(plan, work, scratch, h):
    """Fill the iteration matrix from the tangent in the middle, after ``residual`` there."""
    values = scratch.sparse.matrix.values
    _assemble(plan, work, scratch, scratch.x_mid, scratch.u, scratch.nu, 0.25 * h * h, 0.5 * h, 2.0, values)


@deferred_kernel(FLAG)
def factor_sparse_mass(plan, work, scratch):
    """Write M(s.x_end) into ``s.end_mass``, after ``residual`` there, and factor it; False if it is singular."""
    values = scratch.end.values
    _assemble(plan, work, scratch, scratch.x_end, scratch.zeros, scratch.zero_multipliers, 0.0, 0.0, 1.0, values)
    for k in range(values.shape[0]):
        scratch.end_mass[k] = values[k]
    return _is_finite(values) and factor_sparse(scratch.sparse.pattern, scratch.end)


@deferred_kernel()
def take_end_mass(scratch):
    """Take M at the end from the iteration matrix."""
    values = scratch.sparse.matrix.values
    for k in range(values.shape[0]):
        values[k] -= scratch.end_mass[k]


@deferred_kernel(FLAG)
def factor_iteration(scratch):
    """Factor the iteration matrix; False if it is singular."""
    return _is_finite(scratch.sparse.matrix.values) and factor_sparse(scratch.sparse.pattern, scratch.sparse.matrix)


@deferred_kernel()
def solve_iteration(scratch):
    """Solve with its factors for ``s.correction``, in place."""
    solve_sparse(scratch.sparse.pattern, scratch.sparse.matrix, scratch.correction)


@deferred_kernel()
def solve_sparse_mass(scratch):
    """Solve with M at the end for ``s.mass_rhs``, in place."""
    solve_sparse(scratch.sparse.pattern, scratch.end, scratch.mass_rhs)


@deferred_kernel()
def multiply_end_mass(plan, scratch, vector):
    """Write M at the end times the free part of a vector (nv,) into ``s.correction``."""
    for j in range(plan.free.shape[0]):
        scratch.mass_rhs[0, j] = vector[plan.free[j]]
    multiply(scratch.sparse.pattern, scratch.end_mass, scratch.sparse.to, scratch.mass_rhs[0], scratch.correction[0])


@deferred_kernel()
def add_stiff_forces(plan, scratch, size, force):
    """Write what sizes (nv,) make of the iteration matrix less M at the end into ``force`` (nv,), all that adds up."""
    pattern, values = scratch.sparse.pattern, scratch.sparse.matrix.values
    for i in range(pattern.entry_at.shape[0] - 1):
        for r in range(pattern.first[i + 1] - pattern.first[i]):
            total = 0.0
            for q in range(pattern.entry_at[i], pattern.entry_at[i + 1]):
                place = pattern.offset[q] + r * pattern.stride[q]
                begin = pattern.first[pattern.column[q]]
                for c in range(pattern.first[pattern.column[q] + 1] - begin):
                    stiffness = abs(values[place + c] - scratch.end_mass[place + c])
                    total += stiffness * size[plan.free[begin + c]]
            force[plan.free[pattern.first[i] + r]] = total


@kernel
def end_mass_of(scratch, k):
    """The entry of M at the end on the diagonal of velocity k."""
    to = scratch.sparse.to
    block = to.block[k]
    return scratch.end_mass[to.diagonal[block, 0] + to.diagonal[block, 1] * k + k]
