"""Where the entries of a sparse matrix stand that the tangent writes: found once, at compile, and read by its kernels.

Of a pair of blocks there are a base and a stride: the entry of velocities r and k stands at base + stride * r + k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.tangent.tangent_layout import edge_columns
from flexmbd.multibody.kernels.tangent.unknown_blocks import CUT, UnknownBlocks, UnknownGroup

# Columns of SparsePlaces.pairs: the unknowns outboard, first and one past the last; those that carry them, first and
# how many; the edge column of the frame that these move if they are modes, else -1; base and stride of the pair of
# blocks, and of that transposed.  Likewise of ``carried`` and ``carrying``, whose second unknowns are those of a cut
# body, and of ``nested``, where both are.
P_START, P_STOP, P_FIRST, P_COUNT, P_EDGE, P_OUTER, P_OUTER_STRIDE, P_INNER, P_INNER_STRIDE, N_PAIR = range(10)


@dataclass(frozen=True, eq=False)
class SparsePlaces(ArrayStruct):
    """Places of blocks in the values of a matrix.

    block: (unknowns,) of each, -1 of prescribed velocities.  diagonal: (b, 2) base and stride of a block's own entries.
    pairs, carried, carrying, nested: (p, N_PAIR) of groups of unknowns and those that carry them; of groups and the cut
    body that carries them, and of groups and one that they carry; of cut bodies and the next ones inwards.
    element_first: (ne + groups of rows + 1,) where the blocks of a force element, then of a group of rows, begin in
    ``element_blocks``; base_first: likewise, in ``bases`` (k, 2), base and stride of all pairs of them, row by row.
    row_first: (groups + 1,) of rows; row_bases: (k, 4) in the order of ``element_blocks``, from that of the first group
    on: base and stride of the rows' block with each of these, and of that transposed.
    starts: (3,) first unknowns of rows and of cut bodies, and how many unknowns there are.  number: (unknowns,) places
    in right-hand sides, which have no prescribed velocities; -1 of these.  local: (b,) scratch.
    """

    block: IntArray
    diagonal: IntArray
    pairs: IntArray
    carried: IntArray
    carrying: IntArray
    nested: IntArray
    element_first: IntArray
    element_blocks: IntArray
    base_first: IntArray
    bases: IntArray
    row_first: IntArray
    row_bases: IntArray
    starts: IntArray
    number: IntArray
    local: IntArray


def no_sparse_places() -> SparsePlaces:
    """That of a matrix that is dense."""
    none, two, pairs = np.zeros(0, np.int64), np.zeros((0, 2), np.int64), np.zeros((0, N_PAIR), np.int64)
    return SparsePlaces(
        none, two, pairs, pairs, pairs, pairs, none, none, none, two, none, np.zeros((0, 4), np.int64), none, none, none
    )


def new_sparse_places(
    plan: Plan, blocks: UnknownBlocks, pairs: IntArray, offset: IntArray, stride: IntArray
) -> SparsePlaces:
    """Those of a matrix whose ``pairs`` (p, 2) of blocks begin at an offset (p,) of its values, rows a stride apart."""
    b, first = len(blocks.first), blocks.first
    base = offset - stride * first[pairs[:, 0]] - first[pairs[:, 1]]
    keys: Any = (pairs[:, 0] * b + pairs[:, 1]).tolist()
    places: Any = np.stack([base, stride], axis=1).tolist()
    table: dict[int, list[int]] = dict(zip(keys, places, strict=True))
    edge_of, _ = edge_columns(plan)

    def pair(outer: UnknownGroup, inner: UnknownGroup) -> list[int]:
        i, j = int(blocks.of[outer.first]), int(blocks.of[inner.first])
        frame = max(outer.frame, inner.frame)
        edge = int(edge_of[frame]) if frame >= 0 else -1
        ends = [outer.first, outer.first + outer.size, inner.first, inner.size]
        return [*ends, edge, *table[i * b + j], *table[j * b + i]]

    def cut(number: int) -> UnknownGroup:
        return UnknownGroup(blocks.cut(number), CUT, -1)

    roots = [(q, blocks.inward[body].root) for q, body in enumerate(blocks.cuts)]
    joined = [*blocks.elements, *blocks.closures]
    own = [int(blocks.of[blocks.rows_begin + first]) for first, _ in blocks.row_groups]
    with_rows = [(r, k) for r, with_r in zip(own, blocks.closures, strict=True) for k in with_r]
    counts = np.array([len(one) for one in joined], np.int64)
    return SparsePlaces(
        block=blocks.of,
        diagonal=_table([table[k * b + k] for k in range(b)], 2),
        pairs=_table([pair(*one) for one in blocks.body_pairs()], N_PAIR),
        carried=_table([pair(one, cut(q)) for one, q in blocks.carried()], N_PAIR),
        carrying=_table([pair(one, cut(q)) for one, q in blocks.carrying()], N_PAIR),
        nested=_table([pair(cut(q), cut(root)) for q, root in roots if root >= 0], N_PAIR),
        element_first=_sums(counts),
        element_blocks=np.array([k for one in joined for k in one], np.int64),
        base_first=_sums(counts**2),
        bases=_table([table[i * b + j] for one in joined for i in one for j in one], 2),
        row_first=np.array([first for first, _ in blocks.row_groups] + [len(plan.rows)], np.int64),
        row_bases=_table([[*table[r * b + k], *table[k * b + r]] for r, k in with_rows], 4),
        starts=np.array([blocks.rows_begin, blocks.cut(0), blocks.unknowns], np.int64),
        number=np.where(blocks.of >= 0, np.cumsum(blocks.of >= 0) - 1, -1),
        local=np.zeros(b, np.int64),
    )


def _table(rows: Sequence[Sequence[int]], columns: int) -> IntArray:
    return np.array(rows, np.int64).reshape(-1, columns)


def _sums(counts: IntArray) -> IntArray:
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
