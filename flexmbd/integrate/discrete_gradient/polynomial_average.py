"""The mean force of the strain energies that are polynomials, over the straight way of a step.

The mean of a gradient along the way between two states is a discrete gradient: its work is the energy's change. That
of a polynomial of degree four is of degree three, whose mean Gauss's rule of two points has exactly (Quispel & McLaren
2008, doi:10.1088/1751-8113/41/4/045206).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.physics.energy_polynomial import add_polynomial_forces, add_polynomial_tangent
from flexmbd.multibody.kernels.reading.plan_entries import flexible_of, has_polynomial, modes_of

_GAUSS = 0.5 / 3.0**0.5  # of the way, from its middle to a point


@kernel
def _put_point(scratch, qx, qv, share, q):
    """Write the modal coordinates at ``share`` of the step's way from its middle into q (n,)."""
    for k in range(q.shape[0]):
        q[k] = scratch.x_mid[qx + k] + share * scratch.increment[qv + k]


@deferred_kernel()
def average_polynomials(plan, scratch):
    """Put the mean forces of the polynomials in the place of those in the middle of the step."""
    for i in range(plan.tree.shape[0]):
        n, qx, qv = modes_of(plan.tree[i], plan.flex)
        if n == 0 or not has_polynomial(plan.flex[flexible_of(plan.tree[i])]):
            continue
        flex = plan.flex[flexible_of(plan.tree[i])]
        q, more = scratch.modal_scratch[0, :n], scratch.modal_scratch[1, :n]
        for k in range(n):
            more[k] = 0.0
        for share, weight in ((0.0, -1.0), (-_GAUSS, 0.5), (_GAUSS, 0.5)):
            _put_point(scratch, qx, qv, share, q)
            add_polynomial_forces(plan.modal, flex, q, weight, more)
        for k in range(n):
            scratch.gradient[qv + k] += more[k]
            scratch.stored_gradient[qv + k] += more[k]


@deferred_kernel()
def vary_average_polynomials(plan, scratch, h):
    """Add h / 2 times the derivative by u of the forces that ``average_polynomials`` adds to ``s.full_matrix``."""
    for i in range(plan.tree.shape[0]):
        n, qx, qv = modes_of(plan.tree[i], plan.flex)
        if n == 0 or not has_polynomial(plan.flex[flexible_of(plan.tree[i])]):
            continue
        flex = plan.flex[flexible_of(plan.tree[i])]
        q, second, matrix = scratch.modal_scratch[0, :n], scratch.tangent.second, scratch.full_matrix
        for share, weight in ((0.0, -1.0), (-_GAUSS, 0.5), (_GAUSS, 0.5)):
            # a point at a share of the way from the middle moves by (1 / 2 + share) h per unit of u
            _put_point(scratch, qx, qv, share, q)
            part = 0.5 * h * h * weight * (0.5 + share)
            add_polynomial_tangent(plan.modal, flex, q, part, second, qv, matrix)
