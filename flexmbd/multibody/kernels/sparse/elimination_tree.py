"""What the elimination of blocks in an order fills, and which blocks are eliminated together, as one *front*.

A front has pivots, the unknowns that it eliminates, and others, those that these couple.  Fronts form a forest: what a
front leaves to its others is added up in the front of the first of these, its parent (Duff and Reid, "The multifrontal
solution of indefinite sparse symmetric linear equations", ACM TOMS 9, 1983; Liu, SIAM Review 34, 1992).
"""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base.arrays import IntArray
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

_MOST_PIVOTS = 96.0  # of a front that is not one block: beyond, what is merged gains nothing


@entry_kernel
def find_tree(starts, neighbours, parent, ancestor):
    """Write each block's parent in the elimination tree, -1 of a root; blocks stand in their order."""
    for k in range(parent.shape[0]):
        parent[k] = -1
        ancestor[k] = -1
        for q in range(starts[k], starts[k + 1]):
            i = neighbours[q]
            while i >= 0 and i < k:
                above = ancestor[i]
                ancestor[i] = k
                if above < 0:
                    parent[i] = k
                i = above if above != k else -1


@entry_kernel
def put_children_first(parent, child, sibling, order):
    """Write a postorder of the tree: (b,) blocks, the descendants of each just before it."""
    for i in range(parent.shape[0]):
        child[i] = -1
    top = -1
    for i in range(parent.shape[0] - 1, -1, -1):
        if parent[i] >= 0:
            sibling[i] = child[parent[i]]
            child[parent[i]] = i
        else:
            sibling[i] = top
            top = i
    done, i = 0, top
    while i >= 0:
        while child[i] >= 0:
            i = child[i]
        while True:
            order[done] = i
            done += 1
            if sibling[i] >= 0:
                i = sibling[i]
                break
            i = parent[i]
            if i < 0:
                break
            # all children of it are done: so is it, next


@entry_kernel
def list_columns(starts, neighbours, parent, sizes, mark, at, lists, others):
    """List in ``lists[at[k]:at[k + 1]]`` the later blocks that block k couples once those before have gone.

    ``others`` gets their unknowns.  False if ``lists`` is too short.
    """
    count = parent.shape[0]
    first = mark[count:]  # children's heads, then each child's next sibling
    for k in range(3 * count):
        mark[k] = -1
    end = 0
    for k in range(count):
        at[k] = end
        total = 0
        mark[k] = k
        for q in range(starts[k], starts[k + 1]):
            i = neighbours[q]
            if i > k and mark[i] != k:
                if end == lists.shape[0]:
                    return False
                mark[i] = k
                lists[end] = i
                end += 1
                total += sizes[i]
        c = first[k]
        while c >= 0:
            for q in range(at[c], at[c + 1]):
                i = lists[q]
                if mark[i] != k:
                    if end == lists.shape[0]:
                        return False
                    mark[i] = k
                    lists[end] = i
                    end += 1
                    total += sizes[i]
            c = first[count + c]
        others[k] = total
        at[k + 1] = end
        if parent[k] >= 0:
            first[count + k] = first[parent[k]]
            first[parent[k]] = k
    return True


@kernel
def _operations(pivots, others):
    return pivots * (2.0 / 3.0 * pivots * pivots + 2.0 * others * (pivots + others))


@kernel
def _work(pivots, others):
    """What a front takes, in operations: its own, moving what it leaves to its parent, and its beginning."""
    return 120.0 + 4.0 * others * others + _operations(pivots, others)


@entry_kernel
def merge_fronts(parent, sizes, others, front, pivots):
    """Write into ``front`` (b,) the last block of the front of each; returns operations and entries of all factors.

    A front is merged with its parent where that takes less work, though entries that are zero come in.
    """
    count = parent.shape[0]
    for k in range(count):
        front[k] = k
        pivots[k] = sizes[k]
    for k in range(count):
        above = parent[k]
        if above < 0:
            continue
        together = pivots[k] + pivots[above]
        if together > _MOST_PIVOTS:
            continue
        apart = _work(pivots[k], others[k]) + _work(pivots[above], others[above])
        if _work(together, others[above]) <= apart:
            front[k] = above
            pivots[above] = together
    operations, entries = 0.0, 0.0
    for k in range(count - 1, -1, -1):
        if front[k] == k:
            operations += _operations(pivots[k], others[k])
            entries += pivots[k] * (pivots[k] + 2.0 * others[k])
        else:
            front[k] = front[front[k]]
    return operations, entries


def in_order(order: IntArray, starts: IntArray, neighbours: IntArray) -> tuple[IntArray, IntArray]:
    """Return the symmetric pattern with its blocks renumbered by their places in ``order``."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    counts = np.diff(starts)[order]
    at = np.concatenate(([0], np.cumsum(counts)))
    taken = np.repeat(starts[order] - at[:-1], counts) + np.arange(at[-1])
    return at, place[neighbours[taken]]
