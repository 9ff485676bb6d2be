"""The impulse of one contact: 0 <= P_n, u_n >= b, one of both with equality; Coulomb's law in the tangent plane.

With u = W P + q: no contact, stick, or slip, in which P_t = -mu P_n s along the slip's direction s.  The direction is
the root of s x u_t, by Newton's method on its angle.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.round_off import EQUAL, ROUND_OFF

_ZERO = (0.0, 0.0, 0.0)
_TURNS, _TRIALS = 25, 60  # iterations on the angle; of the projections that take over where these fail
_LONGEST = 0.7  # rad that the angle may turn in one of them


@kernel
def _stick(W, q):
    """P at which u = 0; tangents in which nothing moves take no impulse."""
    least = EQUAL * (W[4] + W[8])
    a, d, f = W[0], W[4] + least, W[8] + least
    b, c, e = W[1], W[2], W[5]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    over = -1.0 / (a * A + b * B + c * C)
    return (
        over * (A * q[0] + B * q[1] + C * q[2]),
        over * (B * q[0] + D * q[1] + E * q[2]),
        over * (C * q[0] + E * q[1] + F * q[2]),
    )


@kernel
def _slip(W, mu, q, angle):
    """P with slip along the angle, what is to vanish (s x u_t), its slope, and the slip speed s . u_t."""
    c, s = math.cos(angle), math.sin(angle)
    d = W[0] - mu * (W[1] * c + W[2] * s)
    if not d > 0.0:
        return _ZERO, 0.0, 0.0, -1.0
    N = -q[0] / d
    dN = -N / d * mu * (W[1] * s - W[2] * c)
    x, y = W[4] * c + W[5] * s, W[5] * c + W[8] * s
    dx, dy = -W[4] * s + W[5] * c, -W[5] * s + W[8] * c
    u, v = q[1] + N * (W[1] - mu * x), q[2] + N * (W[2] - mu * y)
    du = dN * (W[1] - mu * x) - mu * N * dx
    dv = dN * (W[2] - mu * y) - mu * N * dy
    along = c * u + s * v
    return (N, -mu * N * c, -mu * N * s), c * v - s * u, c * dv - s * du - along, along


@kernel
def _project(W, mu, q, P):
    """P by repeated projection onto the cone, from P on."""
    r = 1.0 / (W[4] + W[8])
    N, x, y = P
    for _ in range(_TRIALS):
        N = max(0.0, -(q[0] + W[1] * x + W[2] * y) / W[0])
        u = q[1] + W[1] * N + W[4] * x + W[5] * y
        v = q[2] + W[2] * N + W[5] * x + W[8] * y
        a, b = x - r * u, y - r * v
        size, most = math.sqrt(a * a + b * b), mu * N
        share = most / size if size > most else 1.0
        change = abs(share * a - x) + abs(share * b - y)
        x, y = share * a, share * b
        if change <= EQUAL * most:
            break
    return N, x, y


@kernel
def point_impulse(W, mu, q, known):
    """P (N s) along the normal and both tangents, of q = (u_n - b, u_t) m/s without it; ``known``: a guess."""
    if q[0] >= 0.0 or not W[0] > 0.0:
        return _ZERO
    if mu == 0.0 or not W[4] + W[8] > 0.0:
        return (-q[0] / W[0], 0.0, 0.0)
    P = _stick(W, q)
    most = mu * P[0]
    if P[0] >= 0.0 and P[1] * P[1] + P[2] * P[2] <= most * most:
        return P
    angle = math.atan2(q[2], q[1])
    if known[1] * known[1] + known[2] * known[2] > 0.0:
        angle = math.atan2(-known[2], -known[1])
    for _ in range(_TURNS):
        P, value, slope, along = _slip(W, mu, q, angle)
        if along < 0.0:
            break
        if abs(value) <= ROUND_OFF * along:
            return P
        if slope >= 0.0:
            break
        turn = -value / slope
        angle += max(-_LONGEST, min(_LONGEST, turn))
        if abs(turn) <= ROUND_OFF:
            return P
    return _project(W, mu, q, known)
