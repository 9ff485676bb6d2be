"""Whether a mesh is connected by its facets, and into which pieces it falls."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import dolfinx.mesh
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import MeshError

# Pieces that a message describes.
_NAMED = 4


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces that a mesh falls into.

    Attributes:
        count: of all ranks.
        of_cells: (owned cells,) the piece of each cell of this rank.
        cells: (count,) how many cells each has.
        middles: (count, 3) m, the mean of their cells' middles.
    """

    count: int
    of_cells: NDArray[np.int64]
    cells: NDArray[np.int64]
    middles: NDArray[np.float64]


def check_connected(mesh: dolfinx.mesh.Mesh) -> None:
    """Refuse a mesh that falls into pieces. Collective.

    Args:
        mesh: as for `pieces`.

    Raises:
        MeshError: on all ranks; says how many pieces there are, and where they lie.
    """
    found = pieces(mesh)
    if found.count <= 1:
        return
    largest = np.argsort(-found.cells, kind="stable")[:_NAMED]
    places = [
        f"{found.cells[i]} cells around {[float(f'{c:.4g}') for c in found.middles[i]]} m" for i in largest
    ]
    more = ", ..." if found.count > len(places) else ""
    raise MeshError(
        f"the mesh falls into {found.count} pieces that share no facet: {', '.join(places)}{more}; "
        "join them (in gmsh: fuse the volumes, or fragment them so that they share surfaces and "
        "nodes), make each a mesh of its own and weld them (meshes.join), or make each a part of its own"
    )


def pieces(mesh: dolfinx.mesh.Mesh) -> Pieces:
    """The connected pieces of a mesh. Collective.

    Two cells that share a facet are connected; by an edge or a vertex alone a solid is a mechanism.

    Args:
        mesh: of any dimension, spread over the ranks with or without ghost cells.
    """
    comm, topology = mesh.comm, mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim - 1, dim)
    links = topology.connectivity(dim - 1, dim)
    # neighbours in the list of a facet's cells; not from one facet's last to the next one's first
    pairs = np.ones(max(len(links.array) - 1, 0), dtype=bool)
    pairs[links.offsets[1:-1] - 1] = False
    here, labels = _components(links.array[:-1][pairs], links.array[1:][pairs], _n_cells(mesh))
    shared = _shared_facets(mesh)
    label_of_shared = labels[links.array[links.offsets[shared]]]
    facets = topology.index_map(dim - 1).local_to_global(shared)
    owned = labels[: topology.index_map(dim).size_local]
    sizes = np.bincount(owned, minlength=here)
    x = mesh.geometry.x
    middles = x[cell_nodes(mesh)[: len(owned)]].mean(axis=1)
    sums = [np.bincount(owned, weights=middles[:, i], minlength=here) for i in range(3)]
    gathered = comm.gather((facets, label_of_shared, sizes, np.stack(sums, axis=1)), root=0)
    wholes, cells, places = parallel.on_root(comm, lambda: _join(gathered))
    return Pieces(len(cells), wholes[comm.rank][owned], cells, places)


def _n_cells(mesh: dolfinx.mesh.Mesh) -> int:
    cells = mesh.topology.index_map(mesh.topology.dim)
    return int(cells.size_local + cells.num_ghosts)


def _components(a: NDArray, b: NDArray, n: int) -> tuple[int, NDArray[np.int32]]:
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    count, labels = connected_components(graph, directed=False)
    return int(count), labels


def _shared_facets(mesh: dolfinx.mesh.Mesh) -> NDArray[np.int32]:
    """Facets that another rank holds too, local indices. Collective.

    `Topology.interprocess_facets` leaves out the points of a mesh of lines.
    """
    facets = mesh.topology.index_map(mesh.topology.dim - 1)
    first, after = facets.local_range
    elsewhere = np.concatenate(mesh.comm.allgather(facets.ghosts))
    mine = np.unique(elsewhere[(elsewhere >= first) & (elsewhere < after)]) - first
    ghosts = np.arange(facets.size_local, facets.size_local + facets.num_ghosts)
    return np.concatenate((mine, ghosts)).astype(np.int32)


def _join(
    gathered: list[tuple[NDArray, NDArray, NDArray, NDArray]],
) -> tuple[list[NDArray[np.int64]], NDArray[np.int64], NDArray[np.float64]]:
    """On rank 0: join the pieces of the ranks where they share facets.

    Returns:
        The piece of each rank's own ones; how many cells each has, and the mean of their middles.
    """
    facets, labels, sizes, sums = zip(*gathered, strict=True)
    first = np.concatenate(([0], np.cumsum([len(size) for size in sizes])))
    piece = np.concatenate([label + start for label, start in zip(labels, first, strict=False)])
    number = np.concatenate(facets)
    order = np.argsort(number, kind="stable")
    number, piece = number[order], piece[order]
    same = number[1:] == number[:-1]
    count, whole = _components(piece[:-1][same], piece[1:][same], int(first[-1]))
    cells = np.bincount(whole, weights=np.concatenate(sizes), minlength=count).astype(np.int64)
    total = np.zeros((count, 3))
    np.add.at(total, whole, np.concatenate(sums))
    wholes = [whole[start:end].astype(np.int64) for start, end in pairwise(first)]
    return wholes, cells, total / np.maximum(cells, 1)[:, None]
