"""Cells of an input that share their vertices or a facet; refuses cells that DOLFINx cannot take.

Of two cells with the same vertices DOLFINx 0.9 makes no mesh, but ruins its memory. On several ranks
it takes a facet that has two cells on one of them for inner, and its vertices for unshared; a third
cell elsewhere then hangs on vertices of its own.
"""

from __future__ import annotations

from mpi4py import MPI

import basix
import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import MeshError

IntArray = NDArray[np.int64]


def check_sharing(comm: MPI.Comm, cell: str, cells: IntArray) -> None:
    """Refuse cells that overlap, and on several ranks lines or surfaces that branch. Collective.

    Args:
        comm: the ranks.
        cell: basix's name of the cells.
        cells: (m, k) this rank's share of them, as rows of the input's points, vertices first.

    Raises:
        MeshError: on all ranks; says how often, and names the nodes of one place.
    """
    shapes = basix.topology(basix.CellType[cell])
    double = _crowded(comm, cells[:, : len(shapes[0])], most=1)
    if double is not None:
        count, nodes = double
        raise MeshError(
            f"{count} cells are given more than once, one with the vertices {nodes} of the input; "
            "give each once"
        )
    solid = len(shapes) == 4
    if comm.size == 1 and not solid:
        return
    crowded = _crowded(comm, np.concatenate([cells[:, facet] for facet in shapes[-2]]), most=2)
    if crowded is None:
        return
    count, nodes = crowded
    where = f"{count} facets have more than two cells, one with the vertices {nodes} of the input"
    if solid:
        raise MeshError(f"{where}: cells overlap; mesh each place once")
    raise MeshError(f"{where}; a mesh with branches cannot be spread over ranks: run on one")


def _crowded(comm: MPI.Comm, rows: IntArray, *, most: int) -> tuple[int, list[int]] | None:
    """How many sets of vertices there are more than `most` times, and one of them. Collective.

    A set is known by the sum of its vertices' hashes, and each rank counts some of the sums.
    """
    keys = _hash(rows).sum(axis=1, dtype=np.uint64)
    order = np.argsort(keys % comm.size, kind="stable")
    ends = np.cumsum(np.bincount((keys % comm.size).astype(np.int64), minlength=comm.size))[:-1]
    mine = np.concatenate(comm.alltoall(np.split(keys[order], ends)))
    values, count = np.unique(mine, return_counts=True)
    crowded = np.concatenate(comm.allgather(values[count > most]))
    if len(crowded) == 0:
        return None
    which = rows[keys == crowded[0]]
    found = min(nodes for nodes in comm.allgather(np.sort(which[:1]).tolist()) if nodes)
    return len(crowded), found[0]


def _hash(numbers: IntArray) -> NDArray[np.uint64]:
    """64 well mixed bits of each number: splitmix64 (Steele, Lea & Flood 2014)."""
    z = numbers.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
