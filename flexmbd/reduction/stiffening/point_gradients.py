"""Gradients of displacements in the points of a quadrature rule, as dense blocks over chunks of cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import basix
import basix.ufl
import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.contract.formulation import Quadrature
from flexmbd.continuum.contract.quadrature import points_and_weights

if TYPE_CHECKING:
    from flexmbd.continuum.finite_elements.linear_model import LinearModel

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RulePoints:
    """The points of a rule in some cells.

    Attributes:
        model: the body.
        cells: (k,) cells that this rank owns.
        rule: of the points.
    """

    model: LinearModel
    cells: NDArray[np.int32]
    rule: Quadrature

    @property
    def reference(self) -> tuple[FloatArray, FloatArray]:
        """Places (q, 3) and weights (q,) on the reference cell."""
        return points_and_weights(cell_type(self.model.space).name, self.rule)


def by_node(block: FloatArray) -> FloatArray:
    """(nodes, 3, k) of a block (dofs, k), its columns together in memory."""
    return np.ascontiguousarray(block).reshape(len(block) // 3, 3, block.shape[1])


def field_gradients(operator: FloatArray, field: FloatArray, nodes: NDArray[np.int32]) -> FloatArray:
    """(points of all cells, 9, k) gradients, direction first, of fields (nodes, 3, k)."""
    k = field.shape[2]
    gradient = operator @ field[nodes].reshape(*nodes.shape, 3 * k)
    return gradient.reshape(-1, 9, k)


def point_gradients(
    points: RulePoints, *, chunk: int
) -> Iterator[tuple[NDArray[np.int32], FloatArray, FloatArray]]:
    """By chunks of the cells: from nodal values to gradients, and the points' weights.

    Args:
        points: of a rule in cells.
        chunk: about how many points to take at a time.

    Yields:
        Some of the cells; (cells, points * 3, nodes of a cell) derivatives of the basis functions, direction last
        among the rows; (cells, points) weights, m^3.
    """
    mesh, space = points.model.mesh.mesh, points.model.space
    at, weights = points.reference
    shapes = _scalar_derivatives(space.ufl_element(), at)
    geometry = _scalar_derivatives(mesh.ufl_domain().ufl_coordinate_element(), at)
    corners, x = compat.cell_nodes(mesh), mesh.geometry.x
    step = max(1, chunk // len(weights))
    for start in range(0, len(points.cells), step):
        cells = points.cells[start : start + step]
        # [c, q, r, k] = dx_k / dX_r, so that its inverse times d/dX is d/dx
        jacobian = geometry @ x[corners[cells]][:, None]
        operator = np.linalg.inv(jacobian) @ shapes
        volume = np.abs(np.linalg.det(jacobian)) * weights
        yield cells, operator.reshape(len(volume), -1, shapes.shape[2]), volume


def _scalar_derivatives(element: basix.ufl._ElementBase, points: FloatArray) -> FloatArray:
    """(points, 3, nodes) derivatives of the scalar basis functions on the reference cell."""
    table: FloatArray = element.sub_elements[0].tabulate(1, points)[1:]
    return np.ascontiguousarray(table.transpose(1, 0, 2))


def cell_type(space: fem.FunctionSpace) -> basix.CellType:
    """The kind of the cells."""
    return basix.CellType[space.mesh.topology.cell_name()]
