"""Which process of `mpirun` this is, by its environment, without loading MPI, and on how many cores."""

from __future__ import annotations

import os
import sys

_RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


def launched_rank() -> int:
    """The number of this process among those that mpirun started; 0 without it."""
    return _first_number(_RANKS, 0)


def launched_ranks() -> int:
    """Number of processes that mpirun started with this one; 1 without it."""
    return _first_number(_SIZES, 1)


def usable_cores() -> int:
    """Number of cores that this process may run on; all of the computer's where the system does not restrict it."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _first_number(names: tuple[str, ...], default: int) -> int:
    """The number in the first of these environment variables of mpirun that has one."""
    for name in names:
        text = os.environ.get(name, "")
        if text.isdecimal():
            return int(text)
    return default
