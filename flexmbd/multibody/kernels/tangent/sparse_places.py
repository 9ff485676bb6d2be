"""Where the entries of a sparse matrix stand that the tangent writes: found once, at compile, and read by its kernels.

Of a pair of blocks there are a base and a stride: the entry of velocities r and k stands at base + stride * r + k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.sparse.index_lists import sums
from flexmbd.multibody.kernels.tangent.tangent_layout import edge_columns
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks

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
    """Those of a matrix whose ``pairs`` (p, 2) of blocks begin at an offset (p,) of its values, rows a stride apart.

    The pairs ascend.
    """
    b, first = len(blocks.first), blocks.first
    base = offset - stride * first[pairs[:, 0]] - first[pairs[:, 1]]
    keys, places = pairs[:, 0] * b + pairs[:, 1], np.stack([base, stride], axis=1)
    edge_of = np.append(edge_columns(plan)[0], -1)  # of no frame

    def table(i: IntArray, j: IntArray) -> IntArray:
        return places[np.searchsorted(keys, i * b + j)]

    def of_groups(groups: IntArray) -> IntArray:
        outer, size, frame, inner, count, inner_frame = groups.T
        i, j = blocks.of[outer], blocks.of[inner]
        ends = np.stack([outer, outer + size, inner, count, edge_of[np.maximum(frame, inner_frame)]], axis=1)
        return np.concatenate([ends, table(i, j), table(j, i)], axis=1)

    elements, closures = blocks.elements, blocks.closures
    counts = np.concatenate([elements.counts, closures.counts])
    rows, with_rows = blocks.row_blocks[closures.owner], closures.items
    return SparsePlaces(
        block=blocks.of,
        diagonal=table(np.arange(b), np.arange(b)),
        pairs=of_groups(blocks.body_pairs),
        carried=of_groups(blocks.carried),
        carrying=of_groups(blocks.carrying),
        nested=of_groups(blocks.nested),
        element_first=sums(counts),
        element_blocks=np.concatenate([elements.items, closures.items]),
        base_first=sums(counts**2),
        bases=np.concatenate([table(*elements.squares()), table(*closures.squares())]),
        row_first=np.array([first for first, _ in blocks.row_groups] + [len(plan.rows)], np.int64),
        row_bases=np.concatenate([table(rows, with_rows), table(with_rows, rows)], axis=1),
        starts=np.array([blocks.rows_begin, blocks.cut(0), blocks.unknowns], np.int64),
        number=np.where(blocks.of >= 0, np.cumsum(blocks.of >= 0) - 1, -1),
        local=np.zeros(b, np.int64),
    )
