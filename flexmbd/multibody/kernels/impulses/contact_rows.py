"""The contacts of a step: how their points move against each other, u = J v, and what impulses change, v += Y^T P.

A side that is a lone body moves by its twist (``lone_bodies``).  Of others J is the dual of unit forces at the point,
carried inwards along both bodies' paths alone, and Y = J M^-1 by the inverses of the parts that the bodies belong to.
Rows are along the normal and two tangents.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.lone_bodies import add_wrench, answer, push_body, velocity_of
from flexmbd.multibody.kernels.impulses.parts import rows_of, size_of
from flexmbd.multibody.kernels.impulses.point_law import write_stick
from flexmbd.multibody.kernels.impulses.unit_forces import forget_paths, unit_force
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Contacts(ArrayStruct):
    """The contacts of the step at hand, the first ``count`` of as many as there is room for.

    Attributes:
        count: (1,).
        watched: (k,) which of the watched points each is.
        parts: (k, 2) the machine's parts whose velocities stand in its rows, of F and of G; -1 the ground, a lone
            body, or that G is of F's.
        lone: (k, 2) the parts whose lone bodies F and G are on, -1 of others.
        arms: (k, 6) m, inertial axes, from the places of these to the point.
        first: (k + 1,) where its entries begin in ``jacobian`` and ``response``, each (3, size) by rows.
        jacobian, response: J and Y.
        basis: (k, 9) normal and tangents by rows.
        own: (k, 9) J Y^T, 1/kg.
        stick: (k, 6) minus its inverse, by which a contact sticks.
        bound: (k,) m/s, the least normal velocity at the step's end; least: (k,) N s, the least normal impulse.
        friction: (k,) its coefficient.
        speed: (k,) m/s, that which impulses meet there: of the approach without them, and of what smooth forces make.
        impulse: (k, 3) N s on G, along the rows of ``basis``; old, ahead: before a sweep, and where sweeps lead.
        shift, push: (k,) m, the gap at the step's end, and the multiplier that opens it where it is closed.
        row: (nv,) scratch, zero between uses.
        v_old, v_ahead: (nv,) as those of lone bodies, of the velocities that stand in rows.
    """

    count: IntArray
    watched: IntArray
    parts: IntArray
    lone: IntArray
    arms: FloatArray
    first: IntArray
    jacobian: FloatArray
    response: FloatArray
    basis: FloatArray
    own: FloatArray
    stick: FloatArray
    bound: FloatArray
    least: FloatArray
    friction: FloatArray
    speed: FloatArray
    impulse: FloatArray
    old: FloatArray
    ahead: FloatArray
    shift: FloatArray
    push: FloatArray
    row: FloatArray
    v_old: FloatArray
    v_ahead: FloatArray


def new_contacts(count: int, widest: int, nv: int) -> Contacts:
    """Room for ``count`` contacts, with so many velocities in a side's rows at most."""
    zeros, whole, entries = np.zeros, np.int64, 6 * count * widest
    return Contacts(
        zeros(1, whole), zeros(count, whole), zeros((count, 2), whole), zeros((count, 2), whole), zeros((count, 6)),
        zeros(count + 1, whole), zeros(entries), zeros(entries), zeros((count, 9)), zeros((count, 9)),
        zeros((count, 6)), zeros(count), zeros(count), zeros(count), zeros(count), zeros((count, 3)), zeros((count, 3)),
        zeros((count, 3)), zeros(count), zeros(count), zeros(nv), zeros(nv), zeros(nv),
    )  # fmt: skip


@kernel
def _store_basis(basis, n):
    """Rows: the normal, and two tangents that follow from it alone."""
    x, y, z = abs(n[0]), abs(n[1]), abs(n[2])
    e = (1.0, 0.0, 0.0)
    if y < x or z < x:
        e = (0.0, 1.0, 0.0) if y <= z else (0.0, 0.0, 1.0)
    t = cross3(n, e)
    t = scale3(1.0 / math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]), t)
    store3(basis, 0, n)
    store3(basis, 3, t)
    store3(basis, 6, cross3(n, t))


@kernel
def _is_held(contacts, i):
    """Whether joints let nothing move along the normal of contact i, beside its tangents: then no impulse acts.

    What is left of the mobility is the square of round-off.
    """
    normal = contacts.own[i, 0]
    return normal <= EQUAL * EQUAL * (normal + contacts.own[i, 4] + contacts.own[i, 8])


@kernel
def enter(plan, work, parts, contacts, i, frames, point, normal):
    """Write what moves contact i of this step, and how it follows impulses there."""
    bf, bg = plan.frame_of[frames[0], at.FRAME_BODY], plan.frame_of[frames[1], at.FRAME_BODY]
    a = parts.of[bf] if bf >= 0 else -1
    b = parts.of[bg] if bg >= 0 else -1
    own = contacts.own[i]
    for k in range(9):
        own[k] = 0.0
    _store_basis(contacts.basis[i], load3(normal, 0))
    _enter_lone(parts.lone, contacts, i, a if a != b else -1, load3(point, 0), 0)
    _enter_lone(parts.lone, contacts, i, b if a != b else -1, load3(point, 0), 1)
    n = rows_of(parts, a)
    m = rows_of(parts, b) if a != b else 0
    contacts.parts[i, 0] = a if n > 0 else -1
    contacts.parts[i, 1] = b if m > 0 else -1
    contacts.first[i + 1] = contacts.first[i] + 3 * (n + m)
    if n + m > 0:
        _enter_rows(plan, work, parts, contacts, i, frames, point)
    if _is_held(contacts, i):
        own[0], own[1], own[2], own[3], own[6] = 0.0, 0.0, 0.0, 0.0, 0.0
    write_stick(load9(own, 0), contacts.stick[i])


@kernel
def _enter_lone(lone, contacts, i, c, point, side):
    """Write part c and the arm of its body, if that is a lone one, as a side of contact i."""
    contacts.lone[i, side] = -1
    if c < 0 or lone.body[c] < 0:
        return
    contacts.lone[i, side] = c
    arm, own = sub3(point, load3(lone.place[c], 0)), contacts.own[i]
    store3(contacts.arms[i], 3 * side, arm)
    mobility = lone.mobility[c]
    linear = mobility[0] + mobility[7] + mobility[14]
    angular = mobility[21] + mobility[28] + mobility[35]
    for s in range(3):
        force = load3(contacts.basis[i], 3 * s)
        moment = cross3(arm, force)
        v, w = answer(mobility, force, moment)
        if not dot3(force, v) + dot3(moment, w) > EQUAL * (linear + dot3(moment, moment) * angular):
            continue  # its joints do not let it move that way
        u = rotate(load9(contacts.basis[i], 0), add3(v, cross3(w, arm)))
        own[s] += u[0]
        own[3 + s] += u[1]
        own[6 + s] += u[2]


@kernel
def _enter_rows(plan, work, parts, contacts, i, frames, point):
    """Write J and Y, and add J Y^T to ``own``."""
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    size, first, row = n + m, contacts.first[i], contacts.row
    for r in range(3):
        unit_force(plan, work, frames[0], frames[1], load3(point, 0), load3(contacts.basis[i], 3 * r), row)
        own = contacts.jacobian[first + r * size : first + (r + 1) * size]
        for k in range(n):
            own[k] = row[parts.velocity[parts.first[a] + k]]
        for k in range(m):
            own[n + k] = row[parts.velocity[parts.first[b] + k]]
        reply = contacts.response[first + r * size : first + (r + 1) * size]
        _respond(parts, a, n, own[:n], reply[:n])
        _respond(parts, b, m, own[n:], reply[n:])
    forget_paths(plan, work, plan.frame_of[frames[0], at.FRAME_BODY], plan.frame_of[frames[1], at.FRAME_BODY], row)
    for r in range(3):
        for s in range(3):
            total = 0.0
            for k in range(size):
                total += contacts.jacobian[first + r * size + k] * contacts.response[first + s * size + k]
            contacts.own[i, 3 * r + s] += total


@kernel
def _respond(parts, c, n, force, out):
    """The velocities of part c that an impulse with these generalised components makes."""
    for i in range(n):
        total = 0.0
        o = parts.square[c] + i * n
        for j in range(n):
            total += parts.inverse[o + j] * force[j]
        out[i] = total


@kernel
def _between_lone(parts, contacts, i):
    """The velocity (m/s, inertial axes) of G's point against F's as far as lone bodies make it."""
    a, b = contacts.lone[i, 0], contacts.lone[i, 1]
    u = _ZERO
    if b >= 0:
        u = velocity_of(parts.lone, b, load3(contacts.arms[i], 3))
    if a >= 0:
        u = sub3(u, velocity_of(parts.lone, a, load3(contacts.arms[i], 0)))
    return u


@kernel
def velocity_at(parts, contacts, i, v):
    """u = J v of contact i: along the normal and both tangents."""
    x, y, z = rotate(load9(contacts.basis[i], 0), _between_lone(parts, contacts, i))
    o = contacts.first[i]
    if contacts.first[i + 1] == o:
        return x, y, z
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    size = n + m
    for k in range(n):
        w = v[parts.velocity[parts.first[a] + k]]
        x += contacts.jacobian[o + k] * w
        y += contacts.jacobian[o + size + k] * w
        z += contacts.jacobian[o + 2 * size + k] * w
    for k in range(m):
        w = v[parts.velocity[parts.first[b] + k]]
        x += contacts.jacobian[o + n + k] * w
        y += contacts.jacobian[o + size + n + k] * w
        z += contacts.jacobian[o + 2 * size + n + k] * w
    return x, y, z


@kernel
def normal_at(parts, contacts, i, v):
    """The first of ``velocity_at``."""
    x = dot3(load3(contacts.basis[i], 0), _between_lone(parts, contacts, i))
    o = contacts.first[i]
    if contacts.first[i + 1] == o:
        return x
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    for k in range(n):
        x += contacts.jacobian[o + k] * v[parts.velocity[parts.first[a] + k]]
    for k in range(m):
        x += contacts.jacobian[o + n + k] * v[parts.velocity[parts.first[b] + k]]
    return x


@kernel
def push(parts, contacts, i, P, v):
    """v, or the twists, += Y^T P of contact i; P along the normal and both tangents."""
    a, b = contacts.lone[i, 0], contacts.lone[i, 1]
    force = rotate_back(load9(contacts.basis[i], 0), P)
    if b >= 0:
        push_body(parts.lone, b, load3(contacts.arms[i], 3), force)
    if a >= 0:
        push_body(parts.lone, a, load3(contacts.arms[i], 0), scale3(-1.0, force))
    o = contacts.first[i]
    if contacts.first[i + 1] == o:
        return
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    size = n + m
    Y = contacts.response
    for k in range(n):
        v[parts.velocity[parts.first[a] + k]] += Y[o + k] * P[0] + Y[o + size + k] * P[1] + Y[o + 2 * size + k] * P[2]
    o += n
    for k in range(m):
        v[parts.velocity[parts.first[b] + k]] += Y[o + k] * P[0] + Y[o + size + k] * P[1] + Y[o + 2 * size + k] * P[2]


@kernel
def gather(parts, contacts, i, P):
    """Add P of contact i to the wrenches on its lone bodies."""
    a, b = contacts.lone[i, 0], contacts.lone[i, 1]
    force = rotate_back(load9(contacts.basis[i], 0), P)
    if b >= 0:
        add_wrench(parts.lone, b, load3(contacts.arms[i], 3), force)
    if a >= 0:
        add_wrench(parts.lone, a, load3(contacts.arms[i], 0), scale3(-1.0, force))
