"""Where the values of a sparse matrix of blocks stand, before and after its factorisation: made once, at compile.

Blocks that are eliminated together are a front (``elimination_tree``).  Of a front with p pivots and u others stand,
one after the other in one flat array, its upper rows (p, p + u) and its left columns (u, p): entries of the matrix,
then of its factors.  What it leaves to its others (u, u) lives on a stack until its parent takes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
from flexmbd.multibody.kernels.sparse.index_lists import distinct, entries_of, sums, within
from flexmbd.multibody.kernels.sparse.minimum_degree import elimination_order


@dataclass(frozen=True, eq=False)
class BlockPattern(ArrayStruct):
    """A symmetric pattern of b blocks with n unknowns, in f fronts.

    first: (b + 1,) block k has the unknowns first[k] to before first[k + 1].  unknown: (n,) in order of elimination.
    pivots: (f + 1,) front k eliminates the places pivots[k] to before pivots[k + 1] of that order.
    at: (f + 1,) its others are places[at[k]:at[k + 1]], ascending; above[at[k]:at[k + 1]] are they in its parent's
        list, which is its pivots, then its others.
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
    fronts = _sorted_fronts(order, parent, front, at=at, lists=lists)
    return _laid_out(sizes, fronts, starts=starts, neighbours=neighbours, operations=float(operations), fill=int(fill))


def _sorted_fronts(order: IntArray, parent: IntArray, last: IntArray, *, at: IntArray, lists: IntArray) -> _Fronts:
    """Fronts, each with its blocks one after the other, from the ``last`` block (b,) of the front of each."""
    tops = np.flatnonzero(last == np.arange(len(order)))  # in a postorder, as the blocks are
    front = np.searchsorted(tops, last)
    kept = np.lexsort((np.arange(len(order)), front))
    place = np.empty(len(order), np.int64)
    place[kept] = np.arange(len(order))
    owner = np.repeat(np.arange(len(tops)), np.diff(at)[tops])
    others = place[lists[entries_of(at, tops)]]
    return _Fronts(
        order=order[kept],
        front=front[kept],
        parent=np.where(parent[tops] < 0, -1, front[parent[tops]]),
        owner=owner,
        others=others[np.lexsort((others, owner))],
    )


def _symmetric(count: int, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Starts and neighbours of the symmetric closure, without the diagonal."""
    one, other = pairs[pairs[:, 0] != pairs[:, 1]].T
    keys = distinct(np.concatenate((one * count + other, other * count + one)), count**2)
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


@dataclass(frozen=True)
class _Fronts:
    """Fronts, of blocks in their final order.

    order: (b,) blocks; front: (b,) that of each.  parent: (f,), -1 of a root.  others: places in that order, ascending
    within their owner, a front.
    """

    order: IntArray
    front: IntArray
    parent: IntArray
    owner: IntArray
    others: IntArray


def _laid_out(
    sizes: IntArray, fronts: _Fronts, *, starts: IntArray, neighbours: IntArray, operations: float, fill: int
) -> BlockPattern:
    """The pattern, from the fronts and the matrix's own pattern."""
    front, parent, owner, others = fronts.front, fronts.parent, fronts.owner, fronts.others
    number, count = len(parent), len(sizes)
    begins = sums(sizes[fronts.order])  # of blocks, in the order of elimination
    widths = sizes[fronts.order][others]
    pivots = begins[np.searchsorted(front, np.arange(number + 1))]
    p, u = np.diff(pivots), np.bincount(owner, widths, number).astype(np.int64)
    at, values_at = sums(u), sums(p * (p + 2 * u))
    # where an other stands in its front's list: after the pivots
    listed = sums(widths)[:-1] - at[owner] + p[owner]
    keys = owner * count + others

    def in_list(one: IntArray, home: IntArray) -> IntArray:
        found = begins[one] - pivots[home]
        passed = front[one] != home
        found[passed] = listed[np.searchsorted(keys, home[passed] * count + one[passed])]
        return found

    above = np.zeros(len(others), np.int64)
    has = parent[owner] >= 0
    above[has] = in_list(others[has], parent[owner[has]])
    children = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0) :]
    stack_at, stack = _stacked(parent, u)
    # blocks of the matrix, each row's columns ascending
    place = np.empty(count, np.int64)
    place[fronts.order] = np.arange(count)
    rows = np.concatenate((np.repeat(np.arange(count), np.diff(starts)), np.arange(count)))
    columns = np.concatenate((neighbours, np.arange(count)))
    ascending = np.lexsort((columns, rows))
    rows, columns = rows[ascending], columns[ascending]
    home = front[np.minimum(place[rows], place[columns])]
    row, column = in_list(place[rows], home), in_list(place[columns], home)
    width, upper = (p + u)[home], row < p[home]
    below = p[home] * width + (row - p[home]) * p[home] + column
    first = sums(sizes)
    return BlockPattern(
        first=first,
        unknown=entries_of(first, fronts.order),
        pivots=pivots,
        at=at,
        places=entries_of(begins, others),
        above=np.repeat(above, widths) + within(widths),
        values_at=values_at,
        stack_at=stack_at,
        children_at=np.searchsorted(parent[children], np.arange(number + 1)).astype(np.int64),
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


def _stacked(parent: IntArray, others: IntArray) -> tuple[IntArray, int]:
    """Where what each front leaves stands, and how many entries that takes.

    Two stacks: of fronts at even depths, and of those at odd ones, so that a front takes from one what its children
    left and leaves on the other; the second begins where the first ends at its highest.
    """
    parents: Any = parent.tolist()
    sizes: Any = (others**2).tolist()
    side = [0] * len(parents)  # of the depth, whether it is odd
    for k in range(len(parents) - 1, -1, -1):
        if parents[k] >= 0:
            side[k] = 1 - side[parents[k]]
    tops, highest, at, left = [0, 0], [0, 0], [0] * len(parents), [0] * len(parents)  # left: by the children of each
    for k, above in enumerate(parents):
        own = side[k]
        at[k] = tops[own]
        tops[own] += sizes[k]
        highest[own] = max(highest[own], tops[own])
        tops[1 - own] -= left[k]
        if above >= 0:
            left[above] += sizes[k]
    return np.array(at, np.int64) + highest[0] * np.array(side, np.int64), highest[0] + highest[1]
