"""Derivatives of the inverse left Jacobian, J(v)^-1 u = u - v x u / 2 + e v x (v x u), e a function of |v|^2.

With v = log R and u = d it is the translation of the screw motion that leads from one frame to another: the six numbers
(J(v)^-1 d, v) are the logarithm of the pose (Sonneville, Cardona & Bruels 2014, doi:10.1016/j.cma.2013.10.008).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, inverse_coefficient, scale3
from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def second_inverse_coefficient(x):
    """(e, de/dx, d^2 e/dx^2)."""
    e, slope = inverse_coefficient(x)
    if x < 0.25:
        second = 42.0 * 3617.0 / 10670622842880000.0
        second = 30.0 / 74724249600.0 + x * second
        second = 20.0 * 691.0 / 1307674368000.0 + x * second
        second = 12.0 / 47900160.0 + x * second
        second = 6.0 / 1209600.0 + x * second
        second = 2.0 / 30240.0 + x * second
    else:
        # x e' = 1/8 - 3 e / 2 + x e^2 / 2, differentiated
        second = (0.5 * e * e + x * e * slope - 2.5 * slope) / x
    return e, slope, second


@kernel
def inverse_variation(v, dv, u, sign):
    """Variation with v of u - sign v x u / 2 + e v x (v x u); sign -1: of the transpose of J(v)^-1."""
    e, slope = inverse_coefficient(dot3(v, v))
    vu = cross3(v, u)
    du = cross3(dv, u)
    turned = add3(cross3(dv, vu), cross3(v, du))
    return add3(
        scale3(-0.5 * sign, du),
        add3(scale3(e, turned), scale3(2.0 * slope * dot3(v, dv), cross3(v, vu))),
    )


@kernel
def inverse_second_variation(v, a, b, u):
    """Second variation of J(v)^-1 u, by a and by b."""
    e, slope, second = second_inverse_coefficient(dot3(v, v))
    vu, au, bu = cross3(v, u), cross3(a, u), cross3(b, u)
    vvu = cross3(v, vu)
    va, vb = dot3(v, a), dot3(v, b)
    both = add3(cross3(a, bu), cross3(b, au))
    first = add3(
        scale3(va, add3(cross3(b, vu), cross3(v, bu))), scale3(vb, add3(cross3(a, vu), cross3(v, au)))
    )
    last = 2.0 * slope * dot3(a, b) + 4.0 * second * va * vb
    return add3(scale3(e, both), add3(scale3(2.0 * slope, first), scale3(last, vvu)))


@kernel
def _turned(vu, u, nv, n):
    """Gradient by v of n . v x (v x u)."""
    return add3(cross3(vu, n), cross3(u, nv))


@kernel
def inverse_gradient(v, u, n):
    """Gradient of n . J(v)^-1 u by v."""
    e, slope = inverse_coefficient(dot3(v, v))
    vu = cross3(v, u)
    long = 2.0 * slope * dot3(n, cross3(v, vu))
    return add3(
        scale3(-0.5, cross3(u, n)), add3(scale3(e, _turned(vu, u, cross3(n, v), n)), scale3(long, v))
    )


@kernel
def inverse_gradient_variation(v, dv, u, n):
    """Variation with v of the gradient of n . J(v)^-1 u by v."""
    e, slope, second = second_inverse_coefficient(dot3(v, v))
    vu, du = cross3(v, u), cross3(dv, u)
    nv, nd = cross3(n, v), cross3(n, dv)
    along = dot3(v, dv)
    product = dot3(n, cross3(v, vu))
    change = dot3(n, add3(cross3(dv, vu), cross3(v, du)))
    total = add3(scale3(e, _turned(du, u, nd, n)), scale3(2.0 * slope * along, _turned(vu, u, nv, n)))
    return add3(
        total, add3(scale3(2.0 * slope * change + 4.0 * second * along * product, v), scale3(2.0 * slope * product, dv))
    )
