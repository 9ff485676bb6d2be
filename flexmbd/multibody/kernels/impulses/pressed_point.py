"""The impulse of one contact whose normal part is given: Coulomb's law in the tangent plane.

With u = W P + q: stick where |P_t| <= mu N, else P_t = -mu N s along the slip's direction s, which is one problem in
the slip speed over mu N, a number that is not negative.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.round_off import EQUAL

_ITERATIONS = 60


@kernel
def pressed_impulse(W, mu, q, N):
    """P (N s) along the normal, N, and both tangents, of q = u (m/s) without it."""
    most = mu * N
    if most == 0.0:
        return N, 0.0, 0.0
    a, b, d = W[4], W[5], W[8]
    x, y = q[1] + W[1] * N, q[2] + W[2] * N
    # (W_t + s 1) P_t = -u_t: s is 0 where it sticks; |P_t| falls with s, and 1 / |P_t| is nearly a line in it
    s = EQUAL * (a + d)
    for _ in range(_ITERATIONS):
        over = (a + s) * (d + s) - b * b
        if not over > 0.0:
            break
        P = (-((d + s) * x - b * y) / over, -((a + s) * y - b * x) / over)
        square = P[0] * P[0] + P[1] * P[1]
        size = math.sqrt(square)
        if size <= most * (1.0 + EQUAL):
            return N, P[0], P[1]
        slope = -(P[0] * ((d + s) * P[0] - b * P[1]) + P[1] * ((a + s) * P[1] - b * P[0])) / over  # of square / 2
        s += (size / most - 1.0) * square / -slope
    speed = math.sqrt(x * x + y * y)
    return (N, -most * x / speed, -most * y / speed) if speed > 0.0 else (N, 0.0, 0.0)
