"""Slopes of constraint rows block by block, and what goes with them block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.forward_dynamics.row_blocks import RowBlock

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
        parts = tuple(part / sizes[block.rows, None] for block, part in self)
        return replace(self, parts=parts)

    def __iter__(self) -> Iterator[tuple[RowBlock, FloatArray]]:
        """Each block with its slopes."""
        return zip(self.blocks, self.parts, strict=True)
