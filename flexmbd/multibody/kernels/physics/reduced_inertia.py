"""The inertia of a reduced body and the forces of its velocities: one law for all of the machine.

With r = x + Phi q, y the acceleration of B (angular, linear), M the identity of the modes' mass and C the coupling of
a moments' table, the motion requires (Ambrosio & Nikravesh 1992, eq. 28-34)

    the wrench  I y + C qdd + bias,    the modal forces  qdd + C^T y + bias,

I being the rigid inertia of the deformed body.  Inverse dynamics multiplies, forward dynamics eliminates the modes,
and the tangent takes derivatives of this.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, scale3, store3
from flexmbd.multibody.kernels.algebra.spatial import add6
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.physics.inertial_forces import inertia_times, rigid_second_moment
from flexmbd.multibody.kernels.physics.modal_moments import (
    COUPLING,
    SYMMETRIC,
    accelerate,
    add_place,
    first_moments,
    second_moments,
    spin_forces,
    sum_couplings,
    sum_moving_pairs,
    sum_pairs,
)


@kernel
def deformed_first_moment(plan, i, q):
    """First moment of mass of reduced body i, deformed by q, about B."""
    flex = plan.flex[plan.tree[i, at.FLEX]]
    added = first_moments(plan.modal, flex[at.MODAL_FIRST], flex[at.N_MODES], q)
    return add3(load3(plan.rigid[i], at.FIRST_MOMENT), added)


@kernel
def deform_body(plan, i, q, qd, spins, table):
    """Write the table of moments of reduced body i, its rates if it ``spins``; return second and first moments."""
    flex = plan.flex[plan.tree[i, at.FLEX]]
    n = flex[at.N_MODES]
    o = flex[at.MODAL_MOMENTS]
    if spins:
        sum_moving_pairs(plan.modal, o, flex[at.MODAL_FIRST], n, q, qd, table)
    else:
        sum_pairs(plan.modal, o, n, q, table, SYMMETRIC)
        add_place(plan.modal, o, flex[at.MODAL_FIRST], n, table, SYMMETRIC)
    second = add6(rigid_second_moment(plan.rigid[i]), second_moments(plan.modal, o, n, q, table))
    return second, deformed_first_moment(plan, i, q)


@kernel
def add_velocity_forces(plan, i, w, qd, second, first, table, bias):
    """Add the modal forces of the velocities to ``bias`` (n,), centrifugal and Coriolis; return their torque and force.

    ``second``, ``first`` and ``table`` are `deform_body`'s.
    """
    flex = plan.flex[plan.tree[i, at.FLEX]]
    n = flex[at.N_MODES]
    torque = add3(spin_forces(n, w, qd, table, bias), cross3(w, inertia_times(second, w)))
    coriolis = scale3(2.0, first_moments(plan.modal, flex[at.MODAL_FIRST], n, qd))
    return torque, cross3(w, add3(cross3(w, first), coriolis))


@kernel
def flexible_inertia(plan, table, i, q, qd, qdd, turning, row, out):
    """Write the wrench of reduced body i and the modal forces of its inertia.

    ``row`` is its row of Work.body, ``table`` (N_MOMENTS, n) scratch; ``turning`` is kinds.NONROTATING or ROTATING: of
    a body whose frame never turns nothing is left of angular accelerations, Coriolis and centrifugal terms.
    """
    flex = plan.flex[plan.tree[i, at.FLEX]]
    n = flex[at.N_MODES]
    w = load3(row, at.B_W)
    dw = load3(row, at.B_DW)
    a = load3(row, at.B_A)
    for j in range(n):
        out[j] = 0.0
    force = scale3(plan.rigid[i, at.MASS], a)
    if turning == kinds.NONROTATING:
        sum_couplings(plan.modal, flex[at.MODAL_MOMENTS], n, q, table, COUPLING)
        add_place(plan.modal, flex[at.MODAL_MOMENTS], flex[at.MODAL_FIRST], n, table, COUPLING)
        torque = cross3(deformed_first_moment(plan, i, q), a)
    else:
        spins = w[0] != 0.0 or w[1] != 0.0 or w[2] != 0.0
        second, first = deform_body(plan, i, q, qd, spins, table)
        force = add3(force, cross3(dw, first))
        torque = add3(cross3(first, a), inertia_times(second, dw))
        if spins:
            t, f = add_velocity_forces(plan, i, w, qd, second, first, table, out)
            torque = add3(torque, t)
            force = add3(force, f)
    t, f = accelerate(n, dw, a, qdd, table, out)
    store3(row, at.B_F, add3(force, f))
    store3(row, at.B_T, add3(torque, t))
