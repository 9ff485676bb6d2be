"""All impulses of a step by Gauss and Seidel's method, contact by contact, and positions by the same sweeps.

No matrix of contacts against contacts: the machine's velocities hold what all impulses make together (Moreau 1999;
Jean 1999).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, load9, scale3, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.contact_rows import normal_at, push, velocity_at
from flexmbd.multibody.kernels.impulses.point_law import point_impulse
from flexmbd.multibody.kernels.impulses.pressed_point import pressed_impulse

_OF_POSITION = 1e-3  # of the deepest overlap: what a projection may leave
_SWEEPS_OF_POSITION = 50
_ZERO = (0.0, 0.0, 0.0)


@kernel
def _own_part(W, P):
    """W P."""
    return (
        W[0] * P[0] + W[1] * P[1] + W[2] * P[2],
        W[3] * P[0] + W[4] * P[1] + W[5] * P[2],
        W[6] * P[0] + W[7] * P[1] + W[8] * P[2],
    )


@kernel
def _solve_point(parts, contacts, i, v):
    """Give contact i the impulse that its law asks for; by how much its velocity changes (m/s)."""
    W, P = load9(contacts.own[i], 0), load3(contacts.impulse[i], 0)
    least = contacts.least[i]
    if P == _ZERO and least == 0.0 and normal_at(parts, contacts, i, v) >= contacts.bound[i]:
        return 0.0  # as most contacts that may touch do not
    q = sub3(velocity_at(parts, contacts, i, v), _own_part(W, P))
    found = point_impulse(W, contacts.friction[i], (q[0] - contacts.bound[i], q[1], q[2]), P)
    if found[0] < least:
        found = pressed_impulse(W, contacts.friction[i], q, least)
    change = sub3(found, P)
    if change[0] == 0.0 and change[1] == 0.0 and change[2] == 0.0:
        return 0.0
    store3(contacts.impulse[i], 0, found)
    push(parts, contacts, i, change, v)
    moved = _own_part(W, change)
    return max(abs(moved[0]), abs(moved[1]), abs(moved[2]))


@kernel
def _sweep(parts, contacts, v):
    """All contacts there and back; the largest change of a contact's velocity (m/s)."""
    n, change = contacts.count[0], 0.0
    for k in range(2 * n):
        i = k if k < n else 2 * n - 1 - k
        change = max(change, _solve_point(parts, contacts, i, v))
    return change


@kernel
def _go_on(parts, contacts, v, before):
    """Add to what the last sweep did a share of what those before it did; the square of its own change ((N s)^2).

    The share is Fletcher's and Reeves' of conjugate gradients, none where sweeps change more than before.
    """
    n, size = contacts.count[0], 0.0
    for i in range(n):
        step = sub3(load3(contacts.impulse[i], 0), load3(contacts.old[i], 0))
        size += dot3(step, step)
    share = size / before if size < before else 0.0
    for i in range(n):
        P, ahead = load3(contacts.impulse[i], 0), scale3(share, load3(contacts.ahead[i], 0))
        store3(contacts.ahead[i], 0, add3(ahead, sub3(P, load3(contacts.old[i], 0))))
        if share > 0.0:
            push(parts, contacts, i, ahead, v)
            P = add3(P, ahead)
            store3(contacts.impulse[i], 0, P)
        store3(contacts.old[i], 0, P)
    return size


@kernel
def solve_impulses(parts, contacts, v, least, most):
    """Sweep until no contact's velocity changes by more than ``least`` (m/s); the sweeps, and the last change.

    Sweeps are accelerated as conjugate gradients are (Silcowitz-Hansen, Niebe & Erleben 2010).
    """
    n = contacts.count[0]
    for i in range(n):
        P = load3(contacts.impulse[i], 0)
        push(parts, contacts, i, P, v)
        store3(contacts.old[i], 0, P)
        store3(contacts.ahead[i], 0, (0.0, 0.0, 0.0))
    size, change = 0.0, 0.0
    for sweep in range(most):
        change = _sweep(parts, contacts, v)
        if not change > least:
            return sweep + 1, change
        size = _go_on(parts, contacts, v, size)
    return most, _sweep(parts, contacts, v)


@kernel
def solve_positions(parts, contacts, moved):
    """Write the displacement (nv,) that opens all overlaps, the least in the metric of the masses, normals alone.

    ``contacts.shift`` (m) are the gaps without it.
    """
    n = contacts.count[0]
    deepest = 0.0
    for k in range(moved.shape[0]):
        moved[k] = 0.0
    for i in range(n):
        contacts.push[i] = 0.0
        deepest = max(deepest, -contacts.shift[i])
    for sweep in range(_SWEEPS_OF_POSITION):
        change = 0.0
        for k in range(n):
            i = k if sweep % 2 == 0 else n - 1 - k
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
        if change <= _OF_POSITION * deepest:
            break
