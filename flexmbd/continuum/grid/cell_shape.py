"""The shape of cells: is the map from the reference cell invertible in every one of them?"""

from __future__ import annotations

import basix
import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.row_exchange import fetch
from flexmbd.errors import MeshError

Array = npt.NDArray[np.float64]

# Of a determinant against the product of its columns' lengths: below this, a sliver of no use.
_FLAT = 1e-6

# Cells looked at in one go, which bounds the memory.
_BATCH = 10_000


def check_cells(
    mesh: dolfinx.mesh.Mesh, *, numbers: npt.NDArray[np.int64] | None = None
) -> None:
    """Refuse a mesh with inverted or flat cells. Collective.

    The Jacobian determinant is looked at in the nodes and in the points of a quadrature rule that
    integrates it exactly; it may be negative throughout a cell, but not change its sign or vanish.
    In a surface the part of the normal along the normal at the first node takes its place, in a line
    that of the tangent.

    Args:
        mesh: of dimension 1, 2 or 3 in space.
        numbers: this rank's share of what the cells of the input are called; None for their rows.

    Raises:
        MeshError: on all ranks; says how many cells are bad, which is the worst, and where it is.
    """
    x, nodes = mesh.geometry.x, cell_nodes(mesh)
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    bad, worst, cell, where = 0, np.inf, 0, [0.0, 0.0, 0.0]
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    for start in range(0, owned, _BATCH):
        points = x[nodes[start : min(start + _BATCH, owned)]]
        lowest = cell_quality(points, element)
        bad += int(np.count_nonzero(lowest <= _FLAT))
        if lowest.min() < worst:
            worst, cell = lowest.min(), start + int(lowest.argmin())
            where = points[lowest.argmin()].mean(axis=0).tolist()
    total = mesh.comm.allreduce(bad)
    if total > 0:
        mine = np.asarray(mesh.topology.original_cell_index)[cell : cell + 1]
        names = mine if numbers is None else fetch(mesh.comm, numbers, mine)
        called = int(names[0]) if len(names) > 0 else -1
        worst, called, where = min(mesh.comm.allgather((worst, called, where)))
        what = f"row {called} of the input" if numbers is None else f"number {called}"
        raise MeshError(
            f"{total} cells are inverted or flat (Jacobian determinant down to {worst:.2g} of a "
            f"right-angled cell's), the worst, {what}, near {[float(f'{x:.6g}') for x in where]} m; "
            "use smaller cells, or a geometry of degree 1"
        )


def cell_quality(points: Array, element: basix.finite_element.FiniteElement) -> Array:
    """The lowest measure of each cell against a right-angled one's with edges as long, (cells,).

    Args:
        points: (cells, nodes, 3) in the element's order, m.
        element: of basix, of dimension 1, 2 or 3.
    """
    jacobian = np.einsum("cni,kqn->cqik", points, _reference_gradients(element), optimize=True)
    lowest: Array = _quality(jacobian).min(axis=1)
    return lowest


def _quality(jacobian: Array) -> Array:
    """Measure of the cells against a right-angled one's with edges as long, (cells, points).

    Args:
        jacobian: (cells, points, 3, dimension of the cells).
    """
    lengths = np.linalg.norm(jacobian, axis=2)
    dim = jacobian.shape[3]
    if dim == 3:
        measure, scale = np.linalg.det(jacobian), np.prod(lengths, axis=2)
        measure *= np.sign(measure[:, :1])
    else:
        vector = np.cross(*np.moveaxis(jacobian, 3, 0)) if dim == 2 else jacobian[..., 0]
        size = np.linalg.norm(vector[:, :1], axis=2, keepdims=True)
        first = np.divide(vector[:, :1], size, out=np.zeros_like(vector[:, :1]), where=size > 0)
        measure = np.einsum("cqi,cqi->cq", vector, np.broadcast_to(first, vector.shape))
        scale = np.prod(lengths, axis=2)
        if dim == 1:  # against itself it would always be one
            scale = np.broadcast_to(scale.max(axis=1, keepdims=True), scale.shape)
    # an edge without length leaves the quality at zero
    quality: Array = np.divide(measure, scale, out=np.zeros_like(scale), where=scale > 0)
    return quality


def _reference_gradients(element: basix.finite_element.FiniteElement) -> Array:
    """Derivatives of the shape functions, (dimension of the cells, points, nodes)."""
    points, _ = basix.make_quadrature(element.cell_type, 3 * element.degree)
    every = np.vstack((element.points, points))
    table: Array = element.tabulate(1, every)[1:, :, :, 0]
    return table
