"""Where the entries of a sparse matrix stand that the tangent writes: found once, at compile, and read by its kernels.

Of a pair of blocks there are a base and a stride: the entry of velocities r and k stands at base + stride * r + k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.tangent.tangent_layout import edge_columns
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks

# Columns of SparsePlaces.pairs: the unknowns outboard, first and one past the last; those that carry them, first and
# how many; the edge column of the frame that these move if they are modes, else -1; base and stride of the pair of
# blocks, and of that transposed.
P_START, P_STOP, P_FIRST, P_COUNT, P_EDGE, P_OUTER, P_OUTER_STRIDE, P_INNER, P_INNER_STRIDE, N_PAIR = range(10)


@dataclass(frozen=True, eq=False)
class SparsePlaces(ArrayStruct):
    """Places of blocks in the values of a matrix.

    block: (nv,) of each velocity, -1 of prescribed ones.  diagonal: (b, 2) base and stride of each block's own entries.
    pairs: (p, N_PAIR) of groups of unknowns and those that carry them.
    element_first: (ne + 1,) where the blocks of a force element begin in ``element_blocks``; base_first: (ne + 1,) and
    bases and strides of all pairs of them, row by row, in ``bases`` (k, 2).  local: (b,) scratch.
    """

    block: IntArray
    diagonal: IntArray
    pairs: IntArray
    element_first: IntArray
    element_blocks: IntArray
    base_first: IntArray
    bases: IntArray
    local: IntArray


def no_sparse_places() -> SparsePlaces:
    """That of a matrix that is dense."""
    none, two = np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
    return SparsePlaces(none, two, np.zeros((0, N_PAIR), np.int64), none, none, none, two, none)


def new_sparse_places(
    plan: Plan, blocks: UnknownBlocks, pairs: IntArray, offset: IntArray, stride: IntArray
) -> SparsePlaces:
    """Those of a matrix whose ``pairs`` (p, 2) of blocks begin at an offset (p,) of its values, rows a stride apart."""
    b, first = len(blocks.first), blocks.first
    base = offset - stride * first[pairs[:, 0]] - first[pairs[:, 1]]
    keys, places = (pairs[:, 0] * b + pairs[:, 1]).tolist(), zip(base.tolist(), stride.tolist(), strict=True)
    table = dict(zip(keys, places, strict=True))
    edge_of, _ = edge_columns(plan)
    carried = []
    for outer, inner in blocks.body_pairs():
        i, j = int(blocks.of[outer.first]), int(blocks.of[inner.first])
        if i >= 0 and j >= 0:
            edge = int(edge_of[inner.frame]) if inner.frame >= 0 else -1
            ends = [outer.first, outer.first + outer.count, inner.first, inner.count]
            carried.append([*ends, edge, *table[i * b + j], *table[j * b + i]])
    joined = blocks.elements
    counts = np.array([len(one) for one in joined], np.int64)

    def ends_of(sizes: IntArray) -> IntArray:
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(sizes)])

    return SparsePlaces(
        block=blocks.of,
        diagonal=np.array([table[k * b + k] for k in range(b)], np.int64).reshape(-1, 2),
        pairs=np.array(carried, np.int64).reshape(-1, N_PAIR),
        element_first=ends_of(counts),
        element_blocks=np.array([k for one in joined for k in one], np.int64),
        base_first=ends_of(counts**2),
        bases=np.array([table[i * b + j] for one in joined for i in one for j in one], np.int64).reshape(-1, 2),
        local=np.zeros(b, np.int64),
    )
