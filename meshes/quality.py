"""How good the cells of a mesh are, in one line."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.compat import cell_nodes, geometry_degree
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes.dimension import checked_part
from flexmbd.meshes.step_faces import point_text

Array = npt.NDArray[np.float64]

# Cells looked at in one go; the lattice of points in each.
_BATCH = 5_000
_LATTICE = 4

# Of a cell with all edges alike and at equal angles: determinant over the product of the edges at a corner.
_REGULAR = {"tetrahedron": np.sqrt(0.5), "hexahedron": 1.0}
_PLURAL = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}


@dataclass(frozen=True)
class MeshQuality:
    """The quality of a mesh of solid cells; `print` gives a line.

    Attributes:
        cell: "tetrahedron" or "hexahedron".
        degree: of the geometry.
        cells: how many.
        scaled_jacobian: the least Jacobian determinant in a cell over that of the straight tetrahedron with its
            corners, of a hexahedron over the mean in it: 1 where nothing is bent, 0 or less where a cell is turned
            inside out.
        shape: the least determinant of the edges at a corner over their lengths, 1 for a regular tetrahedron or a
            cube, 0 for a flat cell.
        worst: the middle of the cell of the least shape, m.
    """

    cell: str
    degree: int
    cells: int
    scaled_jacobian: float
    shape: float
    worst: tuple[float, float, float]

    def __str__(self) -> str:
        return (
            f"{self.cells} {_PLURAL[self.cell]} of degree {self.degree}: least scaled Jacobian "
            f"{self.scaled_jacobian:.3g}, least shape {self.shape:.3g} near {point_text(self.worst)} m"
        )


@checked_part
def quality(part: TaggedMesh) -> MeshQuality:
    """The quality of the cells of a solid, on all ranks. Collective.

    Args:
        part: the mesh.

    Raises:
        MeshError: on all ranks; its cells are no solids.
    """
    mesh, topology = part.mesh, part.mesh.topology
    name = topology.cell_name()
    if name not in _REGULAR:
        raise MeshError(f"the quality of a mesh is that of tetrahedra or hexahedra, not of cells of the kind {name}")
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    owned = topology.index_map(topology.dim).size_local
    nodes = cell_nodes(mesh)[:owned]
    bent, shape, worst = np.inf, np.inf, (0.0, 0.0, 0.0)
    for start in range(0, owned, _BATCH):
        x = mesh.geometry.x[nodes[start : start + _BATCH]]
        bent = min(bent, float(_scaled_jacobians(x, element, name).min()))
        shapes = _shapes(x, element, name)
        if shapes.min() < shape:
            shape = float(shapes.min())
            a, b, c = x[shapes.argmin()].mean(axis=0).tolist()
            worst = (a, b, c)
    heard = mesh.comm.allgather((shape, bent, worst))
    total = topology.index_map(topology.dim).size_global
    least = min(heard)
    return MeshQuality(name, geometry_degree(mesh), total, min(one[1] for one in heard), least[0], least[2])


def _scaled_jacobians(x: Array, element: basix.finite_element.FiniteElement, name: str) -> Array:
    lattice = basix.create_lattice(element.cell_type, _LATTICE, basix.LatticeType.equispaced, True)
    found = np.linalg.det(_jacobians(x, element, lattice))
    if name == "tetrahedron":
        whole = np.linalg.det(x[:, 1:4] - x[:, :1])
    else:
        inner, weights = basix.make_quadrature(element.cell_type, 3 * element.degree)
        whole = np.linalg.det(_jacobians(x, element, inner)) @ weights
    ratio: Array = (found / whole[:, None]).min(axis=1)
    return ratio


def _shapes(x: Array, element: basix.finite_element.FiniteElement, name: str) -> Array:
    """Of each cell the least determinant of the tangents along the edges at a corner over their lengths."""
    corners = basix.geometry(element.cell_type)
    edges = basix.topology(element.cell_type)[1]
    jacobian = _jacobians(x, element, corners)
    found = np.empty((len(x), len(corners)))
    for i, corner in enumerate(corners):
        ends = [corners[b if a == i else a] for a, b in edges if i in (a, b)]
        directions = np.stack([end - corner for end in ends], axis=1)
        tangents = jacobian[:, i] @ directions
        lengths = np.prod(np.linalg.norm(tangents, axis=1), axis=1)
        found[:, i] = np.sign(np.linalg.det(directions)) * np.linalg.det(tangents) / lengths
    # cells may be numbered the other way round throughout
    found *= np.sign(found.sum(axis=1, keepdims=True))
    least: Array = found.min(axis=1) / _REGULAR[name]
    return least


def _jacobians(x: Array, element: basix.finite_element.FiniteElement, points: Array) -> Array:
    """(cells, points, 3, 3)."""
    found: Array = np.einsum("cni,kqn->cqik", x, element.tabulate(1, points)[1:, :, :, 0], optimize=True)
    return found
