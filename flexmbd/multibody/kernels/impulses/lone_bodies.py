"""Rigid bodies each of which is all that contacts reach of its part of the machine, as of a heap all are.

Such a part is to its contacts what its body's twist is, and how that follows a wrench on the body: six numbers and a
(6, 6) matrix, whatever the part.  Sweeps change the twists; the part's velocities follow once, from the sum of all
wrenches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, load9, rotate, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.impulses.unit_forces import forget_paths, unit_wrench

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class LoneBodies(ArrayStruct):
    """Of n parts of a machine; vectors in inertial axes, twists and wrenches about ``place``.

    Attributes:
        body: (n,) row of ``Plan.tree`` of the one body that contacts reach, if it is rigid; else -1.
        place: (n, 3) m, its centre of mass.
        force, reply: (6 k,) of k velocities of these parts in all, each (6, size): generalised forces of unit wrenches,
            and the velocities (1/kg and such) that these make.
        mobility: (n, 36) the change of the twist by unit wrenches, by columns.
        twist: (n, 6) m/s, rad/s.  old, ahead: before a sweep, and where sweeps lead.
        wrench: (n, 6) N s, N m s, the sum of all.
    """

    body: IntArray
    place: FloatArray
    force: FloatArray
    reply: FloatArray
    mobility: FloatArray
    twist: FloatArray
    old: FloatArray
    ahead: FloatArray
    wrench: FloatArray


def new_lone_bodies(body: IntArray, velocities: int) -> LoneBodies:
    """For parts with so many velocities in all."""
    n, zeros = len(body), np.zeros
    return LoneBodies(
        body, zeros((n, 3)), zeros(6 * velocities), zeros(6 * velocities), zeros((n, 36)),
        *(zeros((n, 6)) for _ in range(4)),
    )  # fmt: skip


@kernel
def answer(mobility, force, torque):
    """Twist that a wrench makes: velocity and angular velocity."""
    m, f, t = mobility, force, torque
    return (
        m[0] * f[0] + m[6] * f[1] + m[12] * f[2] + m[18] * t[0] + m[24] * t[1] + m[30] * t[2],
        m[1] * f[0] + m[7] * f[1] + m[13] * f[2] + m[19] * t[0] + m[25] * t[1] + m[31] * t[2],
        m[2] * f[0] + m[8] * f[1] + m[14] * f[2] + m[20] * t[0] + m[26] * t[1] + m[32] * t[2],
    ), (
        m[3] * f[0] + m[9] * f[1] + m[15] * f[2] + m[21] * t[0] + m[27] * t[1] + m[33] * t[2],
        m[4] * f[0] + m[10] * f[1] + m[16] * f[2] + m[22] * t[0] + m[28] * t[1] + m[34] * t[2],
        m[5] * f[0] + m[11] * f[1] + m[17] * f[2] + m[23] * t[0] + m[29] * t[1] + m[35] * t[2],
    )


@kernel
def push_body(lone, c, arm, force):
    """Let an impulse (N s) at ``arm`` (m) from its place act on the body of part c."""
    v, w = answer(lone.mobility[c], force, cross3(arm, force))
    twist = lone.twist[c]
    twist[0] += v[0]
    twist[1] += v[1]
    twist[2] += v[2]
    twist[3] += w[0]
    twist[4] += w[1]
    twist[5] += w[2]


@kernel
def velocity_of(lone, c, arm):
    """Velocity (m/s) of the point at ``arm`` (m) from the place of part c's body."""
    twist = lone.twist[c]
    return add3(load3(twist, 0), cross3(load3(twist, 3), arm))


@kernel
def _place_body(plan, work, lone, c):
    """Write the place of part c's body; it from the body's origin."""
    b = lone.body[c]
    mass, arm = plan.rigid[b, at.MASS], _ZERO
    if mass > 0.0:
        arm = rotate(load9(work.body[b], at.B_R), scale3(1.0 / mass, load3(plan.rigid[b], at.FIRST_MOMENT)))
    store3(lone.place[c], 0, add3(load3(work.body[b], at.B_P), arm))
    return arm


@kernel
def take_twists(parts, v):
    """Write the twists that velocities v (nv,) make."""
    lone = parts.lone
    for c in range(lone.body.shape[0]):
        if lone.body[c] < 0:
            continue
        first, n = parts.first[c], parts.first[c + 1] - parts.first[c]
        for k in range(6):
            total = 0.0
            for i in range(n):
                total += lone.force[6 * first + k * n + i] * v[parts.velocity[first + i]]
            lone.twist[c, k] = total


@kernel
def find_mobility(plan, work, parts, row):
    """Write how each such body follows a wrench, by the parts' inverses; ``row`` (nv,): scratch, zero between uses."""
    lone = parts.lone
    for c in range(lone.body.shape[0]):
        b = lone.body[c]
        if b < 0:
            continue
        arm = _place_body(plan, work, lone, c)
        first, n = parts.first[c], parts.first[c + 1] - parts.first[c]
        o = 6 * first
        for k in range(6):
            j = k % 3
            e = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
            unit_wrench(plan, work, b, arm, e if k < 3 else _ZERO, _ZERO if k < 3 else e, row)
            for i in range(n):
                lone.force[o + k * n + i] = row[parts.velocity[first + i]]
        forget_paths(plan, work, b, -1, row)
        for k in range(6):
            for i in range(n):
                total, square = 0.0, parts.square[c] + i * n
                for j in range(n):
                    total += parts.inverse[square + j] * lone.force[o + k * n + j]
                lone.reply[o + k * n + i] = total
        for k in range(6):
            for j in range(6):
                total = 0.0
                for i in range(n):
                    total += lone.force[o + j * n + i] * lone.reply[o + k * n + i]
                lone.mobility[c, 6 * k + j] = total


@kernel
def add_wrench(lone, c, arm, force):
    """Add an impulse at ``arm`` from its place to those on the body of part c."""
    wrench, moment = lone.wrench[c], cross3(arm, force)
    store3(wrench, 0, add3(load3(wrench, 0), force))
    store3(wrench, 3, add3(load3(wrench, 3), moment))


@kernel
def settle(parts, v):
    """Add to v (nv,) what the wrenches make."""
    lone = parts.lone
    for c in range(lone.body.shape[0]):
        if lone.body[c] < 0:
            continue
        first, n = parts.first[c], parts.first[c + 1] - parts.first[c]
        for i in range(n):
            total = 0.0
            for k in range(6):
                total += lone.reply[6 * first + k * n + i] * lone.wrench[c, k]
            v[parts.velocity[first + i]] += total
