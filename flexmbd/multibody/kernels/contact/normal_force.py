"""The normal force of a contact by the depth and its rate, and where the numbers of contact's laws stand."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.signed_distance import SHAPE_NUMBERS

#: Places of the law's numbers: the sphere's radius (m); k (N/m^p), p, D (s/m, see ``restitution``); mu, the static mu,
#: the speed (m/s) over which it falls; k_t (N/m), c_t (N s/m); the sphere's centre in its own frame G (3, m).
#: Then how the centre moves in G (``lowest_point``, 3); and of a contact that resists rolling and spinning the arms of
#: both, and the radius at which they are resisted (m).
RADIUS, STIFFNESS, EXPONENT, DISSIPATION, FRICTION, STATIC, STRIBECK, BRISTLE, BRISTLE_DAMPING, CENTRE = range(
    SHAPE_NUMBERS, SHAPE_NUMBERS + 10
)
LOWEST = CENTRE + 3
ROLLING, SPINNING, LEVER = range(LOWEST + 3, LOWEST + 6)


@kernel
def _power(depth, p):
    """depth^p, and of the exponents of a spring and of Hertz without a general power, which takes ten times as long."""
    if p == 1.0:
        return depth
    if p == 1.5:
        return depth * math.sqrt(depth)
    return depth**p


@kernel
def normal_force(data, o, D, depth, rate):
    """N, its derivatives by the depth and by the depth's rate; D (s/m): see ``restitution.dissipation``."""
    if not depth > 0.0:
        return 0.0, 0.0, 0.0
    p = data[o + EXPONENT]
    elastic = data[o + STIFFNESS] * _power(depth, p)
    factor = 1.0 + D * rate
    if not factor > 0.0:
        return 0.0, 0.0, 0.0
    return elastic * factor, p * elastic / depth * factor, elastic * D
