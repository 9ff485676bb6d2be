"""The order in which blocks are eliminated: approximate minimum degree on a quotient graph, blocks weighted by size.

Amestoy, Davis and Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17 (1996).
What is eliminated becomes an *element*: the list of the blocks that it couples.  Blocks that couple alike are one
variable.  A block with zeros on its diagonal, as of multipliers, waits until its neighbours of lower rank have been
eliminated, or as many unknowns of them as it has itself and no other such block counts: then it has pivots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

_VARIABLE, _ELEMENT, _GONE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class QuotientGraph(ArrayStruct):
    """Blocks and elements while blocks are eliminated; all but ``lists`` (capacity,) and ``bucket`` are (b,).

    begin, elements, others: where in ``lists`` a block's elements stand, how many, and how many blocks after them; of
    an element, its blocks.  state: variable, element or neither.  weight: unknowns, of all that was merged into it.
    merged, tail: a chain of what was merged.  degree: of a variable, approximately; of an element, its unknowns.
    outside, stamp: an element's unknowns outside the newest, and which that was.  mark: a variable's newest element.
    key: the sum of a variable's list; seen: in which comparison of lists an entry was met.
    bucket (unknowns + 1,), next, previous: variables by degree; listed: whether one stands there.
    waiting: 1 while a block must not go.  unspent: unknowns of an eliminated block that can give pivots.
    pending: lower neighbours that are still there.
    """

    lists: IntArray
    bucket: IntArray
    begin: IntArray
    elements: IntArray
    others: IntArray
    state: IntArray
    weight: IntArray
    merged: IntArray
    tail: IntArray
    degree: IntArray
    outside: IntArray
    stamp: IntArray
    mark: IntArray
    key: IntArray
    seen: IntArray
    listed: IntArray
    next: IntArray
    previous: IntArray
    waiting: IntArray
    unspent: IntArray
    pending: IntArray


def elimination_order(sizes: IntArray, starts: IntArray, neighbours: IntArray, ranks: IntArray) -> IntArray:
    """Return the blocks (b,) in the order of elimination.

    Args:
        sizes: (b,) unknowns of each block.
        starts: (b + 1,) where the neighbours of each block stand.
        neighbours: the symmetric pattern: block i couples ``neighbours[starts[i]:starts[i + 1]]``, not itself.
        ranks: (b,) a block waits for neighbours of lower rank.
    """
    count = len(sizes)
    order = np.zeros(count, np.int64)
    capacity = 4 * len(neighbours) + 16 * count + 64
    while True:
        graph = _new_graph(sizes, starts, neighbours, ranks, capacity)
        if order_blocks(graph, starts, neighbours, ranks, sizes, order):
            return order
        capacity *= 2


def _new_graph(
    sizes: IntArray, starts: IntArray, neighbours: IntArray, ranks: IntArray, capacity: int
) -> QuotientGraph:
    count = len(sizes)
    lists = np.zeros(capacity, np.int64)
    lists[: len(neighbours)] = neighbours
    owner = np.repeat(np.arange(count), np.diff(starts))
    lower = ranks[neighbours] < ranks[owner]
    pending = np.bincount(owner[lower], minlength=count).astype(np.int64)

    def fill(value: int) -> IntArray:
        return np.full(count, value, np.int64)

    return QuotientGraph(
        lists=lists,
        bucket=np.full(int(sizes.sum()) + 1, -1, np.int64),
        begin=starts[:-1].copy(),
        elements=fill(0),
        others=np.diff(starts),
        state=fill(_VARIABLE),
        weight=sizes.copy(),
        merged=fill(-1),
        tail=np.arange(count, dtype=np.int64),
        degree=np.bincount(owner, sizes[neighbours], count).astype(np.int64),
        outside=fill(0),
        stamp=fill(-1),
        mark=fill(-1),
        key=fill(0),
        seen=fill(-1),
        listed=fill(0),
        next=fill(-1),
        previous=fill(-1),
        waiting=(pending > 0).astype(np.int64),
        unspent=fill(0),
        pending=pending,
    )


@entry_kernel
def order_blocks(graph, starts, neighbours, ranks, sizes, order):
    """Write the order of elimination into ``order``; False if ``graph.lists`` is too short."""
    count = sizes.shape[0]
    for i in range(count):
        if graph.waiting[i] == 0:
            _insert(graph, i)
    end = starts[count]
    done = 0
    lowest = 0
    left = graph.bucket.shape[0] - 1
    while done < count:
        pivot, lowest = _least(graph, lowest)
        if pivot < 0:  # what waits for pivots that never come: the rest in any order
            for i in range(count):
                if graph.state[i] == _VARIABLE and graph.waiting[i] > 0:
                    graph.waiting[i] = 0
                    _insert(graph, i)
            lowest = 0
            continue
        _remove(graph, pivot)
        last = _new_element(graph, pivot, end)
        if last < 0:
            return False
        end = last
        left -= graph.weight[pivot]
        before = done
        done = _note(graph, pivot, order, done)
        _measure_outside(graph, pivot)
        left, done = _update_variables(graph, pivot, left, order, done)
        _merge_alike(graph, pivot)
        for k in range(before, done):
            _release(graph, starts, neighbours, ranks, sizes, order[k])
        lowest = min(lowest, _insert_all(graph, pivot, left))
    return True


@kernel
def _insert(graph, i):
    """Put a variable before others of its degree."""
    head = graph.bucket[graph.degree[i]]
    graph.next[i] = head
    graph.previous[i] = -1
    if head >= 0:
        graph.previous[head] = i
    graph.bucket[graph.degree[i]] = i
    graph.listed[i] = 1


@kernel
def _remove(graph, i):
    """Take a variable out of its bucket, if it is in one."""
    if graph.listed[i] == 0:
        return
    graph.listed[i] = 0
    after, before = graph.next[i], graph.previous[i]
    if after >= 0:
        graph.previous[after] = before
    if before >= 0:
        graph.next[before] = after
    else:
        graph.bucket[graph.degree[i]] = after


@kernel
def _least(graph, lowest):
    """The variable of least degree, -1 if no bucket has one; and its degree."""
    for degree in range(lowest, graph.bucket.shape[0]):
        if graph.bucket[degree] >= 0:
            return graph.bucket[degree], degree
    return -1, graph.bucket.shape[0]


@kernel
def _note(graph, i, order, done):
    """Write a variable and all that was merged into it into the order."""
    while i >= 0:
        order[done] = i
        done += 1
        i = graph.merged[i]
    return done


@kernel
def _new_element(graph, pivot, end):
    """List what ``pivot`` couples at ``end`` of the lists, its elements absorbed; the new end, -1 without room."""
    lists, mark = graph.lists, graph.mark
    begin, first = end, graph.begin[pivot]
    graph.state[pivot] = _ELEMENT
    mark[pivot] = pivot
    total = 0
    for k in range(first, first + graph.elements[pivot] + graph.others[pivot]):
        of_element = k < first + graph.elements[pivot]
        one = lists[k]
        if of_element and graph.state[one] != _ELEMENT:
            continue
        low = graph.begin[one] if of_element else k
        high = low + graph.others[one] if of_element else k + 1
        for q in range(low, high):
            i = lists[q]
            if graph.state[i] == _VARIABLE and mark[i] != pivot:
                if end == lists.shape[0]:
                    return -1
                mark[i] = pivot
                lists[end] = i
                end += 1
                total += graph.weight[i]
        if of_element:
            graph.state[one] = _GONE
    graph.begin[pivot] = begin
    graph.elements[pivot] = 0
    graph.others[pivot] = end - begin
    graph.degree[pivot] = total
    return end


@kernel
def _measure_outside(graph, pivot):
    """Of each element that meets the newest, how many unknowns lie outside that."""
    lists = graph.lists
    for k in range(graph.begin[pivot], graph.begin[pivot] + graph.others[pivot]):
        i = lists[k]
        _remove(graph, i)
        for q in range(graph.begin[i], graph.begin[i] + graph.elements[i]):
            e = lists[q]
            if graph.state[e] != _ELEMENT:
                continue
            if graph.stamp[e] != pivot:
                graph.stamp[e] = pivot
                graph.outside[e] = graph.degree[e]
            graph.outside[e] -= graph.weight[i]


@kernel
def _update_variables(graph, pivot, left, order, done):
    """Lists and degrees of the newest element's variables; those that couple nothing else are eliminated with it."""
    begin, kept = graph.begin[pivot], graph.begin[pivot]
    size = graph.degree[pivot]
    for k in range(begin, begin + graph.others[pivot]):
        i = graph.lists[k]
        beyond = _compress(graph, pivot, i)
        if beyond == 0 and graph.waiting[i] == 0:
            graph.state[i] = _GONE
            size -= graph.weight[i]
            left -= graph.weight[i]
            done = _note(graph, i, order, done)
            continue
        graph.degree[i] = min(graph.degree[i], beyond)
        graph.lists[kept] = i
        kept += 1
    graph.others[pivot] = kept - begin
    graph.degree[pivot] = size
    return left, done


@kernel
def _compress(graph, pivot, i):
    """Drop what is gone or covered by the newest element from a variable's lists; the unknowns beyond that."""
    lists = graph.lists
    first = graph.begin[i]
    middle = first + graph.elements[i]
    last = middle + graph.others[i]
    beyond, key, to = 0, pivot, first
    for q in range(first, middle):
        e = lists[q]
        if graph.state[e] == _ELEMENT:
            if graph.outside[e] == 0:
                graph.state[e] = _GONE  # the newest has all of it
            else:
                beyond += graph.outside[e]
                key += e
                lists[to] = e
                to += 1
    elements = to - first
    for q in range(middle, last):
        j = lists[q]
        if graph.state[j] == _VARIABLE and graph.mark[j] != pivot:
            beyond += graph.weight[j]
            key += j
            lists[to] = j
            to += 1
    # the newest comes first; the variable had it, or an element that it has absorbed
    if elements < to - first:
        lists[to] = lists[first + elements]
    if elements > 0:
        lists[first + elements] = lists[first]
    lists[first] = pivot
    graph.elements[i] = elements + 1
    graph.others[i] = to - first - elements
    graph.key[i] = key
    return beyond


@kernel
def _merge_alike(graph, pivot):
    """Merge variables of the newest element that couple the same."""
    lists = graph.lists
    begin, end = graph.begin[pivot], graph.begin[pivot] + graph.others[pivot]
    for k in range(begin, end):
        i = lists[k]
        if graph.state[i] != _VARIABLE or graph.waiting[i] > 0:
            continue
        tag = -1
        for q in range(k + 1, end):
            j = lists[q]
            if graph.key[j] != graph.key[i] or graph.state[j] != _VARIABLE or graph.waiting[j] > 0:
                continue
            if graph.elements[i] != graph.elements[j] or graph.others[i] != graph.others[j]:
                continue
            if tag < 0:
                tag = pivot * graph.seen.shape[0] + i
                for p in range(graph.begin[i], graph.begin[i] + graph.elements[i] + graph.others[i]):
                    graph.seen[lists[p]] = tag
            if _all_seen(graph, j, tag):
                graph.state[j] = _GONE
                graph.weight[i] += graph.weight[j]
                graph.merged[graph.tail[i]] = j
                graph.tail[i] = graph.tail[j]
    kept = begin
    for k in range(begin, end):
        if graph.state[lists[k]] == _VARIABLE:
            lists[kept] = lists[k]
            kept += 1
    graph.others[pivot] = kept - begin


@kernel
def _all_seen(graph, j, tag):
    for p in range(graph.begin[j], graph.begin[j] + graph.elements[j] + graph.others[j]):
        if graph.seen[graph.lists[p]] != tag:
            return False
    return True


@kernel
def _insert_all(graph, pivot, left):
    """Put the newest element's variables into the buckets of their degrees; the least of these."""
    lowest = left
    for k in range(graph.begin[pivot], graph.begin[pivot] + graph.others[pivot]):
        i = graph.lists[k]
        others = graph.degree[pivot] - graph.weight[i]
        graph.degree[i] = min(left - graph.weight[i], graph.degree[i] + others)
        if graph.waiting[i] == 0:
            _insert(graph, i)
            lowest = min(lowest, graph.degree[i])
    return lowest


@kernel
def _release(graph, starts, neighbours, ranks, sizes, block):
    """Let neighbours of higher rank go for which there are pivots now that ``block`` has gone."""
    graph.unspent[block] = sizes[block]
    for q in range(starts[block], starts[block + 1]):
        i = neighbours[q]
        if ranks[i] <= ranks[block] or graph.waiting[i] == 0:
            continue
        graph.pending[i] -= 1
        there = 0
        for p in range(starts[i], starts[i + 1]):
            if ranks[neighbours[p]] < ranks[i]:
                there += graph.unspent[neighbours[p]]
        if graph.pending[i] > 0 and there < sizes[i]:
            continue
        graph.waiting[i] = 0
        wanted = sizes[i]
        for p in range(starts[i], starts[i + 1]):
            if ranks[neighbours[p]] < ranks[i]:
                spent = min(wanted, graph.unspent[neighbours[p]])
                graph.unspent[neighbours[p]] -= spent
                wanted -= spent
