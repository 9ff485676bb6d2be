"""A mesh as an input lists it, and the tags of its groups on the ranks it is spread over.

The entities of a group (facets, edges, vertices) are named by the rows of their vertices in the
input, which no partition changes; every rank then finds those it holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mpi4py import MPI

import basix.ufl
import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.row_exchange import fetch
from flexmbd.continuum.grid.sharing import check_sharing
from flexmbd.continuum.parallel import on_root
from flexmbd.errors import MeshError

IntArray = npt.NDArray[np.int64]
EntityTags = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class MeshInput:
    """One rank's share of an input: consecutive points and cells, those of lower ranks before.

    Attributes:
        cell: basix's name of the cells.
        degree: 1 or 2, the degree of the geometry.
        points: (n, 3) coordinates, m.
        cells: (m, k) rows of points, of all ranks' together, in basix's order of a cell's nodes.
        cell_tags: (m,) tag of each cell, 0 for none.
        cell_groups: tag of each named group, the same on all ranks; so below.
        facets: (f, v) vertices of tagged facets, as rows of points, in any order.
        facet_tags: (f,) their tags.
        facet_groups: tag of each named group.
        edge_groups: by name, (e, 2) vertices of edges.
        vertex_groups: by name, (p, 1) vertices.
        cell_numbers: (m,) what the file or program that the input is from calls each cell, for
            messages; None for rows of all ranks' cells together.
    """

    cell: str
    degree: int
    points: npt.NDArray[np.float64]
    cells: IntArray
    cell_tags: EntityTags
    cell_groups: Mapping[str, int]
    facets: IntArray
    facet_tags: EntityTags
    facet_groups: Mapping[str, int]
    edge_groups: Mapping[str, IntArray] = field(default_factory=dict)
    vertex_groups: Mapping[str, IntArray] = field(default_factory=dict)
    cell_numbers: IntArray | None = None

    def nothing(self) -> MeshInput:
        """The share of a rank that holds nothing of the same input."""
        return MeshInput(
            self.cell,
            self.degree,
            self.points[:0],
            self.cells[:0],
            self.cell_tags[:0],
            self.cell_groups,
            self.facets[:0],
            self.facet_tags[:0],
            self.facet_groups,
            {name: rows[:0] for name, rows in self.edge_groups.items()},
            {name: rows[:0] for name, rows in self.vertex_groups.items()},
            None if self.cell_numbers is None else self.cell_numbers[:0],
        )


def from_root(comm: MPI.Comm, build: Callable[[], MeshInput]) -> MeshInput:
    """This rank's share of an input that rank 0 holds alone. Collective.

    Args:
        comm: the ranks.
        build: makes the input; called on rank 0.

    Raises:
        Exception: whatever `build` raised, on all ranks.
    """
    share: MeshInput | None = None

    def run() -> MeshInput:
        nonlocal share
        share = build()
        return share.nothing()

    nothing = on_root(comm, run)
    return nothing if share is None else share


def untagged(
    points: npt.NDArray[np.float64], cells: IntArray, cell: str, degree: int
) -> MeshInput:
    """A share without groups; arguments as the attributes of `MeshInput`."""
    no_tags = np.zeros(len(cells), dtype=np.int32)
    no_facets = np.empty((0, _facet_width(cell)), dtype=np.int64)
    return MeshInput(cell, degree, points, cells, no_tags, {}, no_facets, no_tags[:0], {})


def create_mesh(comm: MPI.Comm, share: MeshInput) -> dolfinx.mesh.Mesh:
    """The DOLFINx mesh of the shares of all ranks. Collective.

    Raises:
        MeshError: on all ranks; coordinates are not finite, cells overlap, or lines or surfaces branch
            on several ranks.
    """
    _check_finite(comm, share.points)
    check_sharing(comm, share.cell, share.cells)
    element = basix.ufl.element(
        "Lagrange",
        share.cell,
        share.degree,
        lagrange_variant=basix.LagrangeVariant.equispaced,
        shape=(3,),
    )
    # by keyword: the order of x and e was exchanged in DOLFINx 0.10
    return dolfinx.mesh.create_mesh(
        comm=comm, cells=np.ascontiguousarray(share.cells), x=share.points, e=element
    )


def _check_finite(comm: MPI.Comm, points: npt.NDArray[np.float64]) -> None:
    """Refuse coordinates that are not finite. Collective."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    heard = comm.allgather((len(points), len(bad), int(bad[0]) if len(bad) > 0 else 0))
    if total := sum(count for _, count, _ in heard):
        rank = next(i for i, (_, count, _) in enumerate(heard) if count > 0)
        row = sum(held for held, _, _ in heard[:rank]) + heard[rank][2]
        raise MeshError(f"{total} nodes have coordinates that are not finite, the first in row {row}")


def tag_cells(mesh: dolfinx.mesh.Mesh, share: MeshInput) -> dolfinx.mesh.MeshTags:
    """Tags of the cells on the ranks that hold them. Collective."""
    tags = fetch(mesh.comm, share.cell_tags, np.asarray(mesh.topology.original_cell_index))
    tagged = np.flatnonzero(tags).astype(np.int32)
    return dolfinx.mesh.meshtags(mesh, mesh.topology.dim, tagged, tags[tagged])


def tag_facets(mesh: dolfinx.mesh.Mesh, share: MeshInput) -> dolfinx.mesh.MeshTags:
    """Tags of the facets on every rank that holds them. Collective.

    Raises:
        MeshError: on all ranks; a facet is in two groups, or is none of any cell.
    """
    dim = mesh.topology.dim - 1
    rows = np.concatenate(mesh.comm.allgather(share.facets))
    tags = np.concatenate(mesh.comm.allgather(share.facet_tags))
    rows, first, inverse = _unique_rows(rows)
    names = {tag: name for name, tag in share.facet_groups.items()}
    double = np.flatnonzero(tags != tags[first][inverse])
    if len(double) > 0:
        pair = {int(tags[double[0]]), int(tags[first][inverse][double[0]])}
        raise MeshError(
            f"{len(double)} facets are in two groups, "
            f"{' and '.join(repr(names.get(tag, tag)) for tag in sorted(pair))}; keep one"
        )
    facets, which, missing = _locate(mesh, dim, rows)
    if len(missing) > 0:
        tag = int(tags[first][missing[0]])
        raise MeshError(
            f"facet group {names.get(tag, tag)!r}: {len(missing)} of the facets in groups belong "
            "to no cell; mesh surfaces and volumes together, and group only surfaces of volumes"
        )
    return dolfinx.mesh.meshtags(mesh, dim, facets, tags[first][which])


def locate_group(
    mesh: dolfinx.mesh.Mesh, dim: int, rows: IntArray, *, name: str
) -> npt.NDArray[np.int32]:
    """The edges or vertices of one group that this rank holds. Collective.

    Args:
        mesh: the mesh.
        dim: 1 for edges, 0 for vertices.
        rows: (k, dim + 1) their vertices, as rows of the input; each rank's share.
        name: of the group.

    Returns:
        (n,) local indices, ascending, ghosts included; n may be zero.

    Raises:
        MeshError: on all ranks; the group is empty, or some of it is not in the mesh.
    """
    kind = ("vertex", "edge")[dim]
    every = _unique_rows(np.concatenate(mesh.comm.allgather(rows)))[0]
    if len(every) == 0:
        raise MeshError(f"{kind} group {name!r} is empty; mesh what it names, or leave it out")
    entities, _, missing = _locate(mesh, dim, every)
    if len(missing) > 0:
        raise MeshError(
            f"{kind} group {name!r}: {len(missing)} of {len(every)} belong to no cell; in gmsh, embed the entity in "
            "the volume or fragment both"
        )
    mesh.topology.create_connectivity(dim, mesh.topology.dim)  # what asks for their dofs needs it
    return entities


def vertex_numbers(mesh: dolfinx.mesh.Mesh) -> IntArray:
    """Row in the input of each vertex of this rank, ghosts included; not collective."""
    topology = mesh.topology
    vertices = topology.index_map(0)
    numbers = np.full(vertices.size_local + vertices.num_ghosts, -1, dtype=np.int64)
    nodes = cell_nodes(mesh)
    width = len(basix.geometry(basix.CellType[topology.cell_name()]))
    of_cells = topology.connectivity(topology.dim, 0).array.reshape(len(nodes), width)
    # a Lagrange element of basix lists the vertices first
    numbers[of_cells] = mesh.geometry.input_global_indices[nodes[:, : of_cells.shape[1]]]
    return numbers


def entity_vertices(mesh: dolfinx.mesh.Mesh, dim: int) -> IntArray:
    """Rows in the input of the vertices of each entity of this rank. Collective.

    Returns:
        (entities of this rank, vertices of one), each row ascending.
    """
    topology = mesh.topology
    numbers = vertex_numbers(mesh)
    if dim == 0:
        return numbers[:, None]
    topology.create_entities(dim)
    topology.create_connectivity(dim, 0)
    vertices = topology.connectivity(dim, 0)
    entities = topology.index_map(dim)
    count = entities.size_local + entities.num_ghosts
    # all entities of one dimension have as many vertices
    columns = len(basix.topology(basix.CellType[mesh.topology.cell_name()])[dim][0])
    return np.sort(numbers[vertices.array.reshape(count, columns)], axis=1)


def _facet_width(cell: str) -> int:
    """Number of vertices of a facet."""
    return len(basix.topology(basix.CellType[cell])[-2][0])


def _locate(
    mesh: dolfinx.mesh.Mesh, dim: int, rows: IntArray
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Find entities by their vertices. Collective.

    Args:
        mesh: the mesh.
        dim: dimension of the entities.
        rows: (k, v), each ascending and no two alike; the same on all ranks.

    Returns:
        Local indices of the entities found, ascending; the row of each; the rows that no rank has.
    """
    mine = entity_vertices(mesh, dim)
    likely = np.flatnonzero(np.isin(mine, rows).all(axis=1))
    _, inverse = np.unique(np.vstack([rows, mine[likely]]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    row_of = np.full(len(inverse), -1, dtype=np.intp)
    row_of[inverse[: len(rows)]] = np.arange(len(rows))
    row = row_of[inverse[len(rows) :]]
    entities, which = likely[row >= 0].astype(np.int32), row[row >= 0]
    found = np.zeros(len(rows), dtype=bool)
    found[which] = True
    mesh.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.LOR)
    return entities, which, np.flatnonzero(~found)


def _unique_rows(
    rows: IntArray,
) -> tuple[IntArray, npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Each row once, its vertices ascending; where it stood first; which one each row became."""
    unique, first, inverse = np.unique(
        np.sort(rows, axis=1), axis=0, return_index=True, return_inverse=True
    )
    return unique, first, inverse.reshape(-1)
