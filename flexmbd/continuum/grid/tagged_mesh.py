"""A DOLFINx mesh together with the names of its groups of facets and cells."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from mpi4py import MPI

import dolfinx.mesh
import dolfinx.plot
import numpy as np
import numpy.typing as npt

from flexmbd.brief import brief
from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.cell_shape import check_cells
from flexmbd.continuum.grid.mesh_input import (
    MeshInput,
    create_mesh,
    from_root,
    locate_group,
    tag_cells,
    tag_facets,
    untagged,
)
from flexmbd.continuum.grid.node_order import NODES, NodeOrder, node_permutation
from flexmbd.continuum.grid.pieces import check_connected
from flexmbd.continuum.grid.predicate import Predicate, locate_groups
from flexmbd.continuum.grid.row_exchange import blocks_on_root, send
from flexmbd.errors import MeshError, PictureError
from flexmbd.given import checked, numbers

Points = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
T = TypeVar("T")


@dataclass(frozen=True)
class TaggedMesh:
    """A mesh whose groups have names, as gmsh's physical groups do.

    A solid has cells of dimension 3, a shell 2, a line 1, all in space. Facets are the entities one
    dimension below the cells: the edges of a shell, the points of a line. A node is identified, on
    any number of ranks, by its row in the input: `mesh.geometry.input_global_indices`.

    Attributes:
        mesh: the DOLFINx mesh; coordinates in m.
        facet_tags: tags of facets; a facet is in one group at most.
        facet_groups: tag of each named group of facets, the same on all ranks.
        cell_tags: tags of cells; a cell is in one group at most.
        cell_groups: tag of each named group of cells, the same on all ranks.
        edge_groups: of a solid, by name the edges (n,) that this rank holds, as `edges` gives them;
            the names are the same on all ranks, and an edge may be in several groups.
        vertex_groups: of a solid or a shell, by name the vertices, likewise.
        in_pieces: whether it may fall into pieces that share no facet, which welds of a model join (`meshes.join`).
    """

    mesh: dolfinx.mesh.Mesh
    facet_tags: dolfinx.mesh.MeshTags
    facet_groups: Mapping[str, int]
    cell_tags: dolfinx.mesh.MeshTags
    cell_groups: Mapping[str, int] = field(default_factory=dict)
    edge_groups: Mapping[str, Indices] = field(default_factory=dict)
    vertex_groups: Mapping[str, Indices] = field(default_factory=dict)
    in_pieces: bool = False

    __repr__ = brief

    @property
    def comm(self) -> MPI.Comm:
        """The communicator the mesh is spread over."""
        return self.mesh.comm

    @property
    def dim(self) -> int:
        """Dimension of the cells: 3 for a solid, 2 for a shell, 1 for a line."""
        return int(self.mesh.topology.dim)

    @checked(error=MeshError)
    def cells(self, name: str) -> Indices:
        """Cells of a named group, as indices local to this rank; not collective.

        Args:
            name: a key of `cell_groups`.

        Returns:
            (n,) indices, ascending, ghosts included; n may be zero on some ranks.

        Raises:
            MeshError: there is no such group; raised on every rank that asks.
        """
        return self.cell_tags.find(_known("cell", self.cell_groups, name))

    @checked(error=MeshError)
    def facets(self, name: str) -> Indices:
        """Facets of a named group, as indices local to this rank; not collective.

        Args:
            name: a key of `facet_groups`.

        Returns:
            (n,) indices, ascending; a facet on the border of two ranks is in both of them, and n
            may be zero on some ranks.

        Raises:
            MeshError: there is no such group; raised on every rank that asks.
        """
        return self.facet_tags.find(_known("facet", self.facet_groups, name))

    @checked(error=MeshError)
    def edges(self, name: str) -> Indices:
        """Edges of a named group, as indices local to this rank; not collective.

        Args:
            name: a key of `edge_groups`; of a shell, of `facet_groups`.

        Returns:
            (n,) indices of mesh entities of dimension 1, ascending. Every rank that holds an edge
            has it, its owner or not; n may be zero on some ranks.

        Raises:
            MeshError: there is no such group; raised on every rank that asks.
        """
        if self.dim == 2:
            return self.facets(name)
        return _known("edge", self.edge_groups, name)

    @checked(error=MeshError)
    def vertices(self, name: str) -> Indices:
        """Vertices of a named group, as indices local to this rank; not collective.

        Args:
            name: a key of `vertex_groups`; of a line, of `facet_groups`.

        Returns:
            (n,) indices of mesh entities of dimension 0, ascending. Every rank that holds a vertex
            has it, its owner or not; n may be zero on some ranks.

        Raises:
            MeshError: there is no such group; raised on every rank that asks.
        """
        if self.dim == 1:
            return self.facets(name)
        return _known("vertex", self.vertex_groups, name)

    def to_pyvista(self) -> Any:
        """This rank's cells as a pyvista.UnstructuredGrid (m), with their tags as "group", 0 for none. Not collective.

        Raises:
            PictureError: pyvista is not installed.
        """
        try:
            import pyvista
        except ImportError as reason:
            raise PictureError(f"a mesh for pyvista needs it: pip install 'flexmbd[pictures]' ({reason})") from reason
        grid = pyvista.UnstructuredGrid(*dolfinx.plot.vtk_mesh(self.mesh))
        tags = np.zeros(grid.n_cells, dtype=np.int32)
        here = self.cell_tags.indices < grid.n_cells  # ghosts come last
        tags[self.cell_tags.indices[here]] = self.cell_tags.values[here]
        grid.cell_data["group"] = tags
        return grid

    def fingerprint(self) -> str:
        """SHA-256 of nodes and cells, hexadecimal; independent of the partition. Collective.

        Nodes are taken in the order of the input; cells as rows of input node numbers, sorted.
        """
        geometry, comm = self.mesh.geometry, self.comm
        n_nodes = geometry.index_map().size_local
        n_cells = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        numbers = geometry.input_global_indices
        total = comm.allreduce(int(numbers.max(initial=-1)), op=MPI.MAX) + 1
        # rank 0 holds no more than one rank's share at a time
        nodes, points = send(comm, numbers[:n_nodes], geometry.x[:n_nodes], total=total)
        order = np.argsort(nodes)
        rows = numbers[cell_nodes(self.mesh)[:n_cells]]
        cells = send(comm, rows[:, 0], rows, total=total)[1]
        cells = cells[np.lexsort(cells.T[::-1])]
        digest = hashlib.sha256()
        for part in (nodes[order].astype("<i8"), points[order].astype("<f8"), cells.astype("<i8")):
            for block in blocks_on_root(comm, part):
                digest.update(block.tobytes())
        return parallel.on_root(comm, digest.hexdigest)


def spread(comm: MPI.Comm, share: MeshInput, *, in_pieces: bool = False) -> TaggedMesh:
    """Spread an input over the ranks, and check the mesh. Collective.

    Args:
        comm: the communicator of the mesh.
        share: what this rank holds of the input; where rank 0 holds all, from `from_root`.
        in_pieces: whether it may fall into pieces that share no facet.

    Raises:
        MeshError: on all ranks; cells are inverted or flat, the mesh falls into pieces, or a group
            is empty, not in the mesh, or shares facets with another.
    """
    mesh = create_mesh(comm, share)
    check_cells(mesh, numbers=share.cell_numbers)
    if not in_pieces:
        check_connected(mesh)
    return TaggedMesh(
        mesh,
        tag_facets(mesh, share),
        share.facet_groups,
        tag_cells(mesh, share),
        share.cell_groups,
        {n: locate_group(mesh, 1, rows, name=n) for n, rows in share.edge_groups.items()},
        {n: locate_group(mesh, 0, rows, name=n) for n, rows in share.vertex_groups.items()},
        in_pieces,
    )


@checked(but=("points", "cells"), error=MeshError, agree=parallel.told_to_all)
def from_arrays(
    comm: MPI.Comm,
    points: npt.ArrayLike | None,
    cells: npt.ArrayLike | None,
    *,
    cell: str = "tetrahedron",
    degree: int = 2,
    order: NodeOrder = NodeOrder.LEXICOGRAPHIC,
    facet_groups: Mapping[str, Predicate],
    cell_groups: Mapping[str, Predicate] | None = None,
    edge_groups: Mapping[str, Predicate] | None = None,
    vertex_groups: Mapping[str, Predicate] | None = None,
) -> TaggedMesh:
    """Make a mesh from arrays on rank 0. Collective.

    A group is given by a function of points (3, n) that says which lie in it (n,); an entity belongs
    to it when all its vertices do. The groups are the same on all ranks.

    Args:
        comm: the communicator to spread the mesh over.
        points: (n, 3) coordinates, m; read on rank 0 only.
        cells: (m, k) rows of `points`; read on rank 0 only.
        cell: "tetrahedron" (k = 4 or 10), "hexahedron" (8 or 27), "triangle" (3 or 6),
            "quadrilateral" (4 or 9) or "interval" (2 or 3).
        degree: 1 or 2, the degree of the geometry.
        order: how the k nodes are listed; LEXICOGRAPHIC with hexahedra or quadrilaterals of degree
            2 is refused.
        facet_groups: of facets on the boundary.
        cell_groups: of cells.
        edge_groups: of edges of a solid.
        vertex_groups: of vertices of a solid or a shell.

    Raises:
        MeshError: on all ranks; the arrays do not fit, cells are bad, the mesh falls into pieces, a
            group is empty, its function fails, two groups of facets or of cells overlap, or the cell,
            its degree, the order or the names of groups are not the same on all ranks.
    """
    groups = (facet_groups, cell_groups or {}, edge_groups or {}, vertex_groups or {})
    _check_agreement(comm, f"cell={cell!r}, degree={degree}, {order}, groups {[*map(list, groups)]}")
    columns = NODES.get((cell, degree))
    if columns is None:
        known = ", ".join(f"{name} of degree {d}" for name, d in NODES)
        raise MeshError(f"no cell {cell!r} of degree {degree!r}; there are: {known}")
    mesh = _spread(comm, points, cells, cell=cell, degree=degree, order=order, columns=columns)
    check_cells(mesh)
    check_connected(mesh)
    dim = mesh.topology.dim
    facets, volumes, edges, vertices = (
        locate_groups(mesh, below, chosen, kind=kind)
        for chosen, below, kind in zip(
            groups, (dim - 1, dim, 1, 0), ("facet", "cell", "edge", "vertex"), strict=True
        )
    )
    for below, found in ((dim, volumes), (1, edges), (0, vertices)):
        if found:
            mesh.topology.create_connectivity(below, dim)  # what asks for the dofs needs it
    return TaggedMesh(
        mesh,
        *_tags(mesh, dim - 1, facets),
        *_tags(mesh, dim, volumes),
        edges,
        vertices,
    )


def _check_agreement(comm: MPI.Comm, described: str) -> None:
    """Refuse arguments that differ between ranks. Collective."""
    heard = comm.allgather(described)
    for rank, other in enumerate(heard):
        if other != heard[0]:
            raise MeshError(
                f"rank 0 was given {heard[0]}, and rank {rank} {other}; give the same on all ranks"
            )


def _tags(
    mesh: dolfinx.mesh.Mesh, dim: int, found: Mapping[str, Indices]
) -> tuple[dolfinx.mesh.MeshTags, dict[str, int]]:
    """Tags of groups that do not overlap, numbered from 1, and the numbers."""
    indices = np.concatenate([np.empty(0, np.int32), *found.values()])
    values = np.repeat(
        np.arange(1, len(found) + 1, dtype=np.int32), [len(part) for part in found.values()]
    )
    ascending = np.argsort(indices)
    tags = dolfinx.mesh.meshtags(mesh, dim, indices[ascending], values[ascending])
    return tags, {name: tag for tag, name in enumerate(found, start=1)}


def _known(kind: str, groups: Mapping[str, T], name: str) -> T:
    if name not in groups:
        there = ", ".join(repr(known) for known in sorted(groups)) or "none"
        raise MeshError(f"the mesh has no {kind} group {name!r}; its {kind} groups are: {there}")
    return groups[name]


def _spread(
    comm: MPI.Comm,
    points: npt.ArrayLike | None,
    cells: npt.ArrayLike | None,
    *,
    cell: str,
    degree: int,
    order: NodeOrder,
    columns: int,
) -> dolfinx.mesh.Mesh:
    """The DOLFINx mesh of rank 0's arrays."""

    def build() -> MeshInput:
        x, rows = _checked(points, cells, columns=columns)
        return untagged(x, rows[:, node_permutation(cell, degree, order)], cell, degree)

    return create_mesh(comm, from_root(comm, build))


def _checked(points: Any, cells: Any, *, columns: int) -> tuple[Points, npt.NDArray[np.int64]]:
    x: Any = np.ascontiguousarray(numbers(points))
    try:
        rows: Any = np.asarray(cells)
    except ValueError:  # rows of several lengths
        rows = np.array(np.nan)
    if x.ndim != 2 or x.shape[1] != 3:
        raise MeshError(f"points must have shape (n, 3), got {x.shape}")
    if not np.isfinite(x).all():
        raise MeshError("points holds values that are not finite")
    if rows.ndim != 2 or rows.shape[1] != columns or not np.issubdtype(rows.dtype, np.integer):
        raise MeshError(
            f"cells must be whole numbers of shape (m, {columns}), got {rows.dtype} {rows.shape}"
        )
    if len(rows) == 0 or rows.min() < 0 or rows.max() >= len(x):
        raise MeshError(f"cells must name at least one cell, by rows of points, 0 to {len(x) - 1}")
    return x, rows.astype(np.int64)
