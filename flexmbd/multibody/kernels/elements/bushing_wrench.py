"""A bushing: the derivative of u^T K u / 2 + (dissipation) du^T C du / 2 with u = (d, log R).

The work of its torque is that on log R, through the inverse Jacobian of the exponential.  Its numbers: K (36), C (36).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    inverse_coefficient,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    rotation_vector,
    scale3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness


@kernel
def _six_dot(data, o, a, b):
    return (
        data[o] * a[0] + data[o + 1] * a[1] + data[o + 2] * a[2]
        + data[o + 3] * b[0] + data[o + 4] * b[1] + data[o + 5] * b[2]
    )


@kernel
def _six_times(data, o, a, b):
    """The row-major 6 x 6 matrix data[o:] times (a, b)."""
    return (
        (_six_dot(data, o, a, b), _six_dot(data, o + 6, a, b), _six_dot(data, o + 12, a, b)),
        (_six_dot(data, o + 18, a, b), _six_dot(data, o + 24, a, b), _six_dot(data, o + 30, a, b)),
    )


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    data = plan.data
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    force, torque = _six_times(data, o, d, theta)
    drag, twist = _six_times(data, o + 36, rate, left_jacobian_inverse(theta, spin))
    torque = left_jacobian_inverse_transposed(theta, add3(torque, twist))
    return scale3(-1.0, add3(force, drag)), scale3(-1.0, torque)


@kernel
def _inverse_variation(v, dv, u, sign):
    """Variation with v of (I - sign [v] / 2 + e [v]^2) u; sign -1: of the transpose."""
    e, slope = inverse_coefficient(dot3(v, v))
    vu = cross3(v, u)
    du = cross3(dv, u)
    turned = add3(cross3(dv, vu), cross3(v, du))
    return add3(
        scale3(-0.5 * sign, du),
        add3(scale3(e, turned), scale3(2.0 * slope * dot3(v, dv), cross3(v, vu))),
    )


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    data = plan.data
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    turn = left_jacobian_inverse(theta, dtheta)
    _, torque = _six_times(data, o, d, theta)
    theta_rate = left_jacobian_inverse(theta, spin)
    _, twist = _six_times(data, o + 36, rate, theta_rate)
    dtheta_rate = add3(
        left_jacobian_inverse(theta, dspin), _inverse_variation(theta, turn, spin, 1.0)
    )
    dforce, dtorque = _six_times(data, o, dd, turn)
    ddrag, dtwist = _six_times(data, o + 36, drate, dtheta_rate)
    total = add3(
        left_jacobian_inverse_transposed(theta, add3(dtorque, dtwist)),
        _inverse_variation(theta, turn, add3(torque, twist), -1.0),
    )
    return scale3(-1.0, add3(dforce, ddrag)), scale3(-1.0, total)


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    theta = rotation_vector(R)
    force, torque = _six_times(plan.data, row[at.EL_DATA], d, theta)
    return 0.5 * (dot3(force, d) + dot3(torque, theta))


BUSHING = FrameElement(
    Behaviour("bushings", Stiffness.SEEN, spring=(0, 36), damper=(36, 36)), _wrench, _variation, _energy
)
