"""The wrench between a shape and a sphere or a point that touches it, how they slide, and the variation of both.

Normal force, of the depth delta and its rate (Hunt & Crossley 1975):

    N = k delta^p (1 + D delta'),  never a pull.

Friction: a bristle between the surfaces, whose stretch z (m) in the tangent plane ``bristle`` gives by return mapping:
Coulomb's friction with true stick,

    T = k_t z + c_t v,  at most mu N in size,

at the sliding velocity v, which is also the rate of the state that the bristle has: how far the surfaces have slid.
mu falls from its static value with the sliding speed (Stribeck).  All vectors are in the axes of the shape's frame F.

Numbers: the shape's (``signed_distance``), then those that ``normal_force`` names.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.bristle import STRETCH, flat, keep, slide
from flexmbd.multibody.kernels.contact.bristle_force import FREE, bristle_force, bristle_force_variation
from flexmbd.multibody.kernels.contact.normal_force import (
    BRISTLE,
    BRISTLE_DAMPING,
    EXPONENT,
    FRICTION,
    RADIUS,
    STATIC,
    STIFFNESS,
    STRIBECK,
    normal_force,
)
from flexmbd.multibody.kernels.contact.restitution import dissipation, speed_at_touch
from flexmbd.multibody.kernels.contact.signed_distance import (
    BOX,
    CAPSULE,
    CYLINDER,
    DISC,
    HALF_THICKNESS,
    PROFILE,
    SPHERE,
    TRIANGLES,
    distance,
    gradient_variation,
)

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _coefficient(data, o, v):
    """The friction coefficient at a sliding velocity, and its derivative along v . dv."""
    kinetic, above = data[o + FRICTION], data[o + STATIC] - data[o + FRICTION]
    if above == 0.0:
        return kinetic, 0.0
    speed = data[o + STRIBECK]
    share = above * math.exp(-dot3(v, v) / speed**2)
    return kinetic + share, -2.0 * share / speed**2


@kernel
def _friction(data, o, way, n, depth, v, D, N):
    """Friction on the sphere (N), the bristle's stretch (m), the piece of the law, and whether it bends in the step.

    ``way``: the memory, where in it the contact's begins, the time (s), and how far the surfaces have slid (m).
    """
    memory, m, t, y = way
    mu, _ = _coefficient(data, o, v)
    return bristle_force(data, o, (memory, m, t, 0, True, m + at.MEMORY_PIECE), n, (y, v), depth, mu, D, N)


@kernel
def friction_after(data, o, n, N, v, z, h):
    """Friction on the sphere (N), and the bristle's stretch (m), a step h (s) after the stretch z (m).

    Of explicit steps: on a straight way at the sliding velocity v (m/s), and under one normal force N.
    """
    most = _coefficient(data, o, v)[0] * N
    s = most / data[o + BRISTLE]
    z, _, _ = slide(flat(n, z), _ZERO, scale3(h, v), _ZERO, s, s, 0.0)
    pull = add3(scale3(data[o + BRISTLE], z), scale3(data[o + BRISTLE_DAMPING], v))
    size = math.sqrt(dot3(pull, pull))
    return scale3(-1.0 if size <= most else -most / size, pull), z


@kernel
def _friction_variation(data, o, way, n, depth, v, D, N, dway, dn, ddepth, dv, dN):
    """Friction, and its variation for a way longer by dway, n + dn, v + dv, and that of the depth and its rate."""
    memory, m, t, y = way
    mu, slope = _coefficient(data, o, v)
    kept = memory, m, t, 0, True, m + at.MEMORY_PIECE
    law = mu, slope * dot3(v, dv), D, N, dN
    return bristle_force_variation(data, o, kept, (n, dn), (y, v, dway, dv), (depth, ddepth), law)


@kernel
def way_to_middle(data, o):
    """How far the sphere moves from where it touches the shape to the shape's middle (m); infinite where none is."""
    kind = data[o]
    solid = kind == SPHERE or kind == CAPSULE or kind == CYLINDER or kind == BOX or kind == DISC
    size = data[o + 1]
    if kind == PROFILE or kind == TRIANGLES:
        size = data[o + HALF_THICKNESS]
        solid = size > 0.0
    if not solid:
        return math.inf
    if kind == BOX:
        size = min(size, data[o + 2], data[o + 3])
    if kind == DISC:
        size = min(size, data[o + 2]) + data[o + 3]
    return size + data[o + RADIUS]


@kernel
def time_to_pass(data, o, gap, n, rate):
    """The longest step (s) whose end cannot be beyond what the sphere is about to meet; infinite where none is.

    The gap and half of the way to the middle, at the speed it has.
    """
    if not gap > 0.0 or dot3(n, rate) >= 0.0:
        return math.inf
    return (gap + 0.5 * way_to_middle(data, o)) / math.sqrt(dot3(rate, rate))


@kernel
def _slides(data, o, n, rate, spin):
    """The arm from the sphere's centre to where it touches, and the velocity there, with its part across n."""
    arm = scale3(-data[o + RADIUS], n)
    whole = add3(rate, cross3(spin, arm))
    return arm, whole, flat(n, whole)


@kernel
def contact(data, o, rough, way, d, rate, spin, out):
    """Force on the sphere, torque about its centre and, where it is ``rough``, its sliding velocity into ``out``.

    ``way``: as of ``_friction``.  Returns the longest step (s) in which it cannot pass through, and whether friction
    bends in this one.
    """
    gap, n = distance(data, o, d)
    gap -= data[o + RADIUS]
    depth = -gap, -dot3(n, rate)
    D = dissipation(data, o, way[:3], depth)
    N = normal_force(data, o, D, depth[0], depth[1])[0]
    force, torque = scale3(N, n), _ZERO
    bends = False
    touches = not gap >= 0.0  # where it is not a number, neither is the wrench
    if rough:
        arm, _, sliding = _slides(data, o, n, rate, spin)
        if touches:
            friction, _, _, bends = _friction(data, o, way, n, depth, sliding, D, N)
            force, torque = add3(force, friction), cross3(arm, friction)
        store3(out, 6, sliding)
    if gap != gap:
        force = (gap, gap, gap)
    store3(out, 0, force)
    store3(out, 3, torque)
    return time_to_pass(data, o, gap, n, rate), bends


@kernel
def contact_variation(data, o, rough, way, motion, change, out):
    """The variation of all that ``contact`` writes, for d + dd, rate + drate, spin + dspin, a way longer by dway.

    Turns change nothing.  Returns the force itself.
    """
    d, rate, spin = motion
    dd, drate, dspin, dway = change
    gap, n = distance(data, o, d)
    gap -= data[o + RADIUS]
    touches = gap < 0.0
    for k in range(9 if rough else 6):
        out[k] = 0.0
    if not (touches or rough):
        return _ZERO
    dn = gradient_variation(data, o, d, dd)
    depth, ddepth = (-gap, -dot3(n, rate)), (-dot3(n, dd), -dot3(dn, rate) - dot3(n, drate))
    D = dissipation(data, o, way[:3], depth)
    N, by_depth, by_rate = normal_force(data, o, D, depth[0], depth[1])
    dN = by_depth * ddepth[0] + by_rate * ddepth[1]
    force, dforce, dtorque = scale3(N, n), add3(scale3(dN, n), scale3(N, dn)), _ZERO
    if rough:
        arm, whole, v = _slides(data, o, n, rate, spin)
        darm = scale3(-data[o + RADIUS], dn)
        dwhole = add3(drate, add3(cross3(dspin, arm), cross3(spin, darm)))
        dv = sub3(sub3(dwhole, scale3(dot3(dn, whole) + dot3(n, dwhole), n)), scale3(dot3(n, whole), dn))
        if touches:
            friction, dfriction = _friction_variation(data, o, way, n, depth, v, D, N, dway, dn, ddepth, dv, dN)
            force, dforce = add3(force, friction), add3(dforce, dfriction)
            dtorque = add3(cross3(darm, friction), cross3(arm, dfriction))
        store3(out, 6, dv)
    store3(out, 0, dforce)
    store3(out, 3, dtorque)
    return force


@kernel
def remember_contact(data, o, rough, way, d, rate, spin, x):
    """Write into the configuration x what the contact remembers of where it is."""
    _, m, t, y = way
    gap, n = distance(data, o, d)
    gap -= data[o + RADIUS]
    depth = -gap, -dot3(n, rate)
    _, _, v = _slides(data, o, n, rate, spin)
    z, piece = _ZERO, FREE
    if rough and gap < 0.0:
        D = dissipation(data, o, way[:3], depth)
        _, z, piece, _ = _friction(data, o, way, n, depth, v, D, normal_force(data, o, D, depth[0], depth[1])[0])
    keep(x, m, t, piece, z, (y, v), depth, speed_at_touch(way[:3], depth))


@kernel
def contact_energy(data, o, rough, way, d):
    """What the contact stores (J): of the depth, and of the bristle as it is remembered."""
    gap = distance(data, o, d)[0] - data[o + RADIUS]
    if not gap < 0.0:
        return 0.0 if gap >= 0.0 else gap
    p = data[o + EXPONENT]
    energy = data[o + STIFFNESS] * (-gap) ** (p + 1.0) / (p + 1.0)
    if rough:
        z = load3(way[0], way[1] + at.N_MEMORY_HEAD + STRETCH)
        energy += 0.5 * data[o + BRISTLE] * dot3(z, z)
    return energy
