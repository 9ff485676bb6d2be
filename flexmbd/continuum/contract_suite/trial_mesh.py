"""Small meshes that the contract is tried on: the unit interval, square and cube, even or distorted."""

from __future__ import annotations

import enum

from mpi4py import MPI

import basix
import basix.ufl
import dolfinx.mesh
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh

FloatArray = npt.NDArray[np.float64]

DIMENSION = {"interval": 1, "triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
"""Topological dimension of each cell a formulation may have."""

SURFACE = "surface"
"""The facet group of `tagged`."""

# Of a unit length: cells stay well shaped, and none stays a parallelepiped.
_AMPLITUDE = 0.08

# By which nodes of trapezoids alternate, of the length of a cell.
_ZIGZAG = 0.25


class Family(enum.Enum):
    """Meshes of the unit interval, square or cube, by the shape of their cells; all fill it exactly."""

    REGULAR = "regular"
    DISTORTED = "distorted"  # moved by a smooth map: no two cells alike
    TRAPEZOIDAL = "trapezoidal"  # never nearer to parallelograms, however fine (Arnold, Boffi & Falk 2002)
    CURVED = "curved"  # moved by a smooth map, of degree 2


def family_mesh(cell: str, family: Family, *, n: int, layered: bool = False) -> dolfinx.mesh.Mesh:
    """A mesh of a family in n parts along each edge; layered: third edges stay straight and across.

    On this rank alone; not collective.
    """
    points, cells = _even(cell, n)
    dim = DIMENSION[cell]
    if family is Family.CURVED:
        straight = _make(MPI.COMM_SELF, points, cells, cell=cell)
        nodes = fem.functionspace(straight, _nodes(cell, 2))
        points, cells = nodes.tabulate_dof_coordinates(), nodes.dofmap.list.astype(np.int64)
        return _make(MPI.COMM_SELF, _moved_inside(points, dim, layered), cells, cell=cell, degree=2)
    if family is Family.DISTORTED:
        points = _moved_inside(points, dim, layered)
    elif family is Family.TRAPEZOIDAL:
        points = _zigzag(points, dim, n)
    return _make(MPI.COMM_SELF, points, cells, cell=cell)


def bar_mesh(cell: str, *, n: int, thickness: float) -> dolfinx.mesh.Mesh:
    """A bar of 1 m along x, its square section about the x axis of one cell, n cells long. On this rank alone."""
    kind = dolfinx.mesh.to_type(cell)
    mesh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, n, 1, 1, kind)
    points = (mesh.geometry.x - (0.0, 0.5, 0.5)) * (1.0, thickness, thickness)
    return _make(MPI.COMM_SELF, points, cell_nodes(mesh).astype(np.int64), cell=cell)


def single_cell(cell: str, *, distorted: bool, layered: bool = False) -> dolfinx.mesh.Mesh:
    """One cell with edges of 1 m along the axes, or moved by the map of `distorted_mesh`. On this rank alone."""
    points = basix.geometry(basix.CellType[cell])
    dim = DIMENSION[cell]
    points = np.hstack([points, np.zeros((len(points), 3 - dim))])
    if distorted:
        points = _moved(points, dim, layered)
    return _make(MPI.COMM_SELF, points, np.arange(len(points), dtype=np.int64)[None], cell=cell)


def even_mesh(cell: str, *, n: int) -> dolfinx.mesh.Mesh:
    """The unit interval of the x axis, square of z = 0, or cube, in n parts along each edge.

    On this rank alone; not collective.
    """
    return _make(MPI.COMM_SELF, *_even(cell, n), cell=cell)


def distorted_mesh(
    cell: str, *, n: int, degree: int = 1, layered: bool = False, comm: MPI.Comm = MPI.COMM_SELF
) -> dolfinx.mesh.Mesh:
    """The same moved by a smooth map: straight edges, no two cells alike. Collective over `comm`.

    Layered: third edges stay straight and across the layers, and no two cells of a layer are alike.
    Of degree 2 it has nodes in the middle of its edges (and faces and cells), and is the same mesh.
    """
    points, cells = _even(cell, n)
    points = _moved(points, DIMENSION[cell], layered)
    if degree > 1:
        straight = _make(MPI.COMM_SELF, points, cells, cell=cell)
        nodes = fem.functionspace(straight, _nodes(cell, degree))
        points, cells = nodes.tabulate_dof_coordinates(), nodes.dofmap.list.astype(np.int64)
    return _make(comm, points, cells, cell=cell, degree=degree)


def tagged(mesh: dolfinx.mesh.Mesh) -> TaggedMesh:
    """The mesh with one group, of the facets of its surface: "surface"; collective where the mesh is."""
    none = np.empty(0, dtype=np.int32)
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    outer = np.sort(dolfinx.mesh.exterior_facet_indices(mesh.topology)).astype(np.int32)
    facets = dolfinx.mesh.meshtags(mesh, dim - 1, outer, np.ones(len(outer), dtype=np.int32))
    return TaggedMesh(mesh, facets, {SURFACE: 1}, dolfinx.mesh.meshtags(mesh, dim, none, none))


def _even(cell: str, n: int) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    dim, kind = DIMENSION[cell], dolfinx.mesh.to_type(cell)
    if dim == 1:
        mesh = dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, n)
    elif dim == 2:
        mesh = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, n, n, kind)
    else:
        mesh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, n, n, n, kind)
    return mesh.geometry.x.copy(), cell_nodes(mesh).astype(np.int64)


def _moved(x: FloatArray, dim: int, layered: bool) -> FloatArray:
    """Moved along the axes that the mesh spans, so that it, or each of its layers, stays straight or flat."""
    if dim == 1:
        # the cells of a line differ in length; its ends stay
        shift = 2 * np.sin(np.pi * x)
    else:
        place = x * (1.0, 1.0, 0.0) if layered else x
        s, c = np.sin(2 * place + 0.3), np.cos(3 * place)
        shift = np.stack(
            (s[:, 1] * c[:, 2], s[:, 2] * c[:, 0] + x[:, 1] ** 2, s[:, 0] * c[:, 1]), axis=1
        )
    shift[:, dim:] = 0.0
    if layered:
        shift[:, 2] = np.sin(2 * x[:, 2])
    moved: FloatArray = x + _AMPLITUDE * shift
    return moved


def _moved_inside(x: FloatArray, dim: int, layered: bool) -> FloatArray:
    """Moved by a smooth map that leaves each face of the cube in its plane."""
    along = np.sin(np.pi * x)
    if dim == 1:
        shift = 2 * along
    else:
        a, b, c = (x * (1.0, 1.0, 0.0)).T if layered else x.T
        across = np.stack((np.cos(2 * b + c), np.sin(3 * a + 0.5), np.cos(3 * a * b)), axis=1)
        shift = along * across
        if layered:
            shift[:, 2] = along[:, 2]
    shift[:, dim:] = 0.0
    moved: FloatArray = x + _AMPLITUDE * shift
    return moved


def _zigzag(x: FloatArray, dim: int, n: int) -> FloatArray:
    """Each row of nodes alternates along the next axis; of a line its nodes alternate along it."""
    place = np.rint(n * x).astype(int)
    axis = min(dim - 1, 1)
    inside = (place[:, axis] > 0) & (place[:, axis] < n)
    moved = x.copy()
    moved[:, axis] += np.where(inside, _ZIGZAG / n * (-1.0) ** place[:, : axis + 1].sum(axis=1), 0.0)
    return moved


def _make(
    comm: MPI.Comm, points: FloatArray, cells: npt.NDArray[np.int64], *, cell: str, degree: int = 1
) -> dolfinx.mesh.Mesh:
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    return dolfinx.mesh.create_mesh(comm=comm, cells=cells, x=points, e=_nodes(cell, degree))


def _nodes(cell: str, degree: int) -> basix.ufl._ElementBase:
    variant = basix.LagrangeVariant.equispaced
    return basix.ufl.element("Lagrange", cell, degree, lagrange_variant=variant, shape=(3,))
