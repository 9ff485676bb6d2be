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
_CLOSE = 1e-5  # a turn after which the next one would be its square, and is left to the next sweep
_LONGEST = 0.8  # tangent of the largest angle by which the direction turns in one of them


@kernel
def write_stick(W, out):
    """Write minus the inverse of the symmetric W (xx, xy, xz, yy, yz, zz), by which P = ... q lets nothing move.

    Tangents in which nothing moves take no impulse; zeros where nothing moves at all.
    """
    least = EQUAL * (W[4] + W[8])
    a, d, f = W[0], W[4] + least, W[8] + least
    b, c, e = W[1], W[2], W[5]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * A + b * B + c * C
    over = -1.0 / determinant if determinant > 0.0 else 0.0
    out[0], out[1], out[2] = over * A, over * B, over * C
    out[3], out[4], out[5] = over * D, over * E, over * F


@kernel
def _slip(W, mu, q, c, s):
    """P with slip along (c, s), what is to vanish (s x u_t), its slope by the angle, and the slip speed s . u_t."""
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
def _sliding(W, mu, q, c, s):
    """P with slip, from a guess of its direction on, and whether it was found."""
    size = math.sqrt(c * c + s * s)
    c, s = c / size, s / size
    for _ in range(_TURNS):
        P, value, slope, along = _slip(W, mu, q, c, s)
        if along < 0.0:
            return P, False
        if abs(value) <= ROUND_OFF * along:
            return P, True
        if slope >= 0.0:
            return P, False
        turn = max(-_LONGEST, min(_LONGEST, -value / slope))
        over = 1.0 / math.sqrt(1.0 + turn * turn)
        c, s = over * (c - turn * s), over * (s + turn * c)
        if abs(turn) <= _CLOSE:
            P, _, _, _ = _slip(W, mu, q, c, s)
            return P, True
    return _ZERO, False


@kernel
def point_impulse(W, stick, mu, q, known):
    """P (N s) along the normal and both tangents, of q = (u_n - b, u_t) m/s without it.

    ``stick``: of ``write_stick``; ``known``: a guess.
    """
    if q[0] >= 0.0 or not W[0] > 0.0:
        return _ZERO
    if mu == 0.0 or not W[4] + W[8] > 0.0:
        return (-q[0] / W[0], 0.0, 0.0)
    P = (
        stick[0] * q[0] + stick[1] * q[1] + stick[2] * q[2],
        stick[1] * q[0] + stick[3] * q[1] + stick[4] * q[2],
        stick[2] * q[0] + stick[4] * q[1] + stick[5] * q[2],
    )
    most = mu * P[0]
    if stick[0] < 0.0 and P[0] >= 0.0 and P[1] * P[1] + P[2] * P[2] <= most * most:
        return P
    found = False
    if known[1] * known[1] + known[2] * known[2] > 0.0:
        P, found = _sliding(W, mu, q, -known[1], -known[2])
    if not found and q[1] * q[1] + q[2] * q[2] > 0.0:
        P, found = _sliding(W, mu, q, q[1], q[2])
    return P if found else _project(W, mu, q, known)
