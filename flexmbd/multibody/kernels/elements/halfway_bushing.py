"""A bushing whose displacement is seen from axes H half-way between its frames, so that both count alike.

As ``bushing_wrench``, with u = (H^T d, theta), theta = log R and H = exp(theta / 2): frames exchanged, u and the
wrenches change their signs alone.  H turns at w = J(theta / 2) theta' / 2 against F.  Its numbers: K (36), C (36).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.inverse_jacobian import inverse_variation
from flexmbd.multibody.kernels.algebra.jacobian_derivatives import left_jacobian_derivatives
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    exp_rotation,
    left_jacobian,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    left_jacobian_transposed,
    rotate,
    rotate_back,
    rotation_vector,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness
from flexmbd.multibody.kernels.elements.six_by_six import six_times

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _parts(plan, row, d, R, rate, spin):
    """theta, its rate, H, w, the force in F's axes, and what does work on theta's rate, the force's share with it."""
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    half = scale3(0.5, theta)
    H = exp_rotation(half)
    theta_rate = left_jacobian_inverse(theta, spin)
    w = scale3(0.5, left_jacobian(half, theta_rate))
    force, torque = six_times(plan.data, o, rotate_back(H, d), theta)
    drag, twist = six_times(plan.data, o + 36, rotate_back(H, sub3(rate, cross3(w, d))), theta_rate)
    force, torque = rotate(H, add3(force, drag)), add3(torque, twist)
    total = add3(torque, scale3(0.5, left_jacobian_transposed(half, cross3(force, d))))
    return theta, theta_rate, H, w, force, total


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    theta, _, _, _, force, total = _parts(plan, row, d, R, rate, spin)
    return scale3(-1.0, force), scale3(-1.0, left_jacobian_inverse_transposed(theta, total))


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    o = row[at.EL_DATA]
    theta, theta_rate, H, w, force, total = _parts(plan, row, d, R, rate, spin)
    half = scale3(0.5, theta)
    dv = left_jacobian_inverse(theta, dtheta)
    J, dJ, _ = left_jacobian_derivatives(half, scale3(0.5, dv), _ZERO)
    turn = scale3(0.5, rotate(J, dv))  # of H
    dv_rate = add3(left_jacobian_inverse(theta, dspin), inverse_variation(theta, dv, spin, 1.0))
    dw = scale3(0.5, add3(rotate(J, dv_rate), rotate(dJ, theta_rate)))
    seen = sub3(rate, cross3(w, d))
    dseen = sub3(drate, add3(cross3(dw, d), cross3(w, dd)))
    du = rotate_back(H, sub3(dd, cross3(turn, d)))
    du_rate = rotate_back(H, sub3(dseen, cross3(turn, seen)))
    dforce, dtorque = six_times(plan.data, o, du, dv)
    ddrag, dtwist = six_times(plan.data, o + 36, du_rate, dv_rate)
    dforce = add3(rotate(H, add3(dforce, ddrag)), cross3(turn, force))
    bent = add3(rotate_back(dJ, cross3(force, d)), rotate_back(J, add3(cross3(dforce, d), cross3(force, dd))))
    dtotal = add3(add3(dtorque, dtwist), scale3(0.5, bent))
    back = add3(left_jacobian_inverse_transposed(theta, dtotal), inverse_variation(theta, dv, total, -1.0))
    return scale3(-1.0, dforce), scale3(-1.0, back)


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    theta = rotation_vector(R)
    u = rotate_back(exp_rotation(scale3(0.5, theta)), d)
    force, torque = six_times(plan.data, row[at.EL_DATA], u, theta)
    return 0.5 * (dot3(force, u) + dot3(torque, theta))


HALFWAY_BUSHING = FrameElement(
    Behaviour("bushings", Stiffness.SEEN, spring=(0, 36), damper=(36, 36)), _wrench, _variation, _energy
)
