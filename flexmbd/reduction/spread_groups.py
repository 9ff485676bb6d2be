"""Groups of a record whose rows lie on the ranks: put together on every rank, or written to the record's file by each.

A group of a mesh has a row for each node (or dof): as many numbers as the mesh has dofs, times the modes. So a rank
makes its own rows, some at a time, and nothing is gathered that goes to a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.record.groups import IntArray

GroupT = TypeVar("GroupT")
AnyArray = NDArray[np.float64] | NDArray[np.int64]

# Bytes that are made, sent or written at a time.
_PIECE = 1 << 22


@dataclass(frozen=True, eq=False)
class SpreadRows:
    """An array (k, ...) whose rows lie on the ranks, each on one of them.

    Attributes:
        comm: the ranks.
        count: k, the same on all ranks.
        place: (m,) the rows that this rank has.
        shape: of a row.
        rows: which of the m, as (j,) numbers, to their values (j, ...); not collective.
    """

    comm: MPI.Comm
    count: int
    place: IntArray
    shape: tuple[int, ...]
    rows: Callable[[NDArray[np.intp]], FloatArray]

    def pieces(self) -> Iterator[tuple[IntArray, FloatArray]]:
        """This rank's rows, ascending and some at a time: their places and values. Not collective."""
        order = np.argsort(self.place)
        for begin in range(0, len(order), self._at_once):
            which = order[begin : begin + self._at_once]
            yield self.place[which], self.rows(which)

    def whole(self) -> FloatArray:
        """(k, ...) on every rank, read-only and the same to the bit. Collective."""
        whole: FloatArray = np.empty((self.count, *self.shape))
        for rank in range(self.comm.size):
            mine = self.pieces() if rank == self.comm.rank else iter(())
            for _ in range(self.comm.bcast(math.ceil(len(self.place) / self._at_once), root=rank)):
                place, values = next(mine, (None, None))
                place = self.comm.bcast(place, root=rank)
                received = np.empty((len(place), *self.shape)) if values is None else np.ascontiguousarray(values)
                self.comm.Bcast(received, root=rank)
                whole[place] = received
        whole.flags.writeable = False
        return whole

    @property
    def _at_once(self) -> int:
        return max(1, _PIECE // max(1, 8 * math.prod(self.shape)))


@dataclass(frozen=True, eq=False)
class SpreadGroup(Generic[GroupT]):
    """A group of a record with arrays whose rows lie on the ranks.

    Attributes:
        kind: of `flexmbd.record.groups`.
        arrays: by the names of the kind; those that are not spread are the same on every rank.
    """

    kind: type[GroupT]
    arrays: Mapping[str, AnyArray | SpreadRows]

    @property
    def items(self) -> dict[str, AnyArray | SpreadRows]:
        """The arrays in the order of the kind."""
        kind: Any = self.kind  # a dataclass
        return {item.name: self.arrays[item.name] for item in fields(kind)}

    def whole(self) -> GroupT:
        """The group with all of its arrays, on every rank. Collective."""
        return self.kind(**{k: a.whole() if isinstance(a, SpreadRows) else a for k, a in self.items.items()})


def all_numbers(comm: MPI.Comm, numbers: IntArray) -> IntArray:
    """(k,) the numbers, whole, that any rank has, ascending, each once. Collective."""
    return np.unique(np.concatenate(comm.allgather(numbers)))
