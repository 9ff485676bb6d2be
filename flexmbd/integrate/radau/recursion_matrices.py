"""The matrices of a Radau IIA step where the recursion over the tree factors them."""

from __future__ import annotations

from flexmbd.integrate.radau.coefficients import COMPLEX, REAL
from flexmbd.integrate.radau.workspace import TREE_TANGENT
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.tangent.recursion_parts import (
    DAMPING,
    MASS,
    N_PARTS,
    STIFFNESS,
    add_product,
    keep_part,
    set_shift,
)
from flexmbd.multibody.kernels.tangent.tree_recursion import factor_recursion, solve_recursion


@kernel
def recurs(scratch):
    """Whether the matrices are factored by the recursion over the tree."""
    return scratch.recursion.number.shape[0] > 0


@deferred_kernel(FLAG)
def take_parts(plan, work, scratch, i):
    """The tangent's parts at stage i, for the recursion; whether all is finite."""
    finite = True
    for part in range(N_PARTS):
        per_x, per_v = 1.0 if part == STIFFNESS else 0.0, 1.0 if part == DAMPING else 0.0
        per_a = 1.0 if part == MASS else 0.0
        call_separate(
            scratch.kernels[TREE_TANGENT],
            (
                plan,
                work,
                scratch.tangent,
                scratch.recursion,
                scratch.x[i],
                scratch.v[i],
                scratch.a[i],
                per_x,
                per_v,
                per_a,
            ),
        )
        finite = keep_part(scratch.recursion, scratch.parts, part) and finite
    return finite


@deferred_kernel(FLAG)
def factor_recursions(plan, scratch, h):
    """Factor both iteration matrices by the recursion; False if a pivot is too small."""
    set_shift(scratch.parts, h / REAL, scratch.recursion)
    set_shift(scratch.parts, h / COMPLEX, scratch.complex_recursion)
    return factor_recursion(plan, scratch.recursion) and factor_recursion(plan, scratch.complex_recursion)


@deferred_kernel()
def solve_real_recursion(plan, scratch):
    """Solve with the real factors for ``s.rhs_real``, in place."""
    solve_recursion(plan, scratch.recursion, scratch.rhs_real)


@deferred_kernel()
def solve_complex_recursion(plan, scratch):
    """Solve with the complex factors for ``s.rhs_complex``, in place."""
    solve_recursion(plan, scratch.complex_recursion, scratch.rhs_complex)


@deferred_kernel()
def put_tree_imbalance(plan, scratch, step):
    """As ``matrix.put_imbalance``."""
    scratch.rhs_real[0, :] = 0.0
    parts, recursion, out = scratch.parts, scratch.recursion, scratch.rhs_real[0]
    add_product(plan, parts, MASS, recursion, 1.0, scratch.error_v, out)
    add_product(plan, parts, STIFFNESS, recursion, -step, scratch.error_x, out)
