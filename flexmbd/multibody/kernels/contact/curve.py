"""Quartic Bezier curves: a point with its derivatives, and the point nearest to another one.

The five control points (m) stand one after the other.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel

#: A step of Newton's iteration after which its error, of the size of the step's square, is round-off.
LAST_STEP = 1e-10
_MOST = 60  # iterations: bisection alone gets as far


@kernel
def _sum3(a, x, b, y, c, z):
    return add3(add3(scale3(a, x), scale3(b, y)), scale3(c, z))


@kernel
def curve_point(data, c, t):
    """The curve's point at t, from 0 to 1, and its first and second derivative by t."""
    s = 1.0 - t
    a, b = load3(data, c), load3(data, c + 3)
    m, d, e = load3(data, c + 6), load3(data, c + 9), load3(data, c + 12)
    # the quadratics of de Casteljau's scheme, of which the point and its derivatives are combinations
    p = _sum3(s * s, a, 2.0 * s * t, b, t * t, m)
    q = _sum3(s * s, b, 2.0 * s * t, m, t * t, d)
    r = _sum3(s * s, m, 2.0 * s * t, d, t * t, e)
    first = add3(scale3(4.0 * s, sub3(q, p)), scale3(4.0 * t, sub3(r, q)))
    return _sum3(s * s, p, 2.0 * s * t, q, t * t, r), first, scale3(12.0, add3(sub3(p, q), sub3(r, q)))


@kernel
def _along(data, c, t, p):
    """Half the derivative of the squared distance from p, and the second one."""
    x, first, second = curve_point(data, c, t)
    d = sub3(x, p)
    return dot3(d, first), dot3(first, first) + dot3(d, second)


@kernel
def curve_foot(data, c, p):
    """The t at which the curve, which turns by far less than a half circle, is nearest to p; 0 or 1 at its ends."""
    begins, ends = _along(data, c, 0.0, p)[0], _along(data, c, 1.0, p)[0]
    if begins >= 0.0 or ends <= 0.0:
        if begins >= 0.0 and ends <= 0.0:  # p is beyond the centre of curvature
            one, other = sub3(load3(data, c), p), sub3(load3(data, c + 12), p)
            return 0.0 if dot3(one, one) <= dot3(other, other) else 1.0
        return 0.0 if begins >= 0.0 else 1.0
    low, high = 0.0, 1.0
    t = begins / (begins - ends)
    for _ in range(_MOST):
        slope, bend = _along(data, c, t, p)
        if slope < 0.0:
            low = t
        else:
            high = t
        after = t - slope / bend if bend > 0.0 else -1.0
        if not low <= after <= high:
            after = 0.5 * (low + high)
        step = abs(after - t)
        t = after
        if step <= LAST_STEP:
            break
    return t
