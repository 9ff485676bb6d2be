"""Does a mesh hang together?"""

from __future__ import annotations

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


def check_connected(mesh: dolfinx.mesh.Mesh) -> None:
    """Refuse a mesh that falls into pieces. Collective.

    Two cells hang together that share a facet; by an edge or a vertex alone a solid is a mechanism.

    Args:
        mesh: of any dimension, spread over the ranks with or without ghost cells.

    Raises:
        MeshError: on all ranks; says how many pieces there are, and where they lie.
    """
    comm, topology = mesh.comm, mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim - 1, dim)
    links = topology.connectivity(dim - 1, dim)
    # neighbours in the list of a facet's cells; not from one facet's last to the next one's first
    pairs = np.ones(max(len(links.array) - 1, 0), dtype=bool)
    pairs[links.offsets[1:-1] - 1] = False
    pieces, labels = _components(links.array[:-1][pairs], links.array[1:][pairs], _n_cells(mesh))
    shared = _shared_facets(mesh)
    label_of_shared = labels[links.array[links.offsets[shared]]]
    facets = topology.index_map(dim - 1).local_to_global(shared)
    owned = labels[: topology.index_map(dim).size_local]
    sizes = np.bincount(owned, minlength=pieces)
    x = mesh.geometry.x
    middles = x[cell_nodes(mesh)[: len(owned)]].mean(axis=1)
    sums = [np.bincount(owned, weights=middles[:, i], minlength=pieces) for i in range(3)]
    gathered = comm.gather((facets, label_of_shared, sizes, np.stack(sums, axis=1)), root=0)
    parallel.on_root(comm, lambda: _join(gathered))


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


def _join(gathered: list[tuple[NDArray, NDArray, NDArray, NDArray]]) -> None:
    """On rank 0: join the pieces of the ranks where they share facets, and refuse several."""
    facets, labels, sizes, sums = zip(*gathered, strict=True)
    first = np.concatenate(([0], np.cumsum([len(size) for size in sizes])))
    piece = np.concatenate([label + start for label, start in zip(labels, first, strict=False)])
    number = np.concatenate(facets)
    order = np.argsort(number, kind="stable")
    number, piece = number[order], piece[order]
    same = number[1:] == number[:-1]
    count, whole = _components(piece[:-1][same], piece[1:][same], int(first[-1]))
    if count <= 1:
        return
    cells = np.bincount(whole, weights=np.concatenate(sizes), minlength=count)
    total = np.zeros((count, 3))
    np.add.at(total, whole, np.concatenate(sums))
    largest = np.argsort(-cells, kind="stable")[:_NAMED]
    places = [
        f"{cells[i]:.0f} cells around {[float(f'{c:.4g}') for c in total[i] / cells[i]]} m"
        for i in largest
    ]
    more = ", ..." if count > len(places) else ""
    raise MeshError(
        f"the mesh falls into {count} pieces that share no facet: {', '.join(places)}{more}; "
        "join them (in gmsh: fuse the volumes, or fragment them so that they share surfaces and "
        "nodes), or make each a part of its own"
    )
