"""A tree's tangent by positions, velocities and accelerations apart: iteration matrices of any step from one tangent.

M + s D + s^2 K keeps the form that ``tree_recursion`` factors, for bodies answer the motion of their frames alike, and
the motion that an unknown causes, the wrench that it makes felt inboard and what forces add are sums of three parts.
The shift s may be complex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.tangent.tree_recursion import TreeRecursion, felt, times

#: The parts: derivatives by positions, by velocities, by accelerations.
STIFFNESS, DAMPING, MASS, N_PARTS = range(4)

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ComplexRecursion(ArrayStruct):
    """A ``TreeRecursion`` of a complex matrix; ``number``, ``place`` and ``twist`` are the real one's."""

    number: IntArray
    place: IntArray
    own: ComplexArray
    twist: FloatArray
    motion: ComplexArray
    gain: ComplexArray
    push: ComplexArray
    answer: ComplexArray
    bias: ComplexArray
    moved: ComplexArray


@dataclass(frozen=True, eq=False)
class RecursionParts(ArrayStruct):
    """Of a ``TreeRecursion`` the parts of ``own``, ``motion`` and ``push`` (3, nv, ...), and ``answer`` unfactored."""

    own: FloatArray
    motion: FloatArray
    push: FloatArray
    answer: FloatArray


def new_complex_recursion(like: TreeRecursion) -> ComplexRecursion:
    """Allocate factors of a complex matrix of the tree of ``like``."""

    def zeros(array: FloatArray) -> ComplexArray:
        return np.zeros(array.shape, np.complex128)

    return ComplexRecursion(
        number=like.number,
        place=like.place,
        own=zeros(like.own),
        twist=like.twist,
        motion=zeros(like.motion),
        gain=zeros(like.gain),
        push=zeros(like.push),
        answer=zeros(like.answer),
        bias=zeros(like.bias),
        moved=zeros(like.moved),
    )


def new_recursion_parts(like: TreeRecursion) -> RecursionParts:
    """Allocate for the tree of ``like``."""
    own, motion, push = (np.zeros((N_PARTS, *one.shape)) for one in (like.own, like.motion, like.push))
    return RecursionParts(own=own, motion=motion, push=push, answer=np.zeros_like(like.answer))


@entry_kernel
def keep_part(recursion, parts, part):
    """Keep what the tangent with the weight of one part alone left in ``recursion``; whether all is finite."""
    total = 0.0
    for k in range(recursion.own.shape[0]):
        for c in range(recursion.own.shape[1]):
            parts.own[part, k, c] = recursion.own[k, c]
            total += recursion.own[k, c]
        for c in range(recursion.push.shape[1]):
            parts.push[part, k, c] = recursion.push[k, c]
            total += recursion.push[k, c]
        for c in range(recursion.motion.shape[1]):
            parts.motion[part, k, c] = recursion.motion[k, c]
            total += recursion.motion[k, c]
    _copy(recursion.answer, parts.answer)
    return np.isfinite(total)


@entry_kernel
def set_shift(parts, shift, recursion):
    """Set M + ``shift`` D + ``shift``^2 K up in ``recursion``, for ``factor_recursion``."""
    for k in range(recursion.own.shape[0]):
        _sum_parts(parts.own, k, shift, recursion.own[k])
        _sum_parts(parts.motion, k, shift, recursion.motion[k])
        _sum_parts(parts.push, k, shift, recursion.push[k])
    _copy(parts.answer, recursion.answer)


@kernel
def _copy(answer, out):
    for i in range(answer.shape[0]):
        for r in range(answer.shape[1]):
            for c in range(answer.shape[2]):
                out[i, r, c] = answer[i, r, c]


@kernel
def _sum_parts(parts, k, shift, out):
    for c in range(out.shape[0]):
        out[c] = parts[MASS, k, c] + shift * (parts[DAMPING, k, c] + shift * parts[STIFFNESS, k, c])


@entry_kernel
def add_product(plan, parts, part, recursion, weight, vector, out):
    """Add ``weight`` times one part of the tangent times ``vector`` (free,) to ``out`` (free,).

    ``recursion`` lends its numbers and twists, and ``bias`` and ``moved`` as scratch.
    """
    _move_bodies(plan, parts, part, recursion, vector)
    own, push = parts.own[part], parts.push[part]
    bias, number, twist = recursion.bias, recursion.number, recursion.twist
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        first, size, parent = plan.tree[i, at.JOINT_V], plan.tree[i, at.JOINT_SIZE], plan.tree[i, at.PARENT]
        if size > 0 and number[first] >= 0:
            begin = number[first]
            for j in range(size):
                total = felt(twist[first + j], bias[i])
                for k in range(size):
                    total += own[first + j, k] * vector[begin + k]
                out[begin + j] += weight * total
            for k in range(size):
                for r in range(bias.shape[1]):
                    bias[i, r] += push[first + k, r] * vector[begin + k]
        if parent >= 0:
            for r in range(bias.shape[1]):
                bias[parent, r] += bias[i, r]


@kernel
def _move_bodies(plan, parts, part, recursion, vector):
    """The motion of each body by ``vector``, and the wrench by which it answers."""
    bias, moved, number = recursion.bias, recursion.moved, recursion.number
    for i in range(plan.tree.shape[0]):
        first, size, parent = plan.tree[i, at.JOINT_V], plan.tree[i, at.JOINT_SIZE], plan.tree[i, at.PARENT]
        for c in range(moved.shape[1]):
            moved[i, c] = moved[parent, c] if parent >= 0 else 0.0
            for k in range(first, first + size):
                if number[k] >= 0:
                    moved[i, c] += parts.motion[part, k, c] * vector[number[k]]
        for r in range(bias.shape[1]):
            bias[i, r] = times(parts.answer[i, r], moved[i])
