"""Where the values of a sparse matrix of blocks stand, before and after its factorisation: made once, at compile.

Blocks that are eliminated together are a front (``elimination_tree``).  Of a front with p pivots and u others stand, one
after the other in one flat array, its upper rows (p, p + u) and its left columns (u, p): entries of the matrix, then of
its factors.  What it leaves to its others (u, u) lives on a stack until its parent takes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray
from flexmbd.multibody.kernels.sparse.elimination_tree import (
    find_tree,
    in_order,
    list_columns,
    merge_fronts,
    put_children_first,
)
from flexmbd.multibody.kernels.sparse.minimum_degree import elimination_order


@dataclass(frozen=True, eq=False)
class BlockPattern(ArrayStruct):
    """A symmetric pattern of b blocks with n unknowns, in f fronts.

    first: (b + 1,) block k has the unknowns first[k] to before first[k + 1].  unknown: (n,) in order of elimination.
    pivots: (f + 1,) front k eliminates the places pivots[k] to before pivots[k + 1] of that order.
    at: (f + 1,) its others are places[at[k]:at[k + 1]], ascending; above[at[k]:at[k + 1]] are they in its parent's list,
        which is its pivots, then its others.
    values_at: (f + 1,) where its values begin.  stack_at: (f,) where what it leaves stands.
    children_at: (f + 1,), children: fronts whose parent it is.
    entry_at: (b + 1,), column, offset, stride: block i couples column[entry_at[i]:entry_at[i + 1]], ascending, itself
        among them; entry (r, c) of that block is values[offset + r * stride + c].
    stack: entries of the stack.  widest: most others of a front.  fill: values.  operations: multiplications and
        additions of a factorisation.
    """

    first: IntArray
    unknown: IntArray
    pivots: IntArray
    at: IntArray
    places: IntArray
    above: IntArray
    values_at: IntArray
    stack_at: IntArray
    children_at: IntArray
    children: IntArray
    entry_at: IntArray
    column: IntArray
    offset: IntArray
    stride: IntArray
    stack: int
    widest: int
    fill: int
    operations: float

    @property
    def unknowns(self) -> int:
        """Order of the matrix."""
        return len(self.unknown)

    def entries(self, rows: ArrayLike, columns: ArrayLike) -> tuple[IntArray, IntArray]:
        """Return offset and stride of blocks (k,): entry (r, c) of one is ``values[offset + r * stride + c]``.

        Raises:
            KeyError: the pattern has no such block.
        """
        rows, columns = np.asarray(rows, np.int64), np.asarray(columns, np.int64)
        count = len(self.first) - 1
        keys = np.repeat(np.arange(count), np.diff(self.entry_at)) * count + self.column
        wanted = rows * count + columns
        found = np.searchsorted(keys, wanted)
        if (found >= len(keys)).any() or (keys[found] != wanted).any():
            raise KeyError("the pattern has no such block")
        return self.offset[found], self.stride[found]


def new_block_pattern(
    sizes: ArrayLike, pairs: ArrayLike, *, ranks: ArrayLike | None = None, order: ArrayLike | None = None
) -> BlockPattern:
    """Make the pattern of a matrix of blocks and of its factors.

    Args:
        sizes: (b,) unknowns of each block, in the matrix's numbering.
        pairs: (p, 2) blocks that are coupled, each pair in any order and any number of times.
        ranks: (b,) a block with zeros on its diagonal has a higher rank than those that give it pivots, and waits for
            neighbours of lower rank: all of them, or as many unknowns as it has itself.
        order: (b,) blocks in the order of elimination, in place of minimum degree's.
    """
    sizes = np.array(sizes, np.int64)
    count = len(sizes)
    starts, neighbours = _symmetric(count, np.asarray(pairs, np.int64).reshape(-1, 2))
    if order is None:
        rank = np.zeros(count, np.int64) if ranks is None else np.array(ranks, np.int64)
        order = elimination_order(sizes, starts, neighbours, rank)
    order = np.array(order, np.int64)
    parent, child, sibling, after = np.empty((4, count), np.int64)
    find_tree(*in_order(order, starts, neighbours), parent, child)
    put_children_first(parent, child, sibling, after)
    order = order[after]
    renumbered = np.empty(count, np.int64)
    renumbered[after] = np.arange(count)
    parent = np.where(parent[after] < 0, -1, renumbered[parent[after]])
    at_order = in_order(order, starts, neighbours)
    at, lists, others = _columns(*at_order, parent, sizes[order])
    front, pivots = np.empty(count, np.int64), np.empty(count)
    operations, fill = merge_fronts(parent, sizes[order], others, front, pivots)
    tops = np.flatnonzero(front == np.arange(count))
    number = np.empty(count, np.int64)
    number[tops] = np.arange(len(tops))
    front = number[front]  # of a block in the order, among fronts
    kept = np.lexsort((np.arange(count), front))
    place = np.empty(count, np.int64)
    place[kept] = np.arange(count)
    above = np.where(parent[tops] < 0, -1, front[parent[tops]])
    inside = _taken(at, tops)
    owner = np.repeat(np.arange(len(tops)), np.diff(at)[tops])
    others_of = place[lists[inside]]
    sorted_others = np.lexsort((others_of, owner))
    block_order = order[kept]
    return _laid_out(
        sizes,
        block_order,
        front[kept],
        above,
        owner,
        others_of[sorted_others],
        starts,
        neighbours,
        operations=float(operations),
        fill=int(fill),
    )


def _symmetric(count: int, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Starts and neighbours of the symmetric closure, without the diagonal."""
    one, other = pairs[pairs[:, 0] != pairs[:, 1]].T
    keys = np.unique(np.concatenate((one * count + other, other * count + one)))
    starts = np.searchsorted(keys, np.arange(count + 1) * count).astype(np.int64)
    return starts, keys % max(count, 1)


def _columns(
    starts: IntArray, neighbours: IntArray, parent: IntArray, sizes: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    count = len(sizes)
    at, others, mark = np.zeros(count + 1, np.int64), np.zeros(count, np.int64), np.empty(3 * count, np.int64)
    capacity = 4 * len(neighbours) + 64
    while True:
        lists = np.empty(capacity, np.int64)
        if list_columns(starts, neighbours, parent, sizes, mark, at, lists, others):
            return at, lists[: at[-1]], others
        capacity *= 2


def _taken(at: IntArray, which: IntArray) -> IntArray:
    """Indices of the entries of some lists, one list after the other."""
    counts = np.diff(at)[which]
    ends = np.cumsum(counts)
    return np.repeat(at[which] - ends + counts, counts) + np.arange(int(counts.sum()))


def _laid_out(
    sizes: IntArray,
    order: IntArray,
    front: IntArray,
    parent: IntArray,
    owner: IntArray,
    others: IntArray,
    starts: IntArray,
    neighbours: IntArray,
    *,
    operations: float,
    fill: int,
) -> BlockPattern:
    """The pattern, from blocks in their final ``order`` with the ``front`` of each, and the ``others`` of fronts.

    ``others`` are places in that order, ascending within their ``owner``, a front.
    """
    fronts, count = len(parent), len(sizes)
    first = _sums(sizes)
    begins = _sums(sizes[order])  # of blocks, in the order of elimination
    pivots = begins[np.searchsorted(front, np.arange(fronts + 1))]
    p, u = np.diff(pivots), np.bincount(owner, sizes[order][others], fronts).astype(np.int64)
    at, values_at = _sums(u), _sums(p * (p + 2 * u))
    # where an unknown stands in a front's list: its pivots, then its others
    listed = _sums(sizes[order][others])[:-1] - at[owner] + p[owner]
    keys = owner * count + others
    has = parent[owner] >= 0
    is_pivot = has & (front[others] == parent[owner])
    local = np.zeros(len(others), np.int64)
    local[is_pivot] = begins[others[is_pivot]] - pivots[parent[owner[is_pivot]]]
    passed = has & ~is_pivot
    local[passed] = listed[np.searchsorted(keys, parent[owner[passed]] * count + others[passed])]
    children = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0) :]
    children_at = np.searchsorted(parent[children], np.arange(fronts + 1)).astype(np.int64)
    stack_at, stack = _stacked(parent, u)
    # blocks of the matrix, each row's columns ascending
    place = np.empty(count, np.int64)
    place[order] = np.arange(count)
    rows = np.concatenate((np.repeat(np.arange(count), np.diff(starts)), np.arange(count)))
    columns = np.concatenate((neighbours, np.arange(count)))
    sorted_entries = np.lexsort((columns, rows))
    rows, columns = rows[sorted_entries], columns[sorted_entries]
    i, j = place[rows], place[columns]
    home = front[np.minimum(i, j)]

    def in_list(one: IntArray) -> IntArray:
        inside = front[one] == home
        found = begins[one] - pivots[home]
        found[~inside] = listed[np.searchsorted(keys, home[~inside] * count + one[~inside])]
        return found

    row, column = in_list(i), in_list(j)
    width, upper = (p + u)[home], row < p[home]
    below = p[home] * width + (row - p[home]) * p[home] + column
    return BlockPattern(
        first=first,
        unknown=_taken(first, order),
        pivots=pivots,
        at=at,
        places=_taken(begins, others),
        above=np.repeat(local, sizes[order][others]) + _within(sizes[order][others]),
        values_at=values_at,
        stack_at=stack_at,
        children_at=children_at,
        children=children,
        entry_at=np.searchsorted(rows, np.arange(count + 1)).astype(np.int64),
        column=columns,
        offset=values_at[home] + np.where(upper, row * width + column, below),
        stride=np.where(upper, width, p[home]),
        stack=stack,
        widest=int(u.max(initial=0)),
        fill=fill,
        operations=operations,
    )


def _sums(counts: IntArray) -> IntArray:
    return np.concatenate((np.zeros(1, np.int64), np.cumsum(counts)))


def _within(counts: IntArray) -> IntArray:
    """0, 1, ... up to each count, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)


def _stacked(parent: IntArray, others: IntArray) -> tuple[IntArray, int]:
    """Where what each front leaves stands, and how many entries that takes.

    Two stacks: of fronts at even depths, and of those at odd ones, so that a front takes from one what its children left
    and leaves on the other; the second begins where the first ends at its highest.
    """
    depth = np.zeros(len(parent), np.int64)
    for k in range(len(parent) - 1, -1, -1):
        if parent[k] >= 0:
            depth[k] = depth[parent[k]] + 1
    tops, highest, at = [0, 0], [0, 0], np.zeros(len(parent), np.int64)
    left = np.zeros(len(parent), np.int64)  # by the children of each
    for k, above in enumerate(parent):
        side, size = depth[k] % 2, int(others[k]) ** 2
        at[k] = tops[side]
        tops[side] += size
        highest[side] = max(highest[side], tops[side])
        tops[1 - side] -= int(left[k])
        if above >= 0:
            left[above] += size
    return at + np.where(depth % 2 == 1, highest[0], 0), highest[0] + highest[1]
