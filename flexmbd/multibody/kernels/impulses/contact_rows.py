"""The contacts of a step: their velocities by the machine's, u = J v, and what impulses there change, dv = Y^T P.

J is the dual of unit forces at the point, carried inwards along both bodies' paths alone; Y = J M^-1 by the inverses of
the parts that the two bodies belong to.  Rows are along the normal and two tangents.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import cross3, load3, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.parts import size_of
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame, propagate_wrench
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
        parts: (k, 2) the machine's parts that F and G belong to; -1 the ground, or that G is of F's.
        first: (k + 1,) where its entries begin in ``jacobian`` and ``response``, each (3, size) by rows.
        jacobian, response: J and Y.
        basis: (k, 9) normal and tangents by rows.
        own: (k, 9) J Y^T, 1/kg.
        bound: (k,) m/s, the least normal velocity at the step's end.
        friction: (k,) its coefficient.
        impulse: (k, 3) N s on G, along the rows of ``basis``; old, ahead: before a sweep, and where sweeps lead.
        shift, push: (k,) m, the gap at the step's end, and the multiplier that opens it where it is closed.
        row: (nv,) scratch, zero between uses.
    """

    count: IntArray
    watched: IntArray
    parts: IntArray
    first: IntArray
    jacobian: FloatArray
    response: FloatArray
    basis: FloatArray
    own: FloatArray
    bound: FloatArray
    friction: FloatArray
    impulse: FloatArray
    old: FloatArray
    ahead: FloatArray
    shift: FloatArray
    push: FloatArray
    row: FloatArray


def new_contacts(count: int, entries: int, nv: int) -> Contacts:
    """Room for ``count`` contacts, whose J have so many ``entries`` in all."""
    zeros, whole = np.zeros, np.int64
    return Contacts(
        zeros(1, whole), zeros(count, whole), zeros((count, 2), whole), zeros(count + 1, whole),
        zeros(entries), zeros(entries), zeros((count, 9)), zeros((count, 9)), zeros(count), zeros(count),
        zeros((count, 3)), zeros((count, 3)), zeros((count, 3)), zeros(count), zeros(count), zeros(nv),
    )  # fmt: skip


@kernel
def _clear(plan, work, row, b):
    """Zero what body b is to take, and the row's entries of its velocities."""
    store3(work.body[b], at.B_F, _ZERO)
    store3(work.body[b], at.B_T, _ZERO)
    first = plan.tree[b, at.JOINT_V]
    for k in range(first, first + plan.tree[b, at.JOINT_SIZE]):
        row[k] = 0.0
    if plan.tree[b, at.FLEX] >= 0:
        first = plan.tree[b, at.MODAL_V]
        for k in range(first, first + plan.flex[plan.tree[b, at.FLEX], at.N_MODES]):
            row[k] = 0.0


@kernel
def _load_point(plan, work, f, p, force, out):
    """Add a force (N, inertial axes) at p on frame f to what its body is to take."""
    p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
    load_frame(plan, work, f, rotate_back(R_F, force), rotate_back(R_F, cross3(sub3(p, p_F), force)), out)


@kernel
def _unit_force(plan, work, f, g, p, e, row):
    """Write the generalised forces of a unit force e on g at p, and its opposite on f, along both paths."""
    i, j = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY]
    while i >= 0 or j >= 0:
        b = max(i, j)
        _clear(plan, work, row, b)
        i, j = _onwards(plan, i, j, b)
    _load_point(plan, work, g, p, e, row)
    _load_point(plan, work, f, p, scale3(-1.0, e), row)
    i, j = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY]
    while i >= 0 or j >= 0:
        b = max(i, j)
        propagate_wrench(plan, work, b, row)
        i, j = _onwards(plan, i, j, b)


@kernel
def _onwards(plan, i, j, b):
    """Both places on two paths inwards once body b is passed."""
    parent = plan.tree[b, at.PARENT]
    return parent if i == b else i, parent if j == b else j


@kernel
def _forget(plan, f, g, work, row):
    """Zero the row again."""
    i, j = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY]
    while i >= 0 or j >= 0:
        b = max(i, j)
        _clear(plan, work, row, b)
        i, j = _onwards(plan, i, j, b)


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
def enter(plan, work, parts, contacts, i, frames, point, normal):
    """Write basis, J, Y and J Y^T of contact i of this step."""
    f, g = frames[0], frames[1]
    bf, bg = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY]
    a = parts.of[bf] if bf >= 0 else -1
    b = parts.of[bg] if bg >= 0 else -1
    if a == b:
        b = -1
    contacts.parts[i, 0], contacts.parts[i, 1] = a, b
    _store_basis(contacts.basis[i], load3(normal, 0))
    n, m = size_of(parts, a), size_of(parts, b)
    size = n + m
    first = contacts.first[i]
    contacts.first[i + 1] = first + 3 * size
    for r in range(3):
        _unit_force(plan, work, f, g, load3(point, 0), load3(contacts.basis[i], 3 * r), contacts.row)
        own = contacts.jacobian[first + r * size : first + (r + 1) * size]
        for k in range(n):
            own[k] = contacts.row[parts.velocity[parts.first[a] + k]]
        for k in range(m):
            own[n + k] = contacts.row[parts.velocity[parts.first[b] + k]]
        answer = contacts.response[first + r * size : first + (r + 1) * size]
        _respond(parts, a, n, own[:n], answer[:n])
        _respond(parts, b, m, own[n:], answer[n:])
    _forget(plan, f, g, work, contacts.row)
    for r in range(3):
        for s in range(3):
            total = 0.0
            for k in range(size):
                total += contacts.jacobian[first + r * size + k] * contacts.response[first + s * size + k]
            contacts.own[i, 3 * r + s] = total


@kernel
def is_held(contacts, i):
    """Whether joints let nothing move along the normal of contact i, beside its tangents: then no impulse acts.

    What is left of the mobility is the square of round-off.
    """
    normal = contacts.own[i, 0]
    return normal <= EQUAL * EQUAL * (normal + contacts.own[i, 4] + contacts.own[i, 8])


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
def velocity_at(parts, contacts, i, v):
    """u = J v of contact i: along the normal and both tangents."""
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    size, o = n + m, contacts.first[i]
    x = y = z = 0.0
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
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m, o = size_of(parts, a), size_of(parts, b), contacts.first[i]
    x = 0.0
    for k in range(n):
        x += contacts.jacobian[o + k] * v[parts.velocity[parts.first[a] + k]]
    for k in range(m):
        x += contacts.jacobian[o + n + k] * v[parts.velocity[parts.first[b] + k]]
    return x


@kernel
def push(parts, contacts, i, P, v):
    """v += Y^T P of contact i; P along the normal and both tangents."""
    a, b = contacts.parts[i, 0], contacts.parts[i, 1]
    n, m = size_of(parts, a), size_of(parts, b)
    size, o = n + m, contacts.first[i]
    Y = contacts.response
    for k in range(n):
        v[parts.velocity[parts.first[a] + k]] += Y[o + k] * P[0] + Y[o + size + k] * P[1] + Y[o + 2 * size + k] * P[2]
    o += n
    for k in range(m):
        v[parts.velocity[parts.first[b] + k]] += Y[o + k] * P[0] + Y[o + size + k] * P[1] + Y[o + 2 * size + k] * P[2]
