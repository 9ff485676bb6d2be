"""Analytic variations of the wrenches of elements between frames, for the tangent of implicit steps."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    inverse_coefficient,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    load3,
    rotate,
    rotation_vector,
    scale3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import penalty_reaction, six_times
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench_variation

_ZERO = (0.0, 0.0, 0.0)
_LEAST = 1e-150  # a length that is none


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
def _spring_variation(data, o, d, rate, dd, drate):
    length = max(math.sqrt(dot3(d, d)), _LEAST)
    n = scale3(1.0 / length, d)
    along = dot3(n, dd)
    dn = scale3(1.0 / length, add3(dd, scale3(-along, n)))
    pull = data[o] * (length - data[o + 1]) + data[o + 2] * dot3(n, rate)
    dpull = data[o] * along + data[o + 2] * (dot3(dn, rate) + dot3(n, drate))
    return scale3(-1.0, add3(scale3(dpull, n), scale3(pull, dn))), _ZERO


@kernel
def _bushing_variation(data, o, d, R, rate, spin, dd, dtheta, drate, dspin):
    theta = rotation_vector(R)
    turn = left_jacobian_inverse(theta, dtheta)
    _, torque = six_times(data, o, d, theta)
    theta_rate = left_jacobian_inverse(theta, spin)
    _, twist = six_times(data, o + 36, rate, theta_rate)
    dtheta_rate = add3(
        left_jacobian_inverse(theta, dspin), _inverse_variation(theta, turn, spin, 1.0)
    )
    dforce, dtorque = six_times(data, o, dd, turn)
    ddrag, dtwist = six_times(data, o + 36, drate, dtheta_rate)
    total = add3(
        left_jacobian_inverse_transposed(theta, add3(dtorque, dtwist)),
        _inverse_variation(theta, turn, add3(torque, twist), -1.0),
    )
    return scale3(-1.0, add3(dforce, ddrag)), scale3(-1.0, total)


@kernel
def _penalty_variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin):
    held = plan.penalties[row[at.EL_COUNT]]
    o = row[at.EL_DATA]
    _, _, pull, force, torque = penalty_reaction(plan, work, row, d, R, rate, spin)
    force_change, torque_change = row_wrench_variation(plan.data, held, d, R, dd, dtheta)
    value_change = 0.0
    if held[at.ROW_LEVEL] == kinds.LEVEL_POSITION:
        value_change = dot3(force, dd) + dot3(torque, dtheta)
    speed_change = dot3(force_change, rate) + dot3(torque_change, spin) + dot3(force, drate) + dot3(torque, dspin)
    pull_change = plan.data[o] * value_change + plan.data[o + 1] * speed_change
    return (
        scale3(-1.0, add3(scale3(pull_change, force), scale3(pull, force_change))),
        scale3(-1.0, add3(scale3(pull_change, torque), scale3(pull, torque_change))),
    )


@entry_kernel
def element_wrench_variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin):
    """Variation of ``element_wrench`` for d + dd, exp(dtheta) R, rate + drate, spin + dspin.

    All in F's axes: of the force on G at G's origin, and of the torque on G.
    """
    data = plan.data
    o = row[at.EL_DATA]
    kind = row[at.EL_KIND]
    if kind == kinds.BETWEEN_SPRING:
        return _spring_variation(data, o, d, rate, dd, drate)
    if kind == kinds.BETWEEN_BUSHING:
        return _bushing_variation(data, o, d, R, rate, spin, dd, dtheta, drate, dspin)
    if kind == kinds.BETWEEN_PENALTY:
        return _penalty_variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin)
    if kind == kinds.BETWEEN_GIVEN_G:
        factor = 1.0 if row[at.EL_TIME] < 0 else work.time[row[at.EL_TIME], 0]
        force = rotate(R, scale3(factor, load3(data, o)))
        torque = rotate(R, scale3(factor, load3(data, o + 3)))
        return cross3(dtheta, force), cross3(dtheta, torque)
    return _ZERO, _ZERO
