"""An element of a geometrically exact beam: the derivative of s^T K s / 2, and of s'^T C s' / 2 by s'.

s = (J(theta)^-1 d, theta) - rest with theta = log R: the logarithm of G's pose in F's axes, of the screw motion that
leads from section to section (Sonneville, Cardona & Bruels 2014).  Its strains are constant along the element, and no
rigid motion changes them.  Its numbers: K (36), C (36), rest (6), and 1 where C is not zero.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.inverse_jacobian import (
    inverse_gradient,
    inverse_gradient_variation,
    inverse_second_variation,
    inverse_variation,
)
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    dot3,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    load3,
    rotation_vector,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness
from flexmbd.multibody.kernels.elements.six_by_six import six_times

_C, REST, _DAMPED = 36, 72, 78


@kernel
def _strain(data, o, d, theta):
    """s, as two vectors."""
    return (
        sub3(left_jacobian_inverse(theta, d), load3(data, o + REST)),
        sub3(theta, load3(data, o + REST + 3)),
    )


@kernel
def _strain_rate(d, theta, rate, turn):
    """Change of s as d changes by ``rate`` and theta by ``turn``."""
    return add3(left_jacobian_inverse(theta, rate), inverse_variation(theta, turn, d, 1.0)), turn


@kernel
def strain_and_rate(row, data, d, R, rate, spin):
    """s of an element, and its rate, each as two vectors."""
    theta = rotation_vector(R)
    s, turn = _strain(data, row[at.EL_DATA], d, theta)
    along, twist = _strain_rate(d, theta, rate, left_jacobian_inverse(theta, spin))
    return s, turn, along, twist


@kernel
def _resultants(data, o, d, theta, rate, spin):
    """K s + C s', as two vectors."""
    n, m = six_times(data, o, *_strain(data, o, d, theta))
    if data[o + _DAMPED] != 0.0:
        slow = _strain_rate(d, theta, rate, left_jacobian_inverse(theta, spin))
        drag, twist = six_times(data, o + _C, *slow)
        n, m = add3(n, drag), add3(m, twist)
    return n, m


@kernel
def transmitted(theta, d, n, m):
    """Force and torque, in F's axes, whose work on G's motion against F is that of resultants (n, m) on xi."""
    torque = left_jacobian_inverse_transposed(theta, add3(m, inverse_gradient(theta, d, n)))
    return left_jacobian_inverse_transposed(theta, n), torque


@kernel
def transmitted_change(theta, turn, d, dd, n, m, dn, dm):
    """Change of both as theta changes by ``turn``, d by dd and the resultants by (dn, dm)."""
    inner = add3(m, inverse_gradient(theta, d, n))
    dinner = add3(
        add3(dm, inverse_gradient(theta, dd, n)),
        add3(inverse_gradient(theta, d, dn), inverse_gradient_variation(theta, turn, d, n)),
    )
    force = add3(left_jacobian_inverse_transposed(theta, dn), inverse_variation(theta, turn, n, -1.0))
    torque = add3(left_jacobian_inverse_transposed(theta, dinner), inverse_variation(theta, turn, inner, -1.0))
    return force, torque


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    theta = rotation_vector(R)
    n, m = _resultants(plan.data, row[at.EL_DATA], d, theta, rate, spin)
    force, torque = transmitted(theta, d, n, m)
    return scale3(-1.0, force), scale3(-1.0, torque)


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    data = plan.data
    o = row[at.EL_DATA]
    theta = rotation_vector(R)
    turn = left_jacobian_inverse(theta, dtheta)
    n, m = _resultants(data, o, d, theta, rate, spin)
    dn, dm = six_times(data, o, *_strain_rate(d, theta, dd, turn))
    if data[o + _DAMPED] != 0.0:
        theta_rate = left_jacobian_inverse(theta, spin)
        dtheta_rate = add3(left_jacobian_inverse(theta, dspin), inverse_variation(theta, turn, spin, 1.0))
        along, _ = _strain_rate(d, theta, drate, dtheta_rate)
        along = add3(along, inverse_variation(theta, turn, rate, 1.0))
        along = add3(along, inverse_variation(theta, theta_rate, dd, 1.0))
        along = add3(along, inverse_second_variation(theta, theta_rate, turn, d))
        drag, twist = six_times(data, o + _C, along, dtheta_rate)
        dn, dm = add3(dn, drag), add3(dm, twist)
    force, torque = transmitted_change(theta, turn, d, dd, n, m, dn, dm)
    return scale3(-1.0, force), scale3(-1.0, torque)


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    o = row[at.EL_DATA]
    s, turn = _strain(plan.data, o, d, rotation_vector(R))
    n, m = six_times(plan.data, o, s, turn)
    return 0.5 * (dot3(n, s) + dot3(m, turn))


# Unseen: the rounding of places makes accelerations of a thin element, of whose noise no explicit step is short enough
# to make less at a tight tolerance.
BEAM_ELEMENT = FrameElement(
    Behaviour("elements of beams", Stiffness.SEEN, damper=(_C, 36)), _wrench, _variation, _energy
)
