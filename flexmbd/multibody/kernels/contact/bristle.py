"""Friction's bristle: how far it is stretched at the end of a way, by return mapping.

The way y (m), how far the surfaces have slid on each other, is a state; its rate is the sliding velocity, whether they
touch or not.  The stretch z (m) goes with it, and is never longer than s = mu N / k_t, at which it bears mu N: a spring
in series with Coulomb's friction, as in perfect plasticity (Simo & Hughes 1998, section 1.4).  A piece of the way takes
z to z + dy, shortened to s there.  So no rate of the stretch stands in the equations of motion, which has no bound where
a contact begins while it slides, for s grows from nothing; and what sticks does not creep.

Within a step the way is the cubic that has both ends' places and rates.  Its pieces end where it turns back, and then
get shorter, each an eighth of what is left, until what is left is as long as a stretch: the direction of a long slide
is that of its velocity, and not of the way's chord.  s is taken to change in proportion to time.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel

#: What is kept of the last step's end, behind the head of a memory: the stretch (3, m); the way (3, m) and its rate
#: (3, m/s); the normal force (N).
STRETCH, WAY, RATE, LOAD, N_KEPT = 0, 3, 6, 9, 10

_SHORTER = 0.125  # pieces of what is left of the way
_PIECES = 12  # at most: 8^-12 of it is below round-off
_ZERO = (0.0, 0.0, 0.0)


@kernel
def flat(n, v):
    """A vector's part across the unit vector n."""
    return sub3(v, scale3(dot3(n, v), n))


@kernel
def _from_end(first, second, third, e):
    """The place on a cubic a share e of the time before its end, seen from there."""
    return scale3(e, add3(first, scale3(e, add3(second, scale3(e, third)))))


@kernel
def _turns(first, second, third):
    """Shares of the time before the end, the larger first, at which the rate along the last one is zero; NaN: none."""
    a, b, c = -3.0 * dot3(first, third), -dot3(first, second), -dot3(first, first)
    larger, smaller = math.nan, math.nan
    root = b * b - a * c
    if c < 0.0 and root > 0.0:
        sharp = -(b + math.copysign(math.sqrt(root), b))
        one = c / sharp if sharp != 0.0 else math.nan
        other = sharp / a if a != 0.0 else math.nan
        larger, smaller = (one, other) if not one <= other else (other, one)
    return larger if larger > 0.0 and larger < 1.0 else math.nan, smaller if 0.0 < smaller < 1.0 else math.nan


@kernel
def _shorten(z, dz, s, ds):
    """A stretch no longer than s, and its variation."""
    square = dot3(z, z)
    if square <= s * s:
        return z, dz
    size = math.sqrt(square)
    e = scale3(1.0 / size, z)
    across = sub3(dz, scale3(dot3(e, dz), e))
    return scale3(s, e), add3(scale3(s / size, across), scale3(ds, e))


@kernel
def follow(z, way, longest, dway, dlongest):
    """The stretch at the end of a way that begins with z, and its variation.

    ``way``: from begin to end, and the rates there times the duration (m); ``longest``: s at both ends.  ``dway``: of
    the way and of the last rate; ``dlongest``: of s at both ends.
    """
    whole, before, behind = way
    dwhole, dbehind = dway
    first = scale3(-1.0, behind)
    second = sub3(add3(scale3(2.0, behind), before), scale3(3.0, whole))
    third = sub3(scale3(2.0, whole), add3(before, behind))
    dfirst = scale3(-1.0, dbehind)
    dsecond = sub3(scale3(2.0, dbehind), scale3(3.0, dwhole))
    dthird = sub3(scale3(2.0, dwhole), dbehind)
    place, dplace, left, dz = scale3(-1.0, whole), scale3(-1.0, dwhole), 1.0, _ZERO
    s, ds = longest[1], dlongest[1]
    turns = _turns(first, second, third)
    for piece in range(2 + _PIECES):
        if piece < 2:
            end = turns[piece]
            if end != end:
                continue
        else:
            reached = sub3(z, place)
            if not dot3(reached, reached) > s * s or not dot3(place, place) > s * s:
                break
            end = _SHORTER * left
        there, dthere = _from_end(first, second, third, end), _from_end(dfirst, dsecond, dthird, end)
        most, dmost = s + end * (longest[0] - s), ds + end * (dlongest[0] - ds)
        z, dz = _shorten(add3(z, sub3(there, place)), add3(dz, sub3(dthere, dplace)), most, dmost)
        place, dplace, left = there, dthere, end
    return _shorten(sub3(z, place), sub3(dz, dplace), s, ds)


@kernel
def stretch(memory, m, t, n, y, v, dy, dv, loads):
    """The stretch at t (s) and its variation across n, of the memory at m, where the way has come to y at the rate v.

    ``loads``: the length at which the bristle slides under 1 N (m/N), and its variation; N and its variation.
    """
    duration = t - memory[m + at.MEMORY_TIME]
    duration = duration if duration > 0.0 else 0.0  # before a start has written it: straight on
    o = m + at.N_MEMORY_HEAD
    per, dper, N, dN = loads
    N_before = memory[o + LOAD]
    whole = flat(n, sub3(y, load3(memory, o + WAY)))
    before = scale3(duration, flat(n, load3(memory, o + RATE)))
    z = flat(n, load3(memory, o + STRETCH))
    return follow(
        z, (whole, before, scale3(duration, v)), (per * N_before, per * N),
        (flat(n, dy), scale3(duration, flat(n, dv))), (dper * N_before, dper * N + per * dN),
    )  # fmt: skip


@kernel
def keep(x, m, t, z, y, v, N):
    """Write into the configuration x what a bristle remembers."""
    x[m + at.MEMORY_TIME] = t
    x[m + at.MEMORY_DEFORMATION] = math.sqrt(dot3(z, z))
    x[m + at.MEMORY_RATE] = math.sqrt(dot3(v, v))
    o = m + at.N_MEMORY_HEAD
    store3(x, o + STRETCH, z)
    store3(x, o + WAY, y)
    store3(x, o + RATE, v)
    x[o + LOAD] = N
