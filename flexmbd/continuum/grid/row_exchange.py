"""Rows of arrays that are spread over ranks: sent where they belong, none of the ranks holding all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]
RowsT = TypeVar("RowsT", bound=npt.NDArray[Any])


def share_of(rank: int, size: int, total: int) -> slice:
    """The rows, of `total`, that are one rank's when all have about as many; not collective."""
    return slice(total * rank // size, total * (rank + 1) // size)


def fetch(comm: MPI.Comm, block: RowsT, numbers: IntArray) -> RowsT:
    """Rows, by their numbers, of an array of which each rank holds a block. Collective.

    Args:
        comm: the ranks.
        block: (n, ...) this rank's rows, those of lower ranks before.
        numbers: (k,) of the rows that this rank wants.
    """
    starts = np.concatenate(([0], np.cumsum(comm.allgather(len(block)))))
    owner = np.searchsorted(starts, numbers, side="right") - 1
    order, ends = _by_owner(owner, comm.size)
    requests = comm.alltoall(np.split(numbers[order], ends))
    answers = comm.alltoall([block[which - starts[comm.rank]] for which in requests])
    values: Any = np.empty((len(numbers), *block.shape[1:]), dtype=block.dtype)
    values[order] = np.concatenate(answers)
    return values


def send(
    comm: MPI.Comm, keys: IntArray, rows: RowsT, *, total: int
) -> tuple[IntArray, RowsT]:
    """Send each row to the rank in whose share its key lies. Collective.

    Args:
        comm: the ranks.
        keys: (n,) 0 to total - 1.
        rows: (n, ...).
        total: the same on all ranks; the shares are those of `share_of`.

    Returns:
        Keys and rows that this rank receives, in no order.
    """
    starts = [share_of(rank, comm.size, total).start for rank in range(comm.size)]
    order, ends = _by_owner(np.searchsorted(starts, keys, side="right") - 1, comm.size)
    got = [np.concatenate(comm.alltoall(np.split(part[order], ends))) for part in (keys, rows)]
    return got[0], got[1]  # type: ignore[return-value]


def blocks_on_root(comm: MPI.Comm, block: RowsT) -> Iterator[RowsT]:
    """On rank 0 the blocks of all ranks, one after the other; on the others nothing. Collective.

    Rank 0 must take all of them: the others wait until theirs is taken.
    """
    for rank in range(comm.size):
        if rank == 0 and comm.rank == 0:
            yield block
        elif comm.rank == 0:
            yield comm.recv(source=rank)
        elif comm.rank == rank:
            comm.send(block, dest=0)


def _by_owner(owner: npt.NDArray[np.intp], size: int) -> tuple[npt.NDArray[np.intp], IntArray]:
    """An order that puts the rows of one owner together, and where those of the next begin."""
    return np.argsort(owner, kind="stable"), np.cumsum(np.bincount(owner, minlength=size))[:-1]
