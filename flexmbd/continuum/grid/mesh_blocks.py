"""A mesh as its input listed it, whatever the partition: the way back from the ranks to an input."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.mesh_input import entity_vertices
from flexmbd.continuum.grid.row_exchange import send, share_of
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.parallel import gather_rows

IntArray = npt.NDArray[np.int64]

#: The kinds of groups below the cells, by the arrays of their entities.
BELOW = {"facets": "facet", "edges": "edge", "vertices": "vertex"}


def numbered(names: Collection[str]) -> dict[str, int]:
    """Tags of groups, from 1."""
    return {name: tag for tag, name in enumerate(names, start=1)}


def mesh_blocks(part: TaggedMesh) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """This rank's block of each array that lists a mesh, by its name, one after the other. Collective.

    Points, cells (rows of points) and cell_tags in the order of the input; facets, facet_tags, edges, edge_tags,
    vertices, vertex_tags (vertices as rows of points) all on rank 0. Put together, the blocks of all ranks are the
    same whatever their number.
    """
    comm, geometry, topology = part.comm, part.mesh.geometry, part.mesh.topology
    n_nodes, cells = geometry.index_map().size_local, topology.index_map(part.dim)
    rows = geometry.input_global_indices
    total = comm.allreduce(int(rows.max(initial=-1)), op=MPI.MAX) + 1
    yield "points", _block(comm, rows[:n_nodes], geometry.x[:n_nodes], total=total)
    original = np.asarray(topology.original_cell_index)[: cells.size_local]
    nodes = rows[cell_nodes(part.mesh)[: cells.size_local]]
    yield "cells", _block(comm, original, nodes, total=cells.size_global)
    tags = np.zeros(cells.size_local + cells.num_ghosts, dtype=np.int32)
    tags[part.cell_tags.indices] = part.cell_tags.values
    yield "cell_tags", _block(comm, original, tags[: cells.size_local], total=cells.size_global)
    facets = [(part.facet_tags.find(tag), tag) for tag in part.facet_groups.values()]
    edges = [(held, tag) for tag, held in enumerate(part.edge_groups.values(), start=1)]
    vertices = [(held, tag) for tag, held in enumerate(part.vertex_groups.values(), start=1)]
    for name, dim, groups in (
        ("facets", part.dim - 1, facets),
        ("edges", 1, edges),
        ("vertices", 0, vertices),
    ):
        held, values = _entities(part, dim, groups)
        yield name, held
        yield f"{BELOW[name]}_tags", values


def _block(
    comm: MPI.Comm, keys: IntArray, rows: npt.NDArray[Any], *, total: int
) -> npt.NDArray[Any]:
    """This rank's share of rows with unique keys, in their order; zero where there is none. Collective."""
    mine = share_of(comm.rank, comm.size, total)
    keys, rows = send(comm, keys.astype(np.int64), rows, total=total)
    block = np.zeros((mine.stop - mine.start, *rows.shape[1:]), dtype=rows.dtype)
    block[keys - mine.start] = rows
    return block


def _entities(
    part: TaggedMesh, dim: int, groups: list[tuple[npt.NDArray[np.int32], int]]
) -> tuple[IntArray, npt.NDArray[np.int32]]:
    """On rank 0 the vertices and tags of all entities in groups, on the others none. Collective."""
    every = entity_vertices(part.mesh, dim)
    owned = part.mesh.topology.index_map(dim).size_local
    mine = [(held[held < owned], tag) for held, tag in groups]
    none = np.empty((0, every.shape[1] + 1), dtype=np.int64)
    rows = [np.column_stack((np.full(len(held), tag), every[held])) for held, tag in mine]
    gathered = gather_rows(part.comm, np.concatenate([none, *rows]))
    found = none if gathered is None else gathered[np.lexsort(gathered.T[::-1])]
    return np.ascontiguousarray(found[:, 1:]), found[:, 0].astype(np.int32)
