"""All impulses of a step by Gauss and Seidel's method, contact by contact, and positions by the same sweeps.

No matrix of contacts against contacts: velocities and twists hold what all impulses make together (Moreau 1999; Jean
1999).  Sweeps are accelerated as Nesterov's gradients are (1983; Mazhar, Heyn, Negrut & Tasora 2015), from the start
again where one changes more than the one before (O'Donoghue & Candes 2015).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import dot3, load3, load9, rotate, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.contact_rows import gather, normal_at, push, velocity_at
from flexmbd.multibody.kernels.impulses.lone_bodies import settle, take_twists
from flexmbd.multibody.kernels.impulses.point_law import point_impulse
from flexmbd.multibody.kernels.impulses.pressed_point import pressed_impulse

_OF_POSITION = 1e-3  # of the deepest overlap: what a projection may leave
_SWEEPS_OF_POSITION = 15
_ZERO = (0.0, 0.0, 0.0)


@kernel
def _solve_point(parts, contacts, i, v):
    """Give contact i the impulse that its law asks for."""
    P, least = load3(contacts.impulse[i], 0), contacts.least[i]
    if P == _ZERO and least == 0.0 and normal_at(parts, contacts, i, v) >= contacts.bound[i]:
        return  # as most contacts that may touch do not
    W = load9(contacts.own[i], 0)
    q = sub3(velocity_at(parts, contacts, i, v), rotate(W, P))
    above = (q[0] - contacts.bound[i], q[1], q[2])
    found = point_impulse(W, contacts.stick[i], contacts.friction[i], above, P)
    if found[0] < least:
        found = pressed_impulse(W, contacts.friction[i], q, least)
    change = sub3(found, P)
    if change != _ZERO:
        store3(contacts.impulse[i], 0, found)
        push(parts, contacts, i, change, v)


@kernel
def _sweep(parts, contacts, v):
    """All contacts there and back."""
    n = contacts.count[0]
    for k in range(2 * n):
        _solve_point(parts, contacts, k if k < n else 2 * n - 1 - k, v)


@kernel
def _begin(parts, contacts, v):
    """Let the impulses at hand act; nothing leads ahead."""
    lone = parts.lone
    take_twists(parts, v)
    for i in range(contacts.count[0]):
        P = load3(contacts.impulse[i], 0)
        if P != _ZERO:
            push(parts, contacts, i, P, v)
        store3(contacts.old[i], 0, P)
        store3(contacts.ahead[i], 0, _ZERO)
    for c in range(lone.body.shape[0]):
        for k in range(6):
            lone.old[c, k], lone.ahead[c, k] = lone.twist[c, k], 0.0
    for k in range(v.shape[0]):
        contacts.v_old[k], contacts.v_ahead[k] = v[k], 0.0


@kernel
def _progress(contacts):
    """What the last sweep changed, over the contacts that push or did, each seen alone.

    The root mean squares of their velocities' changes and of the speeds that impulses meet there (m/s), and the energy
    of the changes (J).
    """
    n, changed, met, energy = 0, 0.0, 0.0, 0.0
    for i in range(contacts.count[0]):
        P, old = load3(contacts.impulse[i], 0), load3(contacts.old[i], 0)
        if P == _ZERO and old == _ZERO:
            continue
        step = sub3(P, old)
        u = rotate(load9(contacts.own[i], 0), step)
        changed += dot3(u, u)
        met += contacts.speed[i] ** 2
        energy += dot3(step, u)
        n += 1
    return math.sqrt(changed / max(n, 1)), math.sqrt(met / max(n, 1)), energy


@kernel
def _go_on(parts, contacts, v, share):
    """Add to what the last sweep did a share of where those before it led."""
    lone = parts.lone
    for i in range(contacts.count[0]):
        _extrapolate(contacts.impulse[i], contacts.old[i], contacts.ahead[i], share)
    for c in range(lone.body.shape[0]):
        _extrapolate(lone.twist[c], lone.old[c], lone.ahead[c], share)
    _extrapolate(v, contacts.v_old, contacts.v_ahead, share)


@kernel
def _extrapolate(now, old, ahead, share):
    for k in range(now.shape[0]):
        step, more = now[k] - old[k], share * ahead[k]
        now[k] += more
        ahead[k] = step + more
        old[k] = now[k]


@kernel
def solve_impulses(parts, contacts, v, share, nothing, most):
    """Sweep until one changes the contacts' velocities by a ``share`` of the speeds met, or by ``nothing`` (m/s).

    Both are root mean squares over the contacts that push.  Returns the sweeps, at ``most`` so many, and the share at
    last, zero where that or nothing is reached, infinite where velocities are not finite.
    """
    _begin(parts, contacts, v)
    before, since = math.inf, 0
    for sweep in range(most):
        _sweep(parts, contacts, v)
        changed, met, energy = _progress(contacts)
        if not changed < math.inf:
            return sweep + 1, math.inf
        done = changed <= share * met or changed <= nothing
        if done or sweep + 1 == most:
            _take_lone(parts, contacts, v)
            return sweep + 1, 0.0 if done else changed / met
        since = since + 1 if energy <= before else 1
        before = energy
        _go_on(parts, contacts, v, (since - 1.0) / (since + 2.0))
    return most, math.inf


@kernel
def _take_lone(parts, contacts, v):
    """Add to v what the impulses make of the velocities that stand in no rows: those of lone bodies' parts."""
    _clear_wrenches(parts.lone)
    for i in range(contacts.count[0]):
        P = load3(contacts.impulse[i], 0)
        if P != _ZERO:
            gather(parts, contacts, i, P)
    settle(parts, v)


@kernel
def _clear_wrenches(lone):
    for c in range(lone.body.shape[0]):
        for k in range(6):
            lone.wrench[c, k] = 0.0


@kernel
def _sweep_positions(parts, contacts, moved, forth):
    """All contacts, one way; the largest change of a gap (m)."""
    n, change = contacts.count[0], 0.0
    for k in range(n):
        i = k if forth else n - 1 - k
        W = contacts.own[i, 0]
        if not W > 0.0:
            continue
        gap = contacts.shift[i] + normal_at(parts, contacts, i, moved)
        found = max(0.0, contacts.push[i] - gap / W)
        if found != contacts.push[i]:
            more = found - contacts.push[i]
            push(parts, contacts, i, (more, 0.0, 0.0), moved)
            contacts.push[i] = found
            change = max(change, abs(more) * W)
    return change


@kernel
def solve_positions(parts, contacts, moved, enough):
    """Write the displacement (nv,) that opens all overlaps, the least in the metric of the masses, normals alone.

    ``contacts.shift`` (m) are the gaps without it.  A sweep that changes none of them by more than ``enough`` (m) is
    the last.
    """
    n, lone = contacts.count[0], parts.lone
    deepest = 0.0
    for k in range(moved.shape[0]):
        moved[k] = 0.0
    for c in range(lone.body.shape[0]):
        for k in range(6):
            lone.twist[c, k] = 0.0
    for i in range(n):
        contacts.push[i] = 0.0
        deepest = max(deepest, -contacts.shift[i])
    enough = max(enough, _OF_POSITION * deepest)
    for sweep in range(_SWEEPS_OF_POSITION):
        if _sweep_positions(parts, contacts, moved, sweep % 2 == 0) <= enough:
            break
    _clear_wrenches(lone)
    for i in range(n):
        if contacts.push[i] > 0.0:
            gather(parts, contacts, i, (contacts.push[i], 0.0, 0.0))
    settle(parts, moved)
