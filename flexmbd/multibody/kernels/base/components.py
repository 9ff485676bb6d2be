"""Which things hang together, by pairs of them that do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


def components(count: int, one: IntArray, other: IntArray) -> IntArray:
    """(count,) of each thing the least one that it hangs together with.

    Args:
        count: how many things there are.
        one: (k,) the first of pairs that hang together.
        other: (k,) the second.
    """
    least = np.arange(count)
    while True:
        ends = least[one], least[other]
        apart = ends[0] != ends[1]
        if not apart.any():
            return least
        one, other = one[apart], other[apart]
        np.minimum.at(least, np.maximum(*ends)[apart], np.minimum(*ends)[apart])
        while True:  # each leads to a lesser one, or to itself
            further = least[least]
            if np.array_equal(further, least):
                break
            least = further
