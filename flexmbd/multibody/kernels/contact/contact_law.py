"""The wrench between a shape and a sphere or a point that touches it, the rates of its bristle, and their variation.

Normal force, of the depth delta and its rate (Hunt & Crossley 1975):

    N = k delta^p (1 + D delta'),  never a pull.

Friction: a bristle z (m) in the tangent plane, which sticks elastically and slides where k_t |z| = mu N (Dupont,
Hayward, Armstrong & Altpeter 2002: the share alpha of the sliding is zero up to `_STICKS` of that stretch, so that a
load which oscillates below it does not creep):

    u = v_t - alpha (v_t . e)+ e - (k_t / c_t) (|z| - s)+ e,    e = z / |z|,  s = mu N / k_t + floor
    z' = w u - (1 - w) (k_t / c_t) z,    w = min(1, mu N / (k_t floor))
    T = k_t z + c_t u,  at most mu N in size.

Where nothing touches, w = 0: the bristle springs back against its damper.  The floor, far less than a typical stretch,
makes z' continuous where N vanishes; it changes no force.  mu falls from its static value with the sliding speed
(Stribeck).  All vectors are in the axes of the shape's frame F.

Numbers: the shape's (``signed_distance``), then those whose places have names below.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.signed_distance import (
    BOX,
    CAPSULE,
    CYLINDER,
    SHAPE_NUMBERS,
    SPHERE,
    distance,
    gradient_variation,
)

#: Places of the law's numbers: the sphere's radius (m); k (N/m^p), p, D (s/m); mu, the static mu, the speed (m/s) over
#: which it falls; k_t (N/m), c_t (N s/m), the floor (m); the sphere's centre in the axes of its own frame G (3, m).
RADIUS, STIFFNESS, EXPONENT, DISSIPATION, FRICTION, STATIC, STRIBECK, BRISTLE, BRISTLE_DAMPING, FLOOR, CENTRE = range(
    SHAPE_NUMBERS, SHAPE_NUMBERS + 11
)

_STICKS = 0.8  # of the stretch at which it slides; none of the sliding below it
_ZERO = (0.0, 0.0, 0.0)


@kernel
def normal_force(data, o, depth, rate):
    """N, its derivatives by the depth and by the depth's rate."""
    if not depth > 0.0:
        return 0.0, 0.0, 0.0
    p = data[o + EXPONENT]
    elastic = data[o + STIFFNESS] * depth**p
    factor = 1.0 + data[o + DISSIPATION] * rate
    if not factor > 0.0:
        return 0.0, 0.0, 0.0
    return elastic * factor, p * elastic / depth * factor, elastic * data[o + DISSIPATION]


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
def _share_of_sliding(ratio):
    """Alpha at |z| over the stretch at which it slides, and its derivative by that ratio."""
    if ratio >= 1.0:
        return 1.0, 0.0
    if ratio <= _STICKS:
        return 0.0, 0.0
    w = (ratio - _STICKS) / (1.0 - _STICKS)
    return w * w * (3.0 - 2.0 * w), 6.0 * w * (1.0 - w) / (1.0 - _STICKS)


@kernel
def bristle_force(data, o, n, N, v, z):
    """Friction on the sphere (N) and the bristle's rate (m/s), at the sliding velocity v."""
    k, back = data[o + BRISTLE], data[o + BRISTLE] / data[o + BRISTLE_DAMPING]
    most = _coefficient(data, o, v)[0] * N
    slides = most / k + data[o + FLOOR]
    lifted = scale3(dot3(n, z), n)
    flat = sub3(z, lifted)
    s = math.sqrt(dot3(flat, flat))
    stretch = v
    if s > 0.0:
        e = scale3(1.0 / s, flat)
        lost = _share_of_sliding(s / slides)[0] * max(dot3(v, e), 0.0) + back * max(s - slides, 0.0)
        stretch = sub3(v, scale3(lost, e))
    pull = add3(scale3(k, flat), scale3(data[o + BRISTLE_DAMPING], stretch))
    size = math.sqrt(dot3(pull, pull))
    w = min(1.0, most / (k * data[o + FLOOR]))
    rate = sub3(scale3(w, sub3(stretch, scale3(back, lifted))), scale3((1.0 - w) * back, z))
    return scale3(-1.0 if size <= most else -most / size, pull), rate


@kernel
def _bristle_variation(data, o, n, N, v, z, dn, dN, dv):
    """Their variation for n + dn, N + dN, v + dv."""
    k, back = data[o + BRISTLE], data[o + BRISTLE] / data[o + BRISTLE_DAMPING]
    mu, slope = _coefficient(data, o, v)
    most, dmost = mu * N, slope * dot3(v, dv) * N + mu * dN
    slides, dslides = most / k + data[o + FLOOR], dmost / k
    up, dup = dot3(n, z), dot3(dn, z)
    flat = sub3(z, scale3(up, n))
    dflat = scale3(-1.0, add3(scale3(dup, n), scale3(up, dn)))
    s = math.sqrt(dot3(flat, flat))
    stretch, dstretch = v, dv
    if s > 0.0:
        e = scale3(1.0 / s, flat)
        ds = dot3(e, dflat)
        de = scale3(1.0 / s, sub3(dflat, scale3(ds, e)))
        alpha, by_ratio = _share_of_sliding(s / slides)
        dalpha = by_ratio * (ds - s * dslides / slides) / slides
        along = dot3(v, e)
        lost, dlost = 0.0, 0.0
        if along > 0.0:
            lost, dlost = alpha * along, dalpha * along + alpha * (dot3(dv, e) + dot3(v, de))
        if s > slides:
            lost, dlost = lost + back * (s - slides), dlost + back * (ds - dslides)
        stretch = sub3(v, scale3(lost, e))
        dstretch = sub3(dv, add3(scale3(dlost, e), scale3(lost, de)))
    pull = add3(scale3(k, flat), scale3(data[o + BRISTLE_DAMPING], stretch))
    dpull = add3(scale3(k, dflat), scale3(data[o + BRISTLE_DAMPING], dstretch))
    w, dw = most / (k * data[o + FLOOR]), dmost / (k * data[o + FLOOR])
    if w >= 1.0:
        w, dw = 1.0, 0.0
    held = sub3(stretch, scale3(back * up, n))
    drate = add3(scale3(w, add3(dstretch, scale3(back, dflat))), scale3(dw, add3(held, scale3(back, z))))
    size = math.sqrt(dot3(pull, pull))
    if size <= most:
        return scale3(-1.0, dpull), drate
    share = most / size
    dshare = dmost / size - share * dot3(pull, dpull) / (size * size)
    return scale3(-1.0, add3(scale3(dshare, pull), scale3(share, dpull))), drate


@kernel
def time_to_pass(data, o, gap, n, rate):
    """The longest step (s) whose end cannot be beyond what the sphere is about to meet; infinite where none is.

    The gap and half of what overlaps while it passes through the middle, at the speed it has.
    """
    kind = data[o]
    solid = kind == SPHERE or kind == CAPSULE or kind == CYLINDER or kind == BOX
    if not solid or not gap > 0.0 or dot3(n, rate) >= 0.0:
        return math.inf
    size = data[o + 1]
    if kind == BOX:
        size = min(size, data[o + 2], data[o + 3])
    return (gap + 0.5 * (size + data[o + RADIUS])) / math.sqrt(dot3(rate, rate))


@kernel
def contact(data, o, z, d, rate, spin, out):
    """Force on the sphere, torque about its centre and, where z (3,) is there, its rates into ``out`` (6 + 3,).

    Returns the longest step (s) in which it cannot pass through.
    """
    gap, n = distance(data, o, d)
    gap -= data[o + RADIUS]
    N = normal_force(data, o, -gap, -dot3(n, rate))[0]
    force, torque = scale3(N, n), _ZERO
    touches = not gap >= 0.0  # where it is not a number, neither is the wrench
    if z.shape[0] > 0:
        bristle = load3(z, 0)
        if touches:
            arm = scale3(-data[o + RADIUS], n)
            sliding = add3(rate, cross3(spin, arm))
            sliding = sub3(sliding, scale3(dot3(n, sliding), n))
            friction, change = bristle_force(data, o, n, N, sliding, bristle)
            force, torque = add3(force, friction), cross3(arm, friction)
            store3(out, 6, change)
        else:
            store3(out, 6, scale3(-data[o + BRISTLE] / data[o + BRISTLE_DAMPING], bristle))
    if gap != gap:
        force = (gap, gap, gap)
    store3(out, 0, force)
    store3(out, 3, torque)
    return time_to_pass(data, o, gap, n, rate)


@kernel
def contact_variation(data, o, z, d, rate, spin, dd, drate, dspin, out):
    """The variation of all that ``contact`` writes, for d + dd, rate + drate, spin + dspin; turns change nothing."""
    gap, n = distance(data, o, d)
    gap -= data[o + RADIUS]
    for k in range(6 + z.shape[0]):
        out[k] = 0.0
    if not gap < 0.0:
        return
    dn = gradient_variation(data, o, d, dd)
    N, by_depth, by_rate = normal_force(data, o, -gap, -dot3(n, rate))
    dN = -by_depth * dot3(n, dd) - by_rate * (dot3(dn, rate) + dot3(n, drate))
    dforce, dtorque = add3(scale3(dN, n), scale3(N, dn)), _ZERO
    if z.shape[0] > 0:
        r = data[o + RADIUS]
        arm, darm = scale3(-r, n), scale3(-r, dn)
        whole = add3(rate, cross3(spin, arm))
        dwhole = add3(drate, add3(cross3(dspin, arm), cross3(spin, darm)))
        up = dot3(n, whole)
        v = sub3(whole, scale3(up, n))
        dv = sub3(sub3(dwhole, scale3(dot3(dn, whole) + dot3(n, dwhole), n)), scale3(up, dn))
        bristle = load3(z, 0)
        friction, _ = bristle_force(data, o, n, N, v, bristle)
        dfriction, dchange = _bristle_variation(data, o, n, N, v, bristle, dn, dN, dv)
        dforce = add3(dforce, dfriction)
        dtorque = add3(cross3(darm, friction), cross3(arm, dfriction))
        store3(out, 6, dchange)
    store3(out, 0, dforce)
    store3(out, 3, dtorque)


@kernel
def contact_energy(data, o, z, d):
    """What the contact stores (J): of the depth, and of the bristle."""
    gap = distance(data, o, d)[0] - data[o + RADIUS]
    if not gap < 0.0:
        return 0.0 if gap >= 0.0 else gap
    p = data[o + EXPONENT]
    energy = data[o + STIFFNESS] * (-gap) ** (p + 1.0) / (p + 1.0)
    for k in range(z.shape[0]):
        energy += 0.5 * data[o + BRISTLE] * z[k] * z[k]
    return energy
