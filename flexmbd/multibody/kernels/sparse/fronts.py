"""What is done to one front of a sparse matrix: what its children left is taken, its pivots are eliminated.

In the rows of a front's pivots columns are exchanged, never with other fronts' (static pivoting): the pivot is that of
the row's unknown where it is not small against the others, each by the largest of its column, so that units do not
matter.  A pivot that is round-off of the terms that it is the sum of is worthless.
"""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.round_off import WORTHLESS_PIVOT

_DIAGONAL_SHARE = 0.1  # of the largest in its row, from which the diagonal entry is the pivot


@kernel
def take(pattern, matrix, child, begin, to, p, u):
    """Add what a child left to a front: the values at ``begin`` and what it will leave at ``to`` of the stack."""
    first = pattern.at[child]
    count = pattern.at[child + 1] - first
    above = pattern.above[first : first + count]
    split = 0  # how many are pivots of the front
    while split < count and above[split] < p:
        split += 1
    one_run = count > split and above[count - 1] - above[split] == count - 1 - split
    at, left = pattern.stack_at[child], begin + p * (p + u)
    for i in range(count):
        row = matrix.stack[at + i * count : at + i * count + count]
        place = above[i]
        if place < p:
            target = matrix.values[begin + place * (p + u) : begin + (place + 1) * (p + u)]
            for j in range(count):
                target[above[j]] += row[j]
            continue
        target = matrix.values[left + (place - p) * p : left + (place - p + 1) * p]
        for j in range(split):
            target[above[j]] += row[j]
        rest = matrix.stack[to + (place - p) * u : to + (place - p + 1) * u]
        if one_run:
            shift = above[split] - p - split
            for j in range(split, count):
                rest[j + shift] += row[j]
        else:
            for j in range(split, count):
                rest[above[j] - p] += row[j]


@kernel
def eliminate(pattern, matrix, first, begin, p, w, reach, holds):
    """LU of p rows at ``begin`` by their first p columns, up to column ``reach``; which pivot is worthless, or -1."""
    values, columns = matrix.values, matrix.columns
    for j in range(p):
        columns[0, j] = 0.0
        columns[1, j] = matrix.size[first + j]
        for i in range(p if p > 1 else 0):
            columns[0, j] = max(columns[0, j], abs(values[begin + i * w + j]))
    for k in range(p):
        row = values[begin + k * w : begin + (k + 1) * w]
        other = _pivot_column(row, columns, matrix.size[first + k], k, p)
        kept = _kept(matrix, first, begin, k, other, w)
        if not abs(row[other]) > WORTHLESS_PIVOT * kept:
            if not holds:
                return k
            other = k
            kept = _kept(matrix, first, begin, k, k, w)
            held = kept if kept > 0.0 else 1.0
            matrix.held[pattern.unknown[first + k]] = held
            row[k] += held
        elif kept > 0.0:
            matrix.least[0] = min(matrix.least[0], abs(row[other]) / kept)
        _exchange_columns(matrix, first, begin, k, other, p, w)
        pivot = row[k]
        for i in range(k + 1, p):
            below = values[begin + i * w : begin + (i + 1) * w]
            share = below[k] / pivot
            below[k] = share
            if share != 0.0:
                for c in range(k + 1, reach):
                    below[c] -= share * row[c]
    return -1


@kernel
def _kept(matrix, first, begin, k, j, w):
    """What the entry (k, j) of a front's pivots is the sum of, by size."""
    values = matrix.values
    before, terms = values[begin + k * w + j], 0.0
    for m in range(k):
        term = values[begin + k * w + m] * values[begin + m * w + j]
        before += term
        terms += abs(term)
    return abs(before) + terms + np.sqrt(matrix.size[first + k] * matrix.columns[1, j])


@kernel
def _exchange_columns(matrix, first, begin, k, other, p, w):
    values, columns = matrix.values, matrix.columns
    matrix.exchanges[first + k] = other
    if other != k:
        columns[0, k], columns[0, other] = columns[0, other], columns[0, k]
        columns[1, k], columns[1, other] = columns[1, other], columns[1, k]
        for i in range(begin, begin + p * w, w):
            entry = values[i + k]
            values[i + k] = values[i + other]
            values[i + other] = entry


@kernel
def _pivot_column(row, columns, terms, k, p):
    """Which column gives the pivot of row k: its own, unless that is small by the columns' scales.

    ``terms``: what its diagonal entry is the sum of; beside these and the columns' own round-off is no pivot.
    """
    if k == p - 1:
        return k
    best, largest, own = k, 0.0, 0.0
    for j in range(k, p):
        if abs(row[j]) > WORTHLESS_PIVOT * np.sqrt(terms * columns[1, j]):
            size = abs(row[j]) / max(columns[0, j], abs(row[j]))
            if j == k:
                own = size
            if size > largest:
                best, largest = j, size
    return k if own >= _DIAGONAL_SHARE * largest else best


@kernel
def exchange(matrix, first, left, p, u):
    """Exchange the columns of the rows (u, p) at ``left`` as those of the pivots."""
    values = matrix.values
    for k in range(p):
        other = matrix.exchanges[first + k]
        if other != k:
            for i in range(left, left + u * p, p):
                entry = values[i + k]
                values[i + k] = values[i + other]
                values[i + other] = entry


@kernel
def leave(matrix, begin, left, to, p, u):
    """The left columns divided by the pivots, and what the front leaves to its others."""
    values, stack, w = matrix.values, matrix.stack, p + u
    for i in range(u):
        own = values[left + i * p : left + (i + 1) * p]
        for k in range(p):
            row = values[begin + k * w : begin + (k + 1) * w]
            own[k] /= row[k]
            for c in range(k + 1, p):
                own[c] -= own[k] * row[c]
        rest = stack[to + i * u : to + (i + 1) * u]
        for k in range(0, p - 1, 2):
            one, two = own[k], own[k + 1]
            row = values[begin + k * w + p : begin + (k + 1) * w]
            next_row = values[begin + (k + 1) * w + p : begin + (k + 2) * w]
            for c in range(u):
                rest[c] -= one * row[c] + two * next_row[c]
        if p % 2 == 1:
            one = own[p - 1]
            row = values[begin + p * w - u : begin + p * w]
            for c in range(u):
                rest[c] -= one * row[c]


@kernel
def add_sizes(pattern, matrix, at, begin, left, p, u):
    """Add to ``matrix.size`` of each other the terms that its diagonal entry became the sum of."""
    values, w = matrix.values, p + u
    for i in range(u):
        total = 0.0
        for k in range(p):
            total += abs(values[left + i * p + k] * values[begin + k * w + p + i])
        matrix.size[pattern.places[at + i]] += total
