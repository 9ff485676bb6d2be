"""A tree's iteration matrix, factored and solved in O(bodies) by the recursion of articulated bodies, linearised.

An unknown moves all bodies outboard of it alike, by three vectors (phi', phi'', alpha; ``tangent_columns``), and of
these the others feel the wrench alone that they require, which moreover turns with them.  So what is outboard of a body
answers its motion by one 6 x 9 matrix, as by its articulated inertia (Featherstone 2008, section 7.1), with bias
wrenches for the right-hand sides.  Joints are eliminated from the leaves to the root, and each factor is the pivot that
LU without pivoting would meet in that order; bodies are added one by one, for differences of composite bodies and what
is carried along lose digits with the chain's length cubed.

A force from the ground hangs on where its body is and how fast, which the three vectors do not tell: where there are
such, a motion has the body's twist and the rate of its translation as well, 18 numbers for 9 (``ground_forces``).

It serves trees of rigid bodies whose forces act on coordinates, between a body and the one that carries it, or between
a body and the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.table import act_between_frames, call_users, couple_all
from flexmbd.multibody.kernels.physics.joints import is_slide
from flexmbd.multibody.kernels.tangent import tangent_layout as tl
from flexmbd.multibody.kernels.tangent.tangent_columns import composite_change
from flexmbd.round_off import WORTHLESS_PIVOT

_LEAST_PIVOT = WORTHLESS_PIVOT  # of the terms that it is the sum of: below, its round-off is no longer small
_DENSE_GAIN = 3.0  # how much faster LAPACK does a flop than these loops do
_WRENCH, _MOST = 6, 6
_ZERO = (0.0, 0.0, 0.0)

#: Entries of a body's motion: phi', phi'' and alpha; after them, where the ground pulls at bodies, the rate r' of the
#: translation at o, then r and phi themselves.
MOTION, RATE, SHIFT, TURN, MOTION_AND_PLACE = 9, 9, 12, 15, 18


@dataclass(frozen=True, eq=False)
class TreeRecursion(ArrayStruct):
    """Factors of a tree's iteration matrix; none of the arrays has entries where the recursion does not serve.

    number: (nv,) place among the free unknowns, -1 of a prescribed one.  place: (nv,) in its joint.
    own: (nv, 6) what forces add to the entries of each joint's unknowns among themselves, then their LU factors.
    twist: (nv, 6) translation and rotation at o by each unknown.  motion: (nv, n) what it causes outboard, n being
    `MOTION` or `MOTION_AND_PLACE`.  gain: (nv, n) its answer to the motion of the body that carries the joint.
    push: (nv, 6) wrench that it makes felt there.  answer: (bodies, 6, n) wrench by that motion of a body, then of all
    outboard of its joint; bias: (bodies, 6) without motion.  moved: (bodies, n) motion of each body.
    """

    number: IntArray
    place: IntArray
    own: FloatArray
    twist: FloatArray
    motion: FloatArray
    gain: FloatArray
    push: FloatArray
    answer: FloatArray
    bias: FloatArray
    moved: FloatArray


def new_tree_recursion(plan: Plan, sizes: IntArray) -> TreeRecursion:
    """Allocate for ``plan`` where it serves and takes fewer operations than factors of full blocks of these sizes."""
    bodies = len(plan.tree)
    nv = len(plan.free) + len(plan.driven)
    dense = 2.0 / 3.0 * (sizes.astype(float) ** 3).sum()
    entries = _motion_entries(plan)
    if not (entries > 0 and _DENSE_GAIN * _operations(plan, entries) < dense):
        bodies = nv = 0
    number, place = np.full(nv, -1, np.int64), np.zeros(nv, np.int64)
    if nv > 0:
        number[plan.free] = np.arange(len(plan.free))
        for row in plan.tree:
            first, count = row[at.JOINT_V], row[at.JOINT_SIZE]
            place[first : first + count] = np.arange(count)
    zeros = np.zeros
    return TreeRecursion(
        number=number,
        place=place,
        own=zeros((nv, _MOST)),
        twist=zeros((nv, _WRENCH)),
        motion=zeros((nv, entries)),
        gain=zeros((nv, entries)),
        push=zeros((nv, _WRENCH)),
        answer=zeros((bodies, _WRENCH, entries)),
        bias=zeros((bodies, _WRENCH)),
        moved=zeros((bodies, entries)),
    )


def recursion_cost(plan: Plan) -> float:
    """What a factorisation takes where the recursion serves, in operations of LAPACK's LU."""
    return _DENSE_GAIN * _operations(plan, _motion_entries(plan))


def _operations(plan: Plan, entries: int) -> float:
    """Multiplications and additions of a factorisation."""
    d = plan.tree[:, at.JOINT_SIZE].astype(float)
    return float((6 * entries * _WRENCH * d + (2 * entries + 4 * _WRENCH) * d**2).sum())


def _motion_entries(plan: Plan) -> int:
    """How many numbers of bodies' motions matter; 0 where the recursion does not serve.

    There must be rigid bodies alone, no rows, and forces on coordinates, across single joints, or from the ground,
    without states.  Of these, users' laws may have to be differenced, along unknowns whose sizes are known.
    """
    if len(plan.rows) or len(plan.flex) or couple_all(plan).any():
        return 0
    entries = MOTION
    between = act_between_frames(plan)
    if (plan.elements[between, at.EL_V] >= 0).any():
        return 0
    for row, calls in zip(plan.elements[between], call_users(plan)[between], strict=True):
        ends = [int(plan.frame_of[row[k], at.FRAME_BODY]) for k in (at.EL_F, at.EL_G)]
        if _joints_between(plan, *ends) > 1:
            if min(ends) >= 0 or calls:
                return 0
            entries = MOTION_AND_PLACE
    return entries


def _joints_between(plan: Plan, one: int, other: int) -> int:
    """How many joints of the tree lie between two bodies, of which 2 and more are not told apart."""
    count = 0
    while one != other and count < 2:
        outer = max(one, other)  # parents come before children
        count += int(plan.tree[outer, at.JOINT_SIZE] > 0)
        inner = int(plan.tree[outer, at.PARENT])
        one, other = (inner, other) if outer == one else (one, inner)
    return count


@kernel
def felt(twist, wrench):
    """A wrench (force, torque) projected on a twist (translation, rotation)."""
    total = 0.0
    for c in range(_WRENCH):
        total += twist[c] * wrench[c]
    return total


@kernel
def times(row, motion):
    """A row of a body's answer times a motion."""
    total = 0.0
    for c in range(row.shape[0]):
        total += row[c] * motion[c]
    return total


@kernel
def put_bodies(plan, tw, recursion):
    """Each body's own wrench by its motion; ``tw.body`` must hold the moments of single bodies."""
    for i in range(plan.tree.shape[0]):
        answer = recursion.answer[i]
        for r in range(_WRENCH):
            for c in range(MOTION, answer.shape[1]):
                answer[r, c] = 0.0
        for c in range(3):
            unit = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
            _put_answer(answer, c, composite_change(tw.body[i], unit, _ZERO, _ZERO))
            _put_answer(answer, 3 + c, composite_change(tw.body[i], _ZERO, unit, _ZERO))
            _put_answer(answer, 6 + c, composite_change(tw.body[i], _ZERO, _ZERO, unit))


@kernel
def _put_answer(answer, c, wrench):
    force, torque = wrench
    for r in range(3):
        answer[r, c] = force[r]
        answer[3 + r, c] = torque[r]


@kernel
def put_joints(plan, tw, recursion, per_x):
    """Twists and motions of the columns, and how the wrench outboard turns with them; ``tw.body`` must be summed up."""
    for i in range(plan.tree.shape[0]):
        link = plan.tree[i]
        o = link[at.JOINT_V]
        force, torque = load3(tw.body[i], tl.C_FORCE), load3(tw.body[i], tl.C_TORQUE)
        for k in range(o, o + link[at.JOINT_SIZE]):
            angular = (tw.twist[0, k], tw.twist[1, k], tw.twist[2, k])
            linear = (tw.twist[3, k], tw.twist[4, k], tw.twist[5, k])
            for c in range(3):
                recursion.twist[k, c] = linear[c]
                recursion.twist[k, 3 + c] = angular[c]
            phi, r = scale3(per_x, angular), scale3(per_x, linear)
            for c in range(MOTION):
                recursion.motion[k, c] = tw.motion[c, k]
            if recursion.motion.shape[1] > MOTION:
                store3(recursion.motion[k], RATE, (tw.motion[9, k], tw.motion[10, k], tw.motion[11, k]))
                store3(recursion.motion[k], SHIFT, r)
                store3(recursion.motion[k], TURN, phi)
            store3(recursion.push[k], 0, cross3(phi, force))
            store3(recursion.push[k], 3, add3(cross3(phi, torque), cross3(r, force)))
        for r in range(link[at.JOINT_SIZE]):
            if is_slide(plan, link, r):  # its axis does not turn with the wrench
                for k in range(link[at.JOINT_SIZE]):
                    recursion.own[o + r, k] += felt(recursion.twist[o + r], recursion.push[o + k])


@entry_kernel
def factor_recursion(plan, recursion):
    """Factor what the tangent left in ``recursion``; False if a pivot is too small."""
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        first, size = plan.tree[i, at.JOINT_V], plan.tree[i, at.JOINT_SIZE]
        answer = recursion.answer[i]
        if size > 0 and recursion.number[first] >= 0:
            if not _eliminate(recursion, answer, first, size):
                return False
        parent = plan.tree[i, at.PARENT]
        if parent >= 0:
            for r in range(_WRENCH):
                for c in range(answer.shape[1]):
                    recursion.answer[parent, r, c] += answer[r, c]
    return True


@kernel
def _eliminate(recursion, answer, first, size):
    """Eliminate a joint's unknowns: ``answer`` of the body outboard becomes that to the motion inboard of the joint."""
    own, gain, push = recursion.own, recursion.gain, recursion.push
    entries = gain.shape[1]
    kept = recursion.moved[0]
    for k in range(size):
        kept[k] = abs(own[first + k, k])
        for c in range(entries):
            gain[first + k, c] = 0.0
        for r in range(_WRENCH):
            wrench = times(answer[r], recursion.motion[first + k])
            push[first + k, r] += wrench
            kept[k] += abs(recursion.twist[first + k, r] * wrench)
            for j in range(size):
                own[first + j, k] += recursion.twist[first + j, r] * wrench
            for c in range(entries):
                gain[first + k, c] += recursion.twist[first + k, r] * answer[r, c]
    if not _factor_joint(own, gain, first, size, kept):
        return False
    for k in range(first, first + size):
        for r in range(_WRENCH):
            for c in range(entries):
                answer[r, c] -= push[k, r] * gain[k, c]
    return True


@kernel
def _factor_joint(own, gain, first, size, kept):
    """LU of a joint's entries in place, and ``gain`` divided by them; False if a pivot is small against ``kept``."""
    entries = gain.shape[1]
    for k in range(first, first + size):
        if not abs(own[k, k - first]) > _LEAST_PIVOT * abs(kept[k - first]):
            return False
        for j in range(k + 1, first + size):
            share = own[j, k - first] / own[k, k - first]
            own[j, k - first] = share
            for c in range(k + 1 - first, size):
                own[j, c] -= share * own[k, c]
            for c in range(entries):
                gain[j, c] -= share * gain[k, c]
    for k in range(first + size - 1, first - 1, -1):
        for c in range(entries):
            for j in range(k + 1, first + size):
                gain[k, c] -= own[k, j - first] * gain[j, c]
            gain[k, c] /= own[k, k - first]
    return True


@entry_kernel
def solve_recursion(plan, recursion, rhs):
    """Solve with the factors; each row of the (k, free) ``rhs`` is one right-hand side, in place."""
    for q in range(rhs.shape[0]):
        recursion.bias[:] = 0.0
        for i in range(plan.tree.shape[0] - 1, -1, -1):
            _gather(plan, recursion, i, rhs[q])
        for i in range(plan.tree.shape[0]):
            _spread(plan, recursion, i, rhs[q])


@kernel
def _gather(plan, recursion, i, values):
    """A joint's unknowns without motion of what carries it, and the wrench that this makes felt there."""
    first, size = plan.tree[i, at.JOINT_V], plan.tree[i, at.JOINT_SIZE]
    bias = recursion.bias[i]
    if size > 0 and recursion.number[first] >= 0:
        begin, own = recursion.number[first], recursion.own
        for k in range(size):
            values[begin + k] -= felt(recursion.twist[first + k], bias)
        for k in range(size):
            for j in range(k):
                values[begin + k] -= own[first + k, j] * values[begin + j]
        for k in range(size - 1, -1, -1):
            for j in range(k + 1, size):
                values[begin + k] -= own[first + k, j] * values[begin + j]
            values[begin + k] /= own[first + k, k]
        for k in range(size):
            for c in range(_WRENCH):
                bias[c] += recursion.push[first + k, c] * values[begin + k]
    parent = plan.tree[i, at.PARENT]
    if parent >= 0:
        for c in range(_WRENCH):
            recursion.bias[parent, c] += bias[c]


@kernel
def _spread(plan, recursion, i, values):
    """A joint's unknowns by the motion of what carries it, and the motion of what it carries."""
    first, size, parent = plan.tree[i, at.JOINT_V], plan.tree[i, at.JOINT_SIZE], plan.tree[i, at.PARENT]
    moved = recursion.moved[i]
    entries = moved.shape[0]
    for c in range(entries):
        moved[c] = recursion.moved[parent, c] if parent >= 0 else 0.0
    if size == 0 or recursion.number[first] < 0:
        return
    begin = recursion.number[first]
    if parent >= 0:
        for k in range(size):
            values[begin + k] -= times(recursion.gain[first + k], recursion.moved[parent])
    for k in range(size):
        for c in range(entries):
            moved[c] += recursion.motion[first + k, c] * values[begin + k]
