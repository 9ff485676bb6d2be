"""Conditions of order of Runge-Kutta methods, one a rooted tree (Butcher 1963; Hairer, Norsett & Wanner 1993, II.2)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MOST = 8  # 200 trees

_SAME = 1e-10  # of the terms of a condition: coefficients typed to as many digits

RootedTree = tuple["RootedTree", ...]  # the subtrees of the root


@cache
def _trees(nodes: int) -> tuple[RootedTree, ...]:
    """Rooted trees of so many nodes."""
    return tuple(_forests(nodes - 1, nodes - 1, None))


def _forests(nodes: int, largest: int, before: RootedTree | None) -> Iterator[RootedTree]:
    """Sets of trees of ``nodes`` together, each of ``largest`` at most; of that size from ``before`` on."""
    if nodes == 0:
        yield ()
        return
    for size in range(min(nodes, largest), 0, -1):
        trees = _trees(size)
        first = trees.index(before) if before is not None and size == largest else 0
        for tree in trees[first:]:
            for rest in _forests(nodes - size, size, tree):
                yield (tree, *rest)


def _size(tree: RootedTree) -> int:
    return 1 + sum(map(_size, tree))


def _density(tree: RootedTree) -> int:
    product = _size(tree)
    for part in tree:
        product *= _density(part)
    return product


def _stages(tree: RootedTree, a: FloatArray) -> FloatArray:
    """What the tree's derivative is at the stages, but for its symmetry."""
    product = np.ones(a.shape[1])
    for part in tree:
        product *= a @ _stages(part, a)
    return product


def order_of(a: FloatArray, weights: FloatArray) -> int:
    """The order of a method's end by stages ``a`` (s, s) and ``weights`` (s,), looked at up to ``MOST``."""
    sizes, heavy = np.abs(a), np.abs(weights)
    for order in range(1, MOST + 1):
        for tree in _trees(order):
            lack = weights @ _stages(tree, a) - 1.0 / _density(tree)
            if not abs(lack) <= _SAME * (heavy @ _stages(tree, sizes) + 1.0 / _density(tree)):
                return order - 1
    return MOST
