"""An interface that its face turns by a finite angle, in the articulated-body recursion."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.polar_decomposition import (
    face_matrix,
    face_motion,
    polar_rotation,
    polar_solver,
    polar_spin,
    polar_spin_rate,
)
from flexmbd.multibody.kernels.algebra.so3 import add3, compose, cross3, load3, load9, scale3, store3, store9
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel
from flexmbd.multibody.kernels.base.deferred import TUPLE3, deferred_kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.interface_elimination import interface_modes
from flexmbd.multibody.kernels.physics.face_modes import strain_of, strain_sum
from flexmbd.multibody.kernels.physics.frame_modes import modal_sum

_UNIT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@deferred_kernel(TUPLE3)
def deform_face(plan, aw, slot, x, v, w):
    """``flexible.deform_interface`` of a face; its rotations per unit of each mode go into ``aw.interface_rows``."""
    f = aw.interface_frame[slot]
    fixed, row = plan.frames[f], aw.interface[slot]
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    o, s = plan.frame_of[f, at.FRAME_MODES], plan.frame_of[f, at.FRAME_STRAIN]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    q, qd = x[tree[at.MODAL_X] : tree[at.MODAL_X] + n], v[tree[at.MODAL_V] : tree[at.MODAL_V] + n]
    move, theta = modal_sum(plan.modal, o, n, q)
    rate, theta_rate = modal_sum(plan.modal, o, n, qd)
    F = face_motion(theta, strain_sum(plan.modal, s, n, q))
    F_rate = face_matrix(theta_rate, strain_sum(plan.modal, s, n, qd))
    R = polar_rotation(F)
    solver = polar_solver(F, R)
    spin = polar_spin(solver, R, F_rate)
    p = add3(load3(fixed, at.FRAME_P), move)
    store3(row, to.I_P, p)
    store9(row, to.I_R, compose(R, load9(fixed, at.FRAME_R)))
    store9(row, to.I_TURN, _UNIT)
    bias = polar_spin_rate(solver, F, R, F_rate, _ZERO, spin)
    store3(row, to.I_BIAS_ANGULAR, add3(bias, cross3(w, spin)))
    store3(row, to.I_BIAS_LINEAR, cross3(w, add3(cross3(w, p), scale3(2.0, rate))))
    rows = interface_modes(aw, slot) + 3 * n
    for k in range(n):
        turn = (plan.modal[o + 3 * n + k], plan.modal[o + 4 * n + k], plan.modal[o + 5 * n + k])
        column = polar_spin(solver, R, face_matrix(turn, strain_of(plan.modal, s, n, k)))
        aw.interface_rows[rows + k] = column[0]
        aw.interface_rows[rows + n + k] = column[1]
        aw.interface_rows[rows + 2 * n + k] = column[2]
    _put_products(plan, aw, slot, n)
    return add3(w, spin)


@kernel
def _put_products(plan, aw, slot, n):
    """Bring the sums over the modes with this interface's rows up to date: Gamma C^T and Gamma Gamma^T."""
    k = _body_of(aw, slot)
    info = aw.flex[k]
    o = 6 * (slot - info[to.F_FIRST])
    first = plan.flex[info[to.F_FLEX], at.MODAL_FIRST]
    for i in range(3):
        row = interface_modes(aw, slot) + (3 + i) * n
        for c in range(3):
            aw.coupled[k, o + i, 3 + c] = _sum(aw.interface_rows, row, plan.modal, first + c * n, n)
        for other in range(info[to.F_COUNT]):
            rows = interface_modes(aw, info[to.F_FIRST] + other)
            for j in range(6):
                # angular first here, translations first in the rows
                t = _sum(aw.interface_rows, row, aw.interface_rows, rows + n * ((j + 3) % 6), n)
                aw.mobility[k, o + i, 6 * other + j] = t
                aw.mobility[k, 6 * other + j, o + i] = t


@kernel
def _body_of(aw, slot):
    """Row of ArticulatedWork.flex of the body with an interface."""
    k = 0
    while aw.flex[k, to.F_FIRST] + aw.flex[k, to.F_COUNT] <= slot:
        k += 1
    return k


@summing_kernel
def _sum(a, o, b, p, n):
    left, right = a[o : o + n], b[p : p + n]
    total = 0.0
    for k in range(n):
        total += left[k] * right[k]
    return total
