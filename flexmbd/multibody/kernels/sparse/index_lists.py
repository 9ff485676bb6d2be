"""Lists of indices, one after the other in one array."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from flexmbd.multibody.kernels.base.arrays import IntArray


class IndexLists(NamedTuple):
    """n lists: list k is ``items[starts[k]:starts[k + 1]]``; starts: (n + 1,)."""

    starts: IntArray
    items: IntArray

    @property
    def counts(self) -> IntArray:
        """(n,) how many items each has."""
        return np.diff(self.starts)

    @property
    def owner(self) -> IntArray:
        """Of each item the number of its list."""
        return np.repeat(np.arange(len(self.starts) - 1), self.counts)

    def taken(self, which: IntArray) -> IndexLists:
        """Some of the lists, in this order."""
        return IndexLists(sums(self.counts[which]), self.items[entries_of(self.starts, which)])

    def paired(self) -> IndexLists:
        """Lists 2 k and 2 k + 1 as one."""
        return IndexLists(self.starts[::2], self.items)

    def once(self) -> IndexLists:
        """Each item of a list once, where it came first; negative ones are left out."""
        owner, most = self.owner, int(self.items.max(initial=0)) + 1
        kept = np.flatnonzero(self.items >= 0)
        _, first = np.unique(owner[kept] * most + self.items[kept], return_index=True)
        kept = kept[np.sort(first)]
        return owned(owner[kept], self.items[kept], len(self.starts) - 1)

    def squares(self) -> tuple[IntArray, IntArray]:
        """Of each list all pairs of its items, row by row: the first and the second of them."""
        counts, owner = self.counts, self.owner
        each = counts[owner]  # of each item how many pairs it begins
        return np.repeat(self.items, each), self.items[entries_of(self.starts, owner)]


def new_lists(lists: Sequence[Sequence[int]]) -> IndexLists:
    """The same as one array."""
    return IndexLists(sums(np.array([len(one) for one in lists], np.int64)), flat(lists))


def owned(owner: IntArray, items: IntArray, count: int) -> IndexLists:
    """``count`` lists of items, in the order in which they come, by the numbers of their lists."""
    kept = np.argsort(owner, kind="stable")
    return IndexLists(sums(np.bincount(owner, minlength=count)), items[kept])


def entries_of(starts: IntArray, which: IntArray) -> IntArray:
    """Where the items of some lists stand, one list after the other."""
    counts = np.diff(starts)[which]
    return np.repeat(starts[which], counts) + within(counts)


def distinct(keys: IntArray, most: int) -> IntArray:
    """The different ones of 0 .. most - 1 among keys, ascending."""
    if len(keys) < most // 16:
        return np.unique(keys)
    found = np.zeros(most, np.bool_)  # in less time than it takes to sort so many
    found[keys] = True
    return np.flatnonzero(found)


def flat(lists: Iterable[Iterable[int]]) -> IntArray:
    """All entries, one after the other."""
    return np.fromiter(chain.from_iterable(lists), np.int64)


def sums(counts: IntArray) -> IntArray:
    """0, then the sums up to each count."""
    return np.concatenate((np.zeros(1, np.int64), np.cumsum(counts)))


def within(counts: IntArray) -> IntArray:
    """0, 1, ... up to each count, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
