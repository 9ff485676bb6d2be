"""The shape of cells: is the map from the reference cell invertible in every one of them?"""

from __future__ import annotations

import basix
import dolfinx.mesh
import numpy as np

from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import MeshError

# Of a determinant against the product of its columns' lengths: below this, a sliver of no use.
_FLAT = 1e-6

# Cells looked at in one go, which bounds the memory.
_BATCH = 10_000


def check_cells(mesh: dolfinx.mesh.Mesh) -> None:
    """Refuse a mesh with inverted or flat cells. Collective.

    The Jacobian determinant is looked at in the nodes and in the points of a quadrature rule that
    integrates it exactly; it may be negative throughout a cell, but not change its sign or vanish.

    Args:
        mesh: three-dimensional mesh.

    Raises:
        MeshError: on all ranks; says how many cells are bad, and where the worst is.
    """
    x, nodes = mesh.geometry.x, cell_nodes(mesh)
    gradients = _reference_gradients(mesh)
    bad, worst, where = 0, np.inf, [0.0, 0.0, 0.0]
    for start in range(0, mesh.topology.index_map(3).size_local, _BATCH):
        stop = min(start + _BATCH, mesh.topology.index_map(3).size_local)
        points = x[nodes[start:stop]]
        jacobian = np.einsum("cni,kqn->cqik", points, gradients, optimize=True)
        edges = np.prod(np.linalg.norm(jacobian, axis=2), axis=2)
        # an edge without length leaves the quality at zero
        quality = np.divide(
            np.linalg.det(jacobian), edges, out=np.zeros_like(edges), where=edges > 0
        )
        quality *= np.sign(quality[:, :1])
        lowest = quality.min(axis=1)
        bad += int(np.count_nonzero(lowest <= _FLAT))
        if lowest.min() < worst:
            worst, where = lowest.min(), points[lowest.argmin()].mean(axis=0).tolist()
    total = mesh.comm.allreduce(bad)
    if total > 0:
        worst, where = min(mesh.comm.allgather((worst, where)))
        raise MeshError(
            f"{total} cells are inverted or flat (Jacobian determinant down to {worst:.2g} of a "
            f"right-angled cell's), the worst near {[round(x, 6) for x in where]} m; "
            "use smaller cells, or a geometry of degree 1"
        )


def _reference_gradients(mesh: dolfinx.mesh.Mesh) -> np.ndarray:
    """Derivatives of the geometry's shape functions, (3, points, nodes)."""
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    degree = element.degree
    points, _ = basix.make_quadrature(element.cell_type, 3 * degree)
    every = np.vstack((element.points, points))
    table: np.ndarray = element.tabulate(1, every)[1:4, :, :, 0]
    return table
