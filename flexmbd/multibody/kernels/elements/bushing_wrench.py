"""A bushing: the derivative of u^T K u / 2 + (dissipation) du^T C du / 2 with u = (d, log R).

The work of its torque is that on log R, through the inverse Jacobian of the exponential.  Its numbers: K (36), C (36).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.inverse_jacobian import inverse_variation
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    dot3,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    rotation_vector,
    scale3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness
from flexmbd.multibody.kernels.elements.six_by_six import six_times


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    data = plan.data
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    force, torque = six_times(data, o, d, theta)
    drag, twist = six_times(data, o + 36, rate, left_jacobian_inverse(theta, spin))
    torque = left_jacobian_inverse_transposed(theta, add3(torque, twist))
    return scale3(-1.0, add3(force, drag)), scale3(-1.0, torque)


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    data = plan.data
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    turn = left_jacobian_inverse(theta, dtheta)
    _, torque = six_times(data, o, d, theta)
    theta_rate = left_jacobian_inverse(theta, spin)
    _, twist = six_times(data, o + 36, rate, theta_rate)
    dtheta_rate = add3(
        left_jacobian_inverse(theta, dspin), inverse_variation(theta, turn, spin, 1.0)
    )
    dforce, dtorque = six_times(data, o, dd, turn)
    ddrag, dtwist = six_times(data, o + 36, drate, dtheta_rate)
    total = add3(
        left_jacobian_inverse_transposed(theta, add3(dtorque, dtwist)),
        inverse_variation(theta, turn, add3(torque, twist), -1.0),
    )
    return scale3(-1.0, add3(dforce, ddrag)), scale3(-1.0, total)


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    theta = rotation_vector(R)
    force, torque = six_times(plan.data, row[at.EL_DATA], d, theta)
    return 0.5 * (dot3(force, d) + dot3(torque, theta))


BUSHING = FrameElement(
    Behaviour("bushings", Stiffness.SEEN, spring=(0, 36), damper=(36, 36)), _wrench, _variation, _energy
)
