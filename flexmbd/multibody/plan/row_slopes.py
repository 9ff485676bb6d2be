"""Slopes of constraint rows block by block, and what goes with them block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.row_blocks import RowBlock

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RowSlopes:
    """Rates of m rows per unit of each of nv velocities, of which each block of rows has its own.

    Attributes:
        blocks: which rows and velocities; see ``row_blocks``.
        parts: of each block (k, n), by its free velocities and then by its driven ones.
        shape: (m, nv).
    """

    blocks: tuple[RowBlock, ...]
    parts: tuple[FloatArray, ...]
    shape: tuple[int, int]

    @classmethod
    def of_matrix(cls, matrix: FloatArray, free: NDArray[np.int64]) -> RowSlopes:
        """The slopes (m, nv) of rows that are not told apart, as one block."""
        m, nv = matrix.shape
        driven = np.setdiff1d(np.arange(nv), free)
        block = RowBlock(np.arange(m), free, driven)
        return cls((block,), (np.hstack([matrix[:, free], matrix[:, driven]]),), (m, nv))

    def matrix(self) -> FloatArray:
        """(m, nv) all in one matrix."""
        found = np.zeros(self.shape)
        for block, part in self:
            found[block.rows[:, None], block.velocities] = part
        return found

    def times(self, velocities: FloatArray) -> FloatArray:
        """(m,) the rates by velocities (nv,)."""
        rates = np.zeros(self.shape[0])
        for block, part in self:
            rates[block.rows] = part @ velocities[block.velocities]
        return rates

    def over(self, sizes: FloatArray) -> RowSlopes:
        """The slopes of the rows divided by sizes (m,)."""
        return RowSlopes(self.blocks, tuple(part / sizes[block.rows, None] for block, part in self), self.shape)

    def __iter__(self) -> Iterator[tuple[RowBlock, FloatArray]]:
        """Each block with its slopes."""
        return zip(self.blocks, self.parts, strict=True)


@dataclass(frozen=True, eq=False)
class RowSweeps:
    """Velocities by which all blocks move at once, one of each block's free ones a sweep, then each driven one.

    Attributes:
        blocks: of the rows.
        count: of the sweeps.
        column, sweep: (k,) each velocity, and the sweep in which it is 1.
        taken: of each block the sweeps (n,) that are its velocities', in their order.
        nv: of the machine.
    """

    blocks: tuple[RowBlock, ...]
    count: int
    column: NDArray[np.int64]
    sweep: NDArray[np.int64]
    taken: tuple[NDArray[np.int64], ...]
    nv: int

    @cached_property
    def all_velocities(self) -> FloatArray:
        """(count, nv) of all sweeps, which are few."""
        return self.velocities(0, self.count)

    def velocities(self, first: int, last: int) -> FloatArray:
        """(last - first, nv) of these sweeps."""
        found = np.zeros((last - first, self.nv))
        own = (self.sweep >= first) & (self.sweep < last)
        found[self.sweep[own] - first, self.column[own]] = 1.0
        return found

    def slopes(self, rates: FloatArray) -> RowSlopes:
        """The slopes by each velocity, by the rates (count, m) of the rows in each sweep."""
        pairs = zip(self.blocks, self.taken, strict=True)
        parts = tuple(rates[taken[:, None], block.rows].T.copy() for block, taken in pairs)
        return RowSlopes(self.blocks, parts, (rates.shape[1], self.nv))


def row_sweeps(blocks: tuple[RowBlock, ...], nv: int) -> RowSweeps:
    """The sweeps that give the slopes of blocks by each of nv velocities."""
    none = np.zeros(0, np.int64)
    together = max((len(block.free) for block in blocks), default=0)
    driven = np.unique(np.concatenate([none, *(block.driven for block in blocks)]))
    column = np.concatenate([none, *(block.free for block in blocks), driven])
    each = [np.arange(len(block.free)) for block in blocks]
    sweep = np.concatenate([none, *each, together + np.arange(len(driven))])
    taken = [
        np.concatenate([own, together + np.searchsorted(driven, block.driven)])
        for own, block in zip(each, blocks, strict=True)
    ]
    return RowSweeps(blocks, together + len(driven), column, sweep, tuple(taken), nv)
