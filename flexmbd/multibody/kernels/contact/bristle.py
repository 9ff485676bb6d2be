"""Friction's bristle: how far it is stretched at the end of a way, by return mapping.

The way y (m), how far the surfaces have slid on each other, is a state; its rate is the sliding velocity, whether they
touch or not.  The stretch z (m) goes with it, and is never longer than s = mu N / k_t, at which it bears mu N: a spring
in series with Coulomb's friction, as in perfect plasticity (Simo & Hughes 1998, section 1.4).  The stretch follows from
the way and from what is remembered of the last step's end.  So no rate of it stands in the equations of motion, which
would be without bound where a contact begins while it slides, for s grows from nothing; and what sticks does not creep.

Within a step the way, and the depth of which N follows, are the cubics that have both ends' values and rates.  Pieces
of the way begin where the surfaces touch, and end where it turns back and where s, as it grows, leaves the stretch
behind, which sticks from there on.  Then they get shorter, each an eighth of what is left, until what is left turns the
bristle no farther: the direction of a long slide is that of its velocity, and not of the way's chord.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.normal_force import normal_force

#: What is kept of the last step's end, behind the head of a memory: the stretch (3, m); the way (3, m) and its rate
#: (3, m/s); how deep it is pressed in (m), and its rate (m/s); the speed (m/s) at which the surfaces met.
STRETCH, WAY, RATE, DEPTH, DEPTH_RATE, ONSET, N_KEPT = 0, 3, 6, 9, 10, 11, 12
#: Of a contact that resists rolling and spinning (``resistance``) then the stretch, the way and its rate of a second
#: one; and on which piece of their laws its parts across and along the normal are.
TURN, ROLLS, SPINS, N_KEPT_TURNING = 12, 21, 22, 23

_SHORTER = 0.125  # pieces of what is left of the way
_PIECES = 12  # at most: 8^-12 of it is below round-off
_PARTS = 4  # of a way that bends
_TURNED = 8.0  # stretches after which nothing is left of the direction before
_FAR = 0.5  # of s at both ends: a stretch and a way that are shorter together slide nowhere
_ASIDE = 4.0 / 27.0  # of the rates at both ends, the farthest that a cubic goes because of them
_HALVINGS = 52
_SECTIONS = 32  # golden: 2e-7 of a piece, about a maximum
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_ZERO = (0.0, 0.0, 0.0)


@kernel
def flat(n, v):
    """A vector's part across the unit vector n."""
    return sub3(v, scale3(dot3(n, v), n))


@kernel
def _length(v):
    return math.sqrt(dot3(v, v))


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
def _share_that_sticks(z, move, length, before, grown):
    """The share of a straight piece after which z is as long as s, which grows from ``before``.

    A stretch as long as s that comes back sticks until it has gone through the whole circle.
    """
    a, b, c = length * length - grown * grown, dot3(z, move) - before * grown, dot3(z, z) - before * before
    root = math.sqrt(max(b * b - a * c, 0.0))
    if b < 0.0:
        return min((root - b) / a, 1.0) if a > 0.0 else 1.0
    return min(max(-c, 0.0) / (b + root), 1.0) if b + root > 0.0 else 0.0


@kernel
def _turned(e, u, left):
    """The unit vector e turned towards u, until ``left`` is left of the tangent of half their angle."""
    cosine = dot3(e, u)
    across = sub3(e, scale3(cosine, u))
    sine = math.sqrt(dot3(across, across))
    if sine == 0.0:
        return e
    along = scale3(1.0 / sine, across)
    if cosine < 0.0 and left * (1.0 - cosine) > sine:  # by the cotangent, for the tangent may be infinite
        half = sine / (left * (1.0 - cosine))
        return scale3(1.0 / (half * half + 1.0), add3(scale3(half * half - 1.0, u), scale3(2.0 * half, along)))
    half = left * (sine / (1.0 + cosine) if cosine > 0.0 else (1.0 - cosine) / sine)
    return scale3(1.0 / (1.0 + half * half), add3(scale3(1.0 - half * half, u), scale3(2.0 * half, along)))


@kernel
def slide(z, dz, move, dmove, before, s, ds):
    """The stretch after a straight piece on which s goes from ``before``, its variation, and whether it slides there.

    It sticks up to where it is as long as s.  From there on it turns towards the piece's direction: of tan(angle / 2)
    e^-1 is left after each length s, the solution of z' = y' less its part along z.  The variation is that of a stretch
    that is shortened to s, which is next to it.
    """
    whole, dz = add3(z, move), add3(dz, dmove)
    square = dot3(whole, whole)
    if square <= s * s:
        return whole, dz, False
    if s == 0.0:
        return _ZERO, _ZERO, True
    length = math.sqrt(dot3(move, move))
    e = scale3(1.0 / math.sqrt(square), whole)
    if length > 0.0:
        share = _share_that_sticks(z, move, length, before, s - before)
        met = add3(z, scale3(share, move))
        radius = math.sqrt(dot3(met, met))
        if radius > 0.0:
            left = math.exp(-2.0 * (1.0 - share) * length / (radius + s))
            e = _turned(scale3(1.0 / radius, met), scale3(1.0 / length, move), left)
    across = sub3(dz, scale3(dot3(e, dz), e))
    return scale3(s, e), add3(scale3(s / math.sqrt(square), across), scale3(ds, e)), True


@kernel
def _longest(law, depth, e):
    """s, and its variation, where the share e of the time is left; 0 where nothing touches."""
    data, o, D, per, dper, N, dN = law
    if e == 0.0:
        return per * N, dper * N + per * dN
    duration, last, (first, second, third), dlast, (dfirst, dsecond, dthird) = depth
    deep, ddeep = last[0] + e * (first + e * (second + e * third)), dlast[0] + e * (dfirst + e * (dsecond + e * dthird))
    rate, drate = last[1], dlast[1]
    if duration > 0.0:
        rate = -(first + e * (2.0 * second + e * 3.0 * third)) / duration
        drate = -(dfirst + e * (2.0 * dsecond + e * 3.0 * dthird)) / duration
    N, by_depth, by_rate = normal_force(data, o, D, deep, rate)
    return per * N, dper * N + per * (by_depth * ddeep + by_rate * drate)


@kernel
def _touches_at(depth):
    """The share of the time that is left where the surfaces touch; 1 where they do from the begin."""
    _, last, (first, second, third), _, _ = depth
    if last[0] + first + second + third >= 0.0:
        return 1.0
    inside, outside = 0.0, 1.0
    for _ in range(_HALVINGS):
        e = 0.5 * (inside + outside)
        if last[0] + e * (first + e * (second + e * third)) > 0.0:
            inside = e
        else:
            outside = e
    return inside


@kernel
def _beyond(law, depth, way, z, place, e):
    """How much the stretch would be longer than s where the share e is left, from z at ``place``."""
    reached = add3(z, sub3(_from_end(way[0], way[1], way[2], e), place))
    return math.sqrt(dot3(reached, reached)) - _longest(law, depth, e)[0]


@kernel
def _farthest(law, depth, way, z, place, left, end):
    """Where on a piece, which ends sticking, the stretch would be longest beyond s; its begin where it never is."""
    whole = left - end
    slides = False
    for share in (1e-3, 0.1, 0.5):
        slides = slides or _beyond(law, depth, way, z, place, left - share * whole) > 0.0
    if not slides:
        return left
    low, high = end, left
    for _ in range(_SECTIONS):
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if _beyond(law, depth, way, z, place, a) > _beyond(law, depth, way, z, place, b):
            high = b
        else:
            low = a
    return 0.5 * (low + high)


@kernel
def _lead(law, depth, way, dway, begin, end):
    """Lead (z, dz) from where a share is left, ``begin`` with it, to where ``end`` is left; whether it slides there.

    In several parts where it slides no farther than turns the bristle, for they bend.
    """
    z, dz, left = begin
    place, there = _from_end(way[0], way[1], way[2], left), _from_end(way[0], way[1], way[2], end)
    last, dlast = _longest(law, depth, end)
    s = last
    move = sub3(there, place)
    reached = add3(z, move)
    bends = dot3(reached, reached) > s * s and dot3(move, move) < _TURNED * _TURNED * s * s
    parts = _PARTS if bends else 1
    step = (left - end) / parts
    dplace, slides = _from_end(dway[0], dway[1], dway[2], left), False
    before, _ = _longest(law, depth, left)
    for part in range(parts):
        here = end + (parts - 1 - part) * step
        there, dthere = _from_end(way[0], way[1], way[2], here), _from_end(dway[0], dway[1], dway[2], here)
        s, ds = (last, dlast) if part == parts - 1 else _longest(law, depth, here)
        z, dz, slides = slide(z, dz, sub3(there, place), sub3(dthere, dplace), before, s, ds)
        place, dplace, before = there, dthere, s
    return z, dz, slides


@kernel
def follow(z, way, dway, law, depth):
    """The stretch at the end of a way that begins with z, its variation, whether it slides there, and whether before.

    ``way``, ``dway``: the cubic by its coefficients, from its end back; ``law``, ``depth``: see ``stretch``.
    """
    dz, slid = _ZERO, False
    left = _touches_at(depth)
    s = _longest(law, depth, 0.0)[0]
    if left < 1.0:
        z = _ZERO
    turns = _turns(way[0], way[1], way[2])
    for piece in range(2 + _PIECES):
        if piece < 2:
            end = turns[piece]
            if not end < left:
                continue
        else:
            place = _from_end(way[0], way[1], way[2], left)
            reached = sub3(z, place)
            if dot3(reached, reached) > s * s:
                if not dot3(place, place) > _TURNED * _TURNED * s * s:
                    break
                end = _SHORTER * left
            else:
                end = _farthest(law, depth, way, z, place, left, 0.0)
                if not end < left:
                    break
        z, dz, longer = _lead(law, depth, way, dway, (z, dz, left), end)
        slid, left = slid or longer, end
    z, dz, slides = _lead(law, depth, way, dway, (z, dz, left), 0.0)
    return z, dz, slides, slid


@kernel
def _part(n, across, v):
    """The part of a vector across the unit vector n, or along it."""
    along = scale3(dot3(n, v), n)
    return sub3(v, along) if across else along


@kernel
def stretch(kept, n, way, dway, law, depth, ddepth):
    """The stretch at the end of a way, its variation, whether it slides there and whether before.

    ``kept``: the memory, where a contact's begins, the time (s), where in that the bristle's stretch, way and rate
    begin, and whether the bristle lies across the unit vector n or along it.  ``way``: to where it has come, and its
    rate, which has no other part; ``depth``: likewise; then the variations of both.  ``law``: where the normal force's
    numbers are, its D, the length at which the bristle slides under 1 N (m/N) with its variation, and the normal force
    at the end (N) with its own.
    """
    memory, m, t, bristle, across = kept
    duration = t - memory[m + at.MEMORY_TIME]
    duration = duration if duration > 0.0 else 0.0  # before a start has written it: straight on
    o = m + at.N_MEMORY_HEAD
    b = o + bristle
    whole = _part(n, across, sub3(way[0], load3(memory, b + WAY)))
    before = scale3(duration, _part(n, across, load3(memory, b + RATE)))
    z = _part(n, across, load3(memory, b + STRETCH))
    grown, first, last = depth[0] - memory[o + DEPTH], duration * memory[o + DEPTH_RATE], duration * depth[1]
    dlast = duration * ddepth[1]
    end, dwhole = scale3(duration, way[1]), _part(n, across, dway[0])
    if memory[o + DEPTH] >= 0.0:
        data, numbers, D, per, _, N, _ = law
        first_N = normal_force(data, numbers, D, memory[o + DEPTH], memory[o + DEPTH_RATE])[0]
        farthest = _length(z) + _length(whole) + _ASIDE * (_length(before) + _length(end))
        if farthest < _FAR * per * min(N, first_N):
            return add3(z, whole), dwhole, False, False  # it sticks, far from sliding
    dend = scale3(duration, _part(n, across, dway[1]))
    cubic = -last, 2.0 * last + first - 3.0 * grown, 2.0 * grown - first - last
    dcubic = -dlast, 2.0 * dlast - 3.0 * ddepth[0], 2.0 * ddepth[0] - dlast
    back = (
        scale3(-1.0, end), sub3(add3(scale3(2.0, end), before), scale3(3.0, whole)),
        sub3(scale3(2.0, whole), add3(before, end)),
    )  # fmt: skip
    dback = (
        scale3(-1.0, dend), sub3(scale3(2.0, dend), scale3(3.0, dwhole)), sub3(scale3(2.0, dwhole), dend),
    )  # fmt: skip
    return follow(z, back, dback, law, (duration, depth, cubic, ddepth, dcubic))


@kernel
def keep(x, m, t, piece, z, way, depth, onset):
    """Write into the configuration x what a contact remembers.

    The time, the piece of friction's law, the stretch, the way and the depth with their rates, the speed at which the
    surfaces met.
    """
    x[m + at.MEMORY_TIME] = t
    x[m + at.MEMORY_PIECE] = piece
    x[m + at.MEMORY_DEFORMATION] = math.sqrt(dot3(z, z))
    x[m + at.MEMORY_RATE] = math.sqrt(dot3(way[1], way[1]))
    o = m + at.N_MEMORY_HEAD
    store3(x, o + STRETCH, z)
    store3(x, o + WAY, way[0])
    store3(x, o + RATE, way[1])
    x[o + DEPTH], x[o + DEPTH_RATE] = depth
    x[o + ONSET] = onset
