"""Stress and history of a body at its nodes, for series and pictures.

At a node of a cell stands what the cell has at the quadrature point nearest to it; at a node of the mesh the average
over the cells that share it.  So no history is extrapolated: a plastic strain is never negative.  Stress without
history is a polynomial through the points: of a cell that bends, the stress at the surface.
"""

from __future__ import annotations

import basix
import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.gathered_nodes import GatheredNodes, von_mises
from flexmbd.continuum.grid.cell_search import find_cell
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import FormulationError, MeshError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_VOIGT = [0, 4, 8, 5, 2, 1]


class NodalFields:
    """Evaluates fields of one body. Constructing one is collective.

    Attributes:
        nodes: of the whole mesh, undeformed.
    """

    def __init__(self, body: NonlinearModel) -> None:
        """Number the nodes, and say what the quadrature points count at each node of a cell.

        Raises:
            FormulationError: the body is not made of solid cells, or of plates.
        """
        if body.mesh.dim == 1 or (body.mesh.dim == 2 and not body.turns):
            raise FormulationError(
                f"{body.form_name}: fields are shown of bodies of solid cells, and of plates; ask for the motion of "
                "frames (run.position), or mesh the body with solid cells"
            )
        self._body = body
        self.nodes = GatheredNodes(body, body.layout.node_x)
        corners = compat.interpolation_points(body.layout.node_space)
        self._nearest = [
            np.linalg.norm(corners[:, None] - points[None], axis=2).argmin(axis=1) for points in body.points()
        ]
        self._weights = [
            np.eye(len(points))[nearest]
            if group.optional.state is not None
            else _polynomial_weights(body, points, corners)
            for group, points, nearest in zip(body.groups, body.points(), self._nearest, strict=True)
        ]

    def evaluate(self, R: FloatArray) -> tuple[dict[str, FloatArray], float, int]:
        """Fields of the last accepted step. Collective; the same on every rank.

        Args:
            R: (3, 3) rotation from body axes to those that the stress is wanted in.

        Returns:
            Fields by name, (k,) or (k, m), stress among them; the largest von Mises stress (Pa) and the row of the
            node nearest to it. See `flexmbd.multibody.interiors.observed.InteriorFields`.
        """
        body, nodes = self._body, self.nodes
        sigma = np.zeros((nodes.n_cells, nodes.per_cell, 9))
        for group, values, weights in zip(body.groups, body.stress(), self._weights, strict=True):
            sigma[group.cells] = weights @ values.reshape(len(group.cells), -1, 9)
        body.revert()
        flat = sigma.reshape(-1, 9)
        single = von_mises(flat)
        largest, row = nodes.largest(single)
        parts = self._history()
        columns = [flat, single[:, None], *parts.values()]
        ends = np.cumsum([part.shape[1] for part in columns])[:-1]
        averaged = np.split(nodes.average(np.hstack(columns)), ends, axis=1)
        stress = (R @ averaged[0].reshape(-1, 3, 3) @ R.T).reshape(-1, 9)[:, _VOIGT]
        fields = {"stress": stress, "von_mises": averaged[1][:, 0]}
        for name, part in zip(parts, averaged[2:], strict=True):
            fields[name] = part[:, 0] if part.shape[1] == 1 else part
        return fields, largest, row

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """Rows of the nodes of the cell that holds a point (3,) of the undeformed body, and their weights. Collective.

        Raises:
            MeshError: on all ranks: no cell holds it.
        """
        body = self._body
        found = find_cell(body.mesh, point)
        mine: tuple[IntArray, FloatArray] | None = None
        if found is not None:
            cell, reference = found
            element = body.layout.node_space.element.basix_element
            weights = element.tabulate(0, reference[None])[0, 0, :, 0]
            mine = self.nodes.rows(cell), np.asarray(weights, dtype=float)
        for answer in body.comm.allgather(mine):
            if answer is not None:
                return answer
        raise MeshError(f"no cell of the undeformed body holds the point {np.asarray(point).tolist()} m")

    def _history(self) -> dict[str, FloatArray]:
        """Parts of the history by name, (cells * nodes of a cell, m); zero in groups that have none of the name."""
        nodes, found = self.nodes, dict[str, FloatArray]()
        for group, history, nearest in zip(self._body.groups, self._body.history(), self._nearest, strict=True):
            if not history.size:
                continue
            first = 0
            rows = history.reshape(nodes.n_cells_here, -1, history.shape[1])[group.cells][:, nearest]
            for name, count in _names(group, history.shape[1]).items():
                part = found.setdefault(name, np.zeros((nodes.n_cells * nodes.per_cell, count)))
                if part.shape[1] != count:
                    raise FormulationError(
                        f"two forms of one body give the field {name!r} different numbers of components"
                    )
                part.reshape(nodes.n_cells, nodes.per_cell, count)[group.cells] = rows[:, :, first : first + count]
                first += count
        return found


def _polynomial_weights(body: NonlinearModel, points: FloatArray, corners: FloatArray) -> FloatArray:
    """(nodes, points) of a cell: by the polynomial of the displacement's degree, or of less where points are few."""
    element = body.layout.node_space.element.basix_element
    for degree in range(element.degree, 0, -1):
        family, variant = basix.ElementFamily.P, basix.LagrangeVariant.gll_warped
        basis = basix.create_element(family, element.cell_type, degree, variant)
        at_points, at_nodes = (basis.tabulate(0, places)[0, :, :, 0] for places in (points, corners))
        if np.linalg.matrix_rank(at_points) == at_points.shape[1]:
            return np.asarray(at_nodes @ np.linalg.pinv(at_points))
    return np.full((len(corners), len(points)), 1.0 / len(points))


def _names(group: CellGroup, count: int) -> dict[str, int]:
    """Names of the parts of a group's history, and how many components each has."""
    names = optional_entries(group.formulation).state_names
    named: dict[str, int] = {"state": count} if names is None else names(group.parameters)
    return named
