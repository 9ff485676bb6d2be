"""Numbers for displacement nodes, and the boundary's triangles, that no partition changes.

A displacement node that is a node of the mesh has its row in the input as its number.  The others,
of a displacement of degree 2 on straight cells, are numbered after the highest row, in the sorted
order of the rows of the vertices whose edge, face or cell they are the middle of.
"""

from __future__ import annotations

from itertools import pairwise

from mpi4py import MPI

import basix
import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.errors import FormulationError, MeshError
from flexmbd.given import checked

IntArray = NDArray[np.int64]


@checked(error=FormulationError, agree=parallel.told_to_all)
def node_numbers(model: Discretisation) -> IntArray:
    """The number of each displacement node. Collective.

    Returns:
        (local nodes including ghosts,), in the order of `DofLayout.node_x`.

    Raises:
        FormulationError: on all ranks: a displacement of degree 3 or more.
    """
    degree = model.layout.displacement_degree
    if degree > 2:
        raise FormulationError(f"nodes are numbered up to degree 2, not {degree}")
    dofmap = model.layout.node_space.dofmap
    cells, nodes = dofmap.list, compat.cell_nodes(model.mesh.mesh)
    rows = np.asarray(model.mesh.mesh.geometry.input_global_indices)[nodes]
    blocks = dofmap.index_map
    numbers = np.empty(blocks.size_local + blocks.num_ghosts, dtype=np.int64)
    # both are Lagrange elements of basix, which lists vertices first
    numbers[cells[:, : rows.shape[1]]] = rows
    if cells.shape[1] > rows.shape[1]:
        middles = [_vertices(model, i) for i in range(rows.shape[1], cells.shape[1])]
        width = max(map(len, middles))
        keys = np.full((len(numbers), width), -1, dtype=np.int64)
        for i, vertices in enumerate(middles, start=rows.shape[1]):
            keys[cells[:, i], : len(vertices)] = np.sort(rows[:, vertices], axis=1)
        _number_middles(model, numbers, keys, first=rows.max(initial=-1) + 1)
    return numbers


def _vertices(model: Discretisation, dof: int) -> list[int]:
    """The vertices of the cell whose edge, face or inside a node of the cell is the middle of."""
    topology = basix.topology(basix.CellType[model.mesh.mesh.topology.cell_name()])
    layout = model.layout.node_space.dofmap.dof_layout
    for dim, entities in enumerate(topology):
        for index, vertices in enumerate(entities):
            if dof in layout.entity_dofs(dim, index):
                return list(vertices)
    raise FormulationError(f"the element's dof {dof} is on no edge, face or cell")


def _number_middles(
    model: Discretisation, numbers: IntArray, keys: IntArray, *, first: int
) -> None:
    """Number the nodes that have a key, in the order of the keys. Collective."""
    first = max(model.comm.allgather(first))
    with_key = np.flatnonzero(keys[:, 0] >= 0)
    owned = with_key[with_key < model.layout.n_owned_nodes]
    gathered = parallel.gather_rows(model.comm, keys[owned])
    known = model.comm.bcast(None if gathered is None else np.unique(gathered, axis=0), root=0)
    # every key is known, so the union is `known` and the inverse the place in it
    _, place = np.unique(np.vstack([known, keys[with_key]]), axis=0, return_inverse=True)
    numbers[with_key] = first + place.reshape(-1)[len(known) :]


def further_dofs(model: Discretisation) -> NDArray[np.int64]:
    """(m,) dofs of this rank, ghosts included, that are not displacements; ascending, and not collective."""
    return model.layout.further_dofs


def dof_numbers(model: Discretisation, dofs: NDArray[np.int64]) -> IntArray:
    """Numbers of dofs that no partition changes. Collective.

    That of the first cell, in the order of the input, that a dof is of, times the dofs of a cell, and its place there.

    Args:
        model: on several ranks.
        dofs: (m,) local, ghosts included.

    Returns:
        (m,).
    """
    dofmap, cells = model.space.dofmap, np.asarray(model.mesh.mesh.topology.original_cell_index, dtype=np.int64)
    size = dofmap.index_map_bs
    local = (size * dofmap.list[:, :, None].astype(np.int64) + np.arange(size)).reshape(len(dofmap.list), -1)
    keys = cells[: len(local), None] * local.shape[1] + np.arange(local.shape[1])
    least = np.full(model.layout.n_local, np.iinfo(np.int64).max)
    np.minimum.at(least, local, keys)
    blocks = dofmap.index_map
    ours = np.arange(blocks.size_local + blocks.num_ghosts, dtype=np.int32)
    places = (size * blocks.local_to_global(ours)[:, None] + np.arange(size)).reshape(-1)
    # a rank need not have all cells of its dofs
    shared = np.full(size * blocks.size_global, np.iinfo(np.int64).max)
    shared[places] = least
    model.comm.Allreduce(MPI.IN_PLACE, shared, op=MPI.MIN)
    return shared[places[dofs]]


def boundary_triangles(model: Discretisation) -> NDArray[np.int32]:
    """Triangles between displacement nodes that cover the boundary of the part. Collective.

    Of degree 1 a facet is one triangle, or two for a quadrilateral; of degree 2 four, or eight. A
    mesh of surfaces is covered itself.

    Returns:
        (t, 3) local nodes, counter-clockwise seen from outside, or as the cells are; this rank's only.

    Raises:
        MeshError: on all ranks: a mesh of lines.
    """
    topology = model.mesh.mesh.topology
    if topology.dim == 1:
        raise MeshError("a part meshed by lines has no surface to draw")
    if topology.dim == 2:
        owned = model.layout.node_space.dofmap.list[: topology.index_map(2).size_local]
        return owned[:, _surface_triangles(model)].reshape(-1, 3)
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = exterior_facet_indices(topology)
    to_cells, to_facets = topology.connectivity(2, 3), topology.connectivity(3, 2)
    tables = _facet_triangles(model)
    triangles = np.empty((len(facets), len(tables[0]), 3), dtype=np.int32)
    inside = np.empty((len(facets), 3))
    x = model.layout.node_x
    for row, facet in enumerate(facets):
        cell = to_cells.links(facet)[0]
        dofs = model.layout.node_space.dofmap.cell_dofs(cell)
        local = int(np.flatnonzero(to_facets.links(cell) == facet)[0])
        triangles[row] = dofs[tables[local]]
        inside[row] = x[dofs].mean(axis=0)
    corners = x[triangles]
    normal = np.cross(
        corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    )
    # by facet, since one triangle of a curved facet may look another way
    inwards = np.einsum("fti,fi->f", normal, inside - corners.mean(axis=(1, 2))) > 0.0
    triangles[inwards] = triangles[inwards][..., ::-1]
    return triangles.reshape(-1, 3)


def sorted_triangles(triangles: IntArray) -> IntArray:
    """The same triangles (t, 3) of node numbers in an order that no partition changes.

    Each begins with its smallest number and keeps its sense; then the rows ascend.
    """
    first = triangles.argmin(axis=1)[:, None]
    turned = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T[::-1])]


def _facet_triangles(model: Discretisation) -> list[NDArray[np.int64]]:
    """For each facet of the reference cell, its triangles (t, 3) as nodes of the cell."""
    topology = basix.topology(basix.CellType[model.mesh.mesh.topology.cell_name()])
    return [_triangles(model, facet) for facet in topology[2]]


def _surface_triangles(model: Discretisation) -> NDArray[np.int64]:
    """The triangles (t, 3) of a cell that is a surface itself, as its nodes."""
    cell = basix.CellType[model.mesh.mesh.topology.cell_name()]
    return _triangles(model, basix.topology(cell)[2][0])


def _triangles(model: Discretisation, facet: list[int]) -> NDArray[np.int64]:
    """The triangles of a facet, given by its vertices in the reference cell."""
    topology = basix.topology(basix.CellType[model.mesh.mesh.topology.cell_name()])
    layout = model.layout.node_space.dofmap.dof_layout

    def middle(*vertices: int) -> int:
        dim = {2: 1, 4: 2}[len(vertices)]
        index = [sorted(entity) for entity in topology[dim]].index(sorted(vertices))
        return layout.entity_dofs(dim, index)[0]

    # around the facet; basix lists quadrilaterals row by row
    ring = list(facet) if len(facet) == 3 else [facet[0], facet[1], facet[3], facet[2]]
    pairs = list(pairwise([*ring, ring[0]]))
    if model.layout.displacement_degree == 1:
        table = [[ring[0], b, c] for b, c in pairwise(ring[1:])]
    elif len(ring) == 3:
        middles = [middle(*pair) for pair in pairs]
        table = [[ring[i], middles[i], middles[i - 1]] for i in range(3)] + [middles]
    else:
        around = [node for pair in pairs for node in (pair[0], middle(*pair))]
        centre = middle(*facet)
        table = [[centre, around[i - 1], around[i]] for i in range(8)]
    return np.array(table)
