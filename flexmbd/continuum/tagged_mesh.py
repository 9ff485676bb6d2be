"""A DOLFINx mesh together with the names of its groups of facets and cells."""

from __future__ import annotations

import enum
import hashlib
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.continuum.cell_shape import check_cells
from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import MeshError

Points = npt.NDArray[np.float64]
Predicate = Callable[[Points], npt.NDArray[np.bool_]]


class NodeOrder(enum.Enum):
    """How the nodes of one cell are listed in an array of cells.

    LEXICOGRAPHIC: tetrahedra: four vertices, then the middles of the edges 01, 02, 03, 12, 13, 23.
        Hexahedra: x fastest, z slowest, so that vertex i + 2 j + 4 k lies at (i, j, k).
    VTK: tetrahedra: middles of 01, 12, 02, 03, 13, 23. Hexahedra: around the bottom face, then
        around the top face; then VTK's own order of the further nodes.
    GMSH: tetrahedra: middles of 01, 12, 02, 03, 23, 13. Hexahedra: vertices as in VTK; then gmsh's
        own order of the further nodes.
    """

    LEXICOGRAPHIC = enum.auto()
    VTK = enum.auto()
    GMSH = enum.auto()


@dataclass(frozen=True)
class TaggedMesh:
    """A mesh whose groups of facets and cells have names, as gmsh's physical groups do.

    A node is identified, on any number of ranks, by its row in the input:
    `mesh.geometry.input_global_indices`.

    Attributes:
        mesh: the DOLFINx mesh; coordinates in m.
        facet_tags: tags of facets; a facet is in one group at most.
        facet_groups: tag of each named group of facets, the same on all ranks.
        cell_tags: tags of cells.
        cell_groups: tag of each named group of cells, the same on all ranks.
    """

    mesh: dolfinx.mesh.Mesh
    facet_tags: dolfinx.mesh.MeshTags
    facet_groups: Mapping[str, int]
    cell_tags: dolfinx.mesh.MeshTags
    cell_groups: Mapping[str, int] = field(default_factory=dict)

    @property
    def comm(self) -> MPI.Comm:
        """The communicator the mesh is spread over."""
        return self.mesh.comm

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Facets of a named group, as indices local to this rank; not collective.

        Args:
            name: a key of `facet_groups`.

        Returns:
            (n,) indices, ascending; n may be zero on some ranks.

        Raises:
            MeshError: there is no such group; raised on every rank that asks.
        """
        if name not in self.facet_groups:
            there = ", ".join(repr(known) for known in sorted(self.facet_groups)) or "none"
            raise MeshError(f"the mesh has no facet group {name!r}; its facet groups are: {there}")
        return self.facet_tags.find(self.facet_groups[name])

    def fingerprint(self) -> str:
        """SHA-256 of nodes and cells, hexadecimal; independent of the partition. Collective.

        Nodes are taken in the order of the input; cells as rows of input node numbers, sorted.
        """
        geometry = self.mesh.geometry
        n_nodes = geometry.index_map().size_local
        n_cells = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        numbers = geometry.input_global_indices
        nodes = parallel.gather_rows(self.comm, numbers[:n_nodes])
        points = parallel.gather_rows(self.comm, geometry.x[:n_nodes])
        cells = parallel.gather_rows(self.comm, numbers[cell_nodes(self.mesh)[:n_cells]])

        return parallel.on_root(self.comm, lambda: _digest(nodes, points, cells))


def from_arrays(
    comm: MPI.Comm,
    points: npt.ArrayLike | None,
    cells: npt.ArrayLike | None,
    *,
    cell: str = "tetrahedron",
    degree: int = 2,
    order: NodeOrder = NodeOrder.LEXICOGRAPHIC,
    facet_groups: Mapping[str, Predicate],
) -> TaggedMesh:
    """Make a mesh from arrays on rank 0. Collective.

    Args:
        comm: the communicator to spread the mesh over.
        points: (n, 3) coordinates, m; read on rank 0 only.
        cells: (m, k) rows of `points`; read on rank 0 only.
        cell: "tetrahedron" (k = 4 or 10) or "hexahedron" (k = 8 or 27).
        degree: 1 or 2, the degree of the geometry.
        order: how the k nodes are listed; LEXICOGRAPHIC with 27-node hexahedra is refused.
        facet_groups: by name, a function of points (3, n) that says which lie in the group (n,); a
            boundary facet belongs to it when all its vertices do. The same on all ranks.

    Raises:
        MeshError: on all ranks; the arrays do not fit, cells are bad, a group has no facets, or two
            groups share one.
    """
    columns = _NODES.get((cell, degree))
    if columns is None:
        known = ", ".join(f"{name} of degree {d}" for name, d in _NODES)
        raise MeshError(f"no cell {cell!r} of degree {degree!r}; there are: {known}")
    domain = _spread(comm, points, cells, cell=cell, degree=degree, order=order, columns=columns)
    check_cells(domain)
    found = {
        name: dolfinx.mesh.locate_entities_boundary(domain, 2, predicate)
        for name, predicate in facet_groups.items()
    }
    _check_groups(comm, found)
    indices = np.concatenate([np.empty(0, np.int32), *found.values()])
    values = np.repeat(
        np.arange(1, len(found) + 1, dtype=np.int32), [len(facets) for facets in found.values()]
    )
    ascending = np.argsort(indices)
    none = np.empty(0, np.int32)
    return TaggedMesh(
        domain,
        dolfinx.mesh.meshtags(domain, 2, indices[ascending], values[ascending]),
        {name: tag for tag, name in enumerate(found, start=1)},
        dolfinx.mesh.meshtags(domain, 3, none, none),
    )


def _digest(nodes: Any, points: Any, cells: Any) -> str:
    order = np.argsort(nodes)
    rows = cells[np.lexsort(cells.T[::-1])]
    parts = (nodes[order].astype("<i8"), points[order].astype("<f8"), rows.astype("<i8"))
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


_NODES = {
    ("tetrahedron", 1): 4,
    ("tetrahedron", 2): 10,
    ("hexahedron", 1): 8,
    ("hexahedron", 2): 27,
}

# basix lists a tetrahedron's edges as 23, 13, 12, 03, 02, 01 and a hexahedron's vertices x fastest:
# row i says where basix's node i stands in the lexicographic list.
_FROM_LEXICOGRAPHIC = {
    ("tetrahedron", 1): (0, 1, 2, 3),
    ("tetrahedron", 2): (0, 1, 2, 3, 9, 8, 7, 6, 5, 4),
    ("hexahedron", 1): (0, 1, 2, 3, 4, 5, 6, 7),
}


def _permutation(cell: str, degree: int, order: NodeOrder) -> npt.NDArray[np.intp]:
    """Where each of basix's nodes stands in a cell listed in the given order."""
    if order is NodeOrder.LEXICOGRAPHIC:
        if (cell, degree) not in _FROM_LEXICOGRAPHIC:
            raise MeshError(
                f"{cell} of degree {degree} needs order=NodeOrder.VTK or NodeOrder.GMSH"
            )
        return np.array(_FROM_LEXICOGRAPHIC[cell, degree])
    tables = dolfinx.cpp.io
    table = tables.perm_vtk if order is NodeOrder.VTK else tables.perm_gmsh
    return np.asarray(table(dolfinx.mesh.to_type(cell), _NODES[cell, degree]), dtype=np.intp)


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
    x: Points = np.empty((0, 3))
    rows: npt.NDArray[np.int64] = np.empty((0, columns), dtype=np.int64)
    error: Exception | None = None
    if comm.rank == 0:
        try:
            x, rows = _checked(points, cells, columns=columns)
            rows = rows[:, _permutation(cell, degree, order)]
        except MeshError as caught:
            error = caught
    parallel.raise_collectively(comm, error)
    element = basix.ufl.element(
        "Lagrange",
        cell,
        degree,
        lagrange_variant=basix.LagrangeVariant.equispaced,
        shape=(3,),
    )
    # by keyword: the order of x and e was exchanged in DOLFINx 0.10
    return dolfinx.mesh.create_mesh(comm=comm, cells=np.ascontiguousarray(rows), x=x, e=element)


def _checked(points: Any, cells: Any, *, columns: int) -> tuple[Points, npt.NDArray[np.int64]]:
    x: Any = np.ascontiguousarray(points, dtype=np.float64)
    rows: Any = np.asarray(cells)
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


def _check_groups(comm: MPI.Comm, found: Mapping[str, npt.NDArray[np.int32]]) -> None:
    """Refuse groups without a facet on any rank, and groups that share one."""
    faults = []
    for name, facets in found.items():
        if comm.allreduce(len(facets)) == 0:
            faults.append(
                f"facet group {name!r}: no boundary facet lies in it; check its predicate"
            )
    for name, other in itertools.combinations(found, 2):
        if len(np.intersect1d(found[name], found[other])) > 0:
            faults.append(f"facet groups {name!r} and {other!r} share facets")
    error = MeshError("; ".join(faults)) if faults else None
    parallel.raise_collectively(comm, error)
