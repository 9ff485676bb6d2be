"""All impulses of a step by Gauss and Seidel's method, contact by contact, and positions by the same sweeps.

No matrix of contacts against contacts: velocities and twists hold what all impulses make together (Moreau 1999; Jean
1999).  Sweeps are accelerated as conjugate gradients are (Silcowitz-Hansen, Niebe & Erleben 2010).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import dot3, load3, load9, rotate, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.contact_rows import gather, normal_at, push, velocity_at, velocity_by
from flexmbd.multibody.kernels.impulses.lone_bodies import settle, take_twists
from flexmbd.multibody.kernels.impulses.point_law import point_impulse

_LOOK = 4  # every so many sweeps of positions all contacts are looked at; in between those that push
_OF_THOSE = 16  # sweeps of the contacts that still change, before all are looked at
_OF_POSITION = 1e-3  # of the deepest overlap: what a projection may leave
_SWEEPS_OF_POSITION = 50
_ZERO = (0.0, 0.0, 0.0)


@kernel
def _solve_point(parts, contacts, i, v):
    """Give contact i the impulse that its law asks for; by how much its velocity changes (m/s)."""
    P = load3(contacts.impulse[i], 0)
    if P == _ZERO and normal_at(parts, contacts, i, v) >= contacts.bound[i]:
        return 0.0  # as most contacts that may touch do not
    W = load9(contacts.own[i], 0)
    q = sub3(velocity_at(parts, contacts, i, v), rotate(W, P))
    above = (q[0] - contacts.bound[i], q[1], q[2])
    found = point_impulse(W, contacts.stick[i], contacts.friction[i], above, P)
    change = sub3(found, P)
    if change == _ZERO:
        return 0.0
    store3(contacts.impulse[i], 0, found)
    push(parts, contacts, i, change, v)
    moved = rotate(W, change)
    return max(abs(moved[0]), abs(moved[1]), abs(moved[2]))


@kernel
def _sweep(parts, contacts, v, all_of_them):
    """All contacts there and back, or those listed; the largest change of a contact's velocity (m/s)."""
    n, change = contacts.count[0] if all_of_them else contacts.pending[0], 0.0
    for k in range(2 * n):
        j = k if k < n else 2 * n - 1 - k
        change = max(change, _solve_point(parts, contacts, j if all_of_them else contacts.listed[j], v))
    return change


@kernel
def _begin(parts, contacts, v):
    """Let the impulses at hand act."""
    take_twists(parts, v)
    for i in range(contacts.count[0]):
        P = load3(contacts.impulse[i], 0)
        if P != _ZERO:
            push(parts, contacts, i, P, v)


@kernel
def _hold(parts, contacts, v):
    """Note where a sweep begins; nothing leads ahead."""
    lone = parts.lone
    for i in range(contacts.count[0]):
        store3(contacts.old[i], 0, load3(contacts.impulse[i], 0))
        store3(contacts.ahead[i], 0, _ZERO)
    for c in range(lone.body.shape[0]):
        for k in range(6):
            lone.old[c, k], lone.ahead[c, k] = lone.twist[c, k], 0.0
    if parts.widest[0] > 0:
        for k in range(v.shape[0]):
            contacts.v_old[k], contacts.v_ahead[k] = v[k], 0.0


@kernel
def _list_pending(parts, contacts, v, share):
    """List the contacts whose velocities the last sweep changed by more than half of a ``share`` of those to be met.

    These are the root mean square over the contacts that push.  Returns it, and the largest change (m/s).
    """
    lone, n, met, pushing, largest = parts.lone, 0, 0.0, 0, 0.0
    for c in range(lone.body.shape[0]):
        for k in range(6):
            lone.change[c, k] = lone.twist[c, k] - lone.old[c, k]
    if parts.widest[0] > 0:
        for k in range(v.shape[0]):
            contacts.v_change[k] = v[k] - contacts.v_old[k]
    for i in range(contacts.count[0]):
        if contacts.impulse[i, 0] > 0.0:
            met += contacts.speed[i] ** 2
            pushing += 1
    met = math.sqrt(met / pushing) if pushing > 0 else 0.0
    for i in range(contacts.count[0]):
        u = velocity_by(parts, contacts, i, lone.change, contacts.v_change)
        change = math.sqrt(dot3(u, u))
        if not change <= largest:
            largest = change
        if change > 0.5 * share * met:
            contacts.listed[n] = i
            n += 1
    contacts.pending[0] = n
    return met, largest


@kernel
def _energy(contacts):
    """The energy (J) of what the last sweep changed, the contacts listed each seen alone."""
    energy = 0.0
    for j in range(contacts.pending[0]):
        i = contacts.listed[j]
        change = sub3(load3(contacts.impulse[i], 0), load3(contacts.old[i], 0))
        energy += dot3(change, rotate(load9(contacts.own[i], 0), change))
    return energy


@kernel
def _go_on(parts, contacts, v, share):
    """Add to what the last sweep did a share of where those before it led."""
    lone = parts.lone
    for j in range(contacts.pending[0]):
        i = contacts.listed[j]
        _extrapolate(contacts.impulse[i], contacts.old[i], contacts.ahead[i], share)
    for c in range(lone.body.shape[0]):
        _extrapolate(lone.twist[c], lone.old[c], lone.ahead[c], share)
    if parts.widest[0] > 0:
        _extrapolate(v, contacts.v_old, contacts.v_ahead, share)


@kernel
def _extrapolate(now, old, ahead, share):
    for k in range(now.shape[0]):
        step, more = now[k] - old[k], share * ahead[k]
        now[k] += more
        ahead[k] = step + more
        old[k] = now[k]


@kernel
def _sweep_pending(parts, contacts, v, enough):
    """Sweep over the contacts listed until their velocities change by no more than ``enough`` (m/s); how often."""
    before = 0.0
    _hold(parts, contacts, v)
    for sweep in range(_OF_THOSE):
        if _sweep(parts, contacts, v, False) <= enough:
            return sweep + 1
        energy = _energy(contacts)
        _go_on(parts, contacts, v, energy / before if energy < before else 0.0)
        before = energy
    return _OF_THOSE


@kernel
def solve_impulses(parts, contacts, v, share, nothing, most):
    """Sweep until no contact's velocity changes by more than a ``share`` of those to be met, or ``nothing`` (m/s).

    In between all contacts those that still change are swept by themselves.  Returns the sweeps, and the share at last;
    infinite where velocities are not finite.
    """
    _begin(parts, contacts, v)
    sweeps = 0
    while True:
        _hold(parts, contacts, v)
        change = _sweep(parts, contacts, v, True)
        sweeps += 1
        met, largest = _list_pending(parts, contacts, v, share)
        if not largest < math.inf:
            return sweeps, math.inf
        done = largest <= share * met or change <= nothing
        if done or sweeps >= most:
            _take_lone(parts, contacts, v)
            return sweeps, 0.0 if done else largest / met
        sweeps += _sweep_pending(parts, contacts, v, 0.25 * share * met)


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
def _sweep_positions(parts, contacts, moved, look, forth):
    """All contacts, or those listed; lists those that push if it looks at all.  The largest change of a gap (m)."""
    n, change, pushing = contacts.count[0] if look else contacts.pending[0], 0.0, 0
    for k in range(n):
        i = k if forth else n - 1 - k
        if not look:
            i = contacts.listed[i]
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
        if look and found > 0.0:
            contacts.listed[pushing] = i
            pushing += 1
    if look:
        contacts.pending[0] = pushing
    return change


@kernel
def solve_positions(parts, contacts, moved):
    """Write the displacement (nv,) that opens all overlaps, the least in the metric of the masses, normals alone.

    ``contacts.shift`` (m) are the gaps without it.
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
    look = True
    for sweep in range(_SWEEPS_OF_POSITION):
        change = _sweep_positions(parts, contacts, moved, look, sweep % 2 == 0)
        done = change <= _OF_POSITION * deepest
        if done and look:
            break
        look = done or (sweep + 1) % _LOOK == 0
    _clear_wrenches(lone)
    for i in range(n):
        if contacts.push[i] > 0.0:
            gather(parts, contacts, i, (contacts.push[i], 0.0, 0.0))
    settle(parts, moved)
