"""Where on its body the centre of a contact's sphere is: at a fixed place, or at the lowest one before a half space.

The lowest point of a flattened ellipsoid about z of frame G (a rim and what it encloses), or of a profile in its xy
plane, goes around as the body turns.  The body's own velocity there is the rate at which it comes near, for along the
surface the distance is stationary.

Numbers at ``LOWEST``: the kind, then

    RIM      semi-axes across and along z (m): the lowest point is -E^2 n / |E n| for the half space's normal n
    OUTLINE  the place of the profile's table
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, rotate, rotate_back, scale3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.normal_force import CENTRE, LOWEST
from flexmbd.multibody.kernels.contact.profile_support import profile_support

#: How a centre moves in G.
FIXED, RIM, OUTLINE = range(3)


@kernel
def _squared(data, o, n):
    """Of an ellipsoid: E^2 n (m^2) by a vector in G's axes."""
    a, b = data[o + LOWEST + 1], data[o + LOWEST + 2]
    return (a * a * n[0], a * a * n[1], b * b * n[2])


@kernel
def _planar(data, o, R):
    """Of a profile: the part of the half space's normal in its plane, as a unit vector in G's axes, and its size."""
    n = rotate_back(R, load3(data, o + 1))
    size = math.sqrt(n[0] * n[0] + n[1] * n[1])
    return (n[0] / size, n[1] / size, 0.0) if size > 0.0 else (1.0, 0.0, 0.0), size


@kernel
def centre_arm(data, o, R):
    """The sphere's centre from G's origin in F's axes, of a contact's numbers at o; R: from G's axes to F's."""
    kind, centre = data[o + LOWEST], load3(data, o + CENTRE)
    if kind == OUTLINE:
        n, _ = _planar(data, o, R)
        point, _ = profile_support(data, int(data[o + LOWEST + 1]), (-n[0], -n[1], 0.0))
        return rotate(R, add3(centre, point))
    if kind == RIM:
        n = rotate_back(R, load3(data, o + 1))
        q = _squared(data, o, n)
        centre = sub3(centre, scale3(1.0 / math.sqrt(dot3(n, q)), q))
    return rotate(R, centre)


@kernel
def centre_arm_variation(data, o, R, arm, dtheta):
    """How that changes as G turns by dtheta against F."""
    kind = data[o + LOWEST]
    if kind == OUTLINE:
        n, size = _planar(data, o, R)
        _, radius = profile_support(data, int(data[o + LOWEST + 1]), (-n[0], -n[1], 0.0))
        along = (n[1], -n[0], 0.0)  # anticlockwise along the profile
        dn = rotate_back(R, cross3(load3(data, o + 1), dtheta))
        moved = scale3(-radius * dot3(along, dn) / size if size > 0.0 else 0.0, along)
        return add3(cross3(dtheta, arm), rotate(R, moved))
    if kind == RIM:
        n = rotate_back(R, load3(data, o + 1))
        dn = rotate_back(R, cross3(load3(data, o + 1), dtheta))
        q, dq = _squared(data, o, n), _squared(data, o, dn)
        size = math.sqrt(dot3(n, q))
        moved = scale3(1.0 / size, sub3(scale3(dot3(n, dq) / (size * size), q), dq))
        return add3(cross3(dtheta, arm), rotate(R, moved))
    return cross3(dtheta, arm)
