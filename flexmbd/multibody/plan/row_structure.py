"""What follows from the integers of a plan's constraint rows alone: found once, and shared by a scene's variants."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.row_blocks import RowBlock, row_blocks
from flexmbd.multibody.kernels.forward_dynamics.row_paths import RowPaths, new_row_paths
from flexmbd.multibody.kernels.reading.constraint_tables import ConstraintRows, constraint_rows, coupling_rows
from flexmbd.multibody.plan.row_slopes import RowSweeps, row_sweeps

IntArray = NDArray[np.int64]

_FEW_SWEEPS = 64  # that take less than to find the paths
#: The rows that turn a body's z onto another's: x . z' and y . z', the turns about y and, backwards, about x.
ALIGNING = (2, 5)


class TurnedPair(NamedTuple):
    """Two frames between which there are rows that are sines of angles, each array (k,).

    Attributes:
        frames: rows F and G of ``plan.frames``.
        unturned: rows that let G turn about no axis of F.
        aligned: rows that hold z of G along z of F.
    """

    frames: tuple[int, int]
    unturned: IntArray
    aligned: IntArray


class RowStructure:
    """The constraint rows of plans that differ in their numbers alone.

    Attributes:
        rows: the very array ``Plan.rows`` that it is of.
    """

    def __init__(self, plan: Plan) -> None:
        self.rows = plan.rows
        self._plan = plan
        self._kept: dict[tuple[int, ...], RowStructure] = {}

    @cached_property
    def table(self) -> ConstraintRows:
        """The rows by their columns."""
        return constraint_rows(self._plan)

    @cached_property
    def in_rad(self) -> NDArray[np.bool_]:
        """(m,) whether a row's value is an angle."""
        return self.table.in_rad

    @cached_property
    def couplings(self) -> IntArray:
        """(k,) rows that couple coordinates."""
        return coupling_rows(self._plan)

    @cached_property
    def blocks(self) -> tuple[RowBlock, ...]:
        """Blocks of rows that share no free coordinate."""
        return row_blocks(self._plan)

    @cached_property
    def sweeps(self) -> RowSweeps:
        """The sweeps over the machine that give the slopes of all rows."""
        return row_sweeps(self.blocks, len(self._plan.free) + len(self._plan.driven))

    @cached_property
    def paths(self) -> RowPaths | None:
        """The bodies that each row visits, where slopes take fewer operations row by row than by sweeps."""
        if self.sweeps.count <= _FEW_SWEEPS:
            return None
        paths = new_row_paths(self._plan)
        return paths if len(paths.body) < self.sweeps.count * len(self._plan.tree) else None

    @cached_property
    def turned_pairs(self) -> tuple[TurnedPair, ...]:
        """The pairs of frames whose rows fall back beyond a right angle."""
        table = self.table
        unturned = table.kind == kinds.ROW_AXIS
        aligned = (table.kind == kinds.ROW_DIRECTION) & np.isin(table.index, ALIGNING)
        pairs: dict[tuple[int, int], list[int]] = {}
        for k in np.flatnonzero(unturned | aligned):
            pairs.setdefault((int(table.f[k]), int(table.g[k])), []).append(int(k))
        return tuple(
            TurnedPair(frames, *(np.array([k for k in own if mask[k]], np.int64) for mask in (unturned, aligned)))
            for frames, own in pairs.items()
        )

    def keeping(self, kept: tuple[int, ...]) -> RowStructure:
        """That of some of the rows alone."""
        found = self._kept.get(kept)
        if found is None:
            rows = np.ascontiguousarray(self.rows[list(kept)])
            found = self._kept[kept] = RowStructure(self._plan.replace(rows=rows))
        return found
