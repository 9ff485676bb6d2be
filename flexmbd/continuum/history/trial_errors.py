"""Errors of a body with history: formulations that cannot be stepped together, trial displacements that fail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.history.point_history import History
from flexmbd.errors import ConvergenceError, FormulationError


class InvertedCellError(ConvergenceError):
    """A trial displacement turns a cell inside out; a smaller step may not."""


class LargeIncrementError(ConvergenceError):
    """A step is larger than a formulation integrates well; a smaller one is not."""


def check_references(forms: DiscreteForms) -> None:
    """Refuse formulations that cannot be stepped together; the same on every rank.

    Raises:
        FormulationError: formulations of both references; with the updated one, elements of another degree
            than the geometry, or unknowns besides the displacement.
    """
    references = {group.formulation.REFERENCE: group.form_name for group in forms.groups}
    if len(references) > 1:
        raise FormulationError(
            f"{references['INITIAL']} refers to the initial configuration and {references['UPDATED']} to the "
            "updated one: give all cell groups formulations of one reference"
        )
    geometry = compat.geometry_degree(forms.mesh.mesh)
    if "UPDATED" in references and forms.degree != geometry:
        raise FormulationError(
            f"{references['UPDATED']} moves the mesh with the body, so degree={forms.degree} needs a mesh of "
            f"degree {forms.degree}, and this one has degree {geometry}"
        )
    if "UPDATED" in references and forms.layout.has_further:
        raise FormulationError(
            f"{references['UPDATED']} has unknowns besides the displacement, by which a mesh cannot be moved"
        )


def refuse_without_limit(groups: Sequence[CellGroup]) -> None:
    """Refuse groups with history that do not say where they yield; the same on every rank.

    Raises:
        FormulationError: names the formulation.
    """
    for group in groups:
        if group.optional.scaled_yield is None:
            raise FormulationError(
                f"{group.form_name} keeps a history and does not give its yield limit, without which there is no "
                "tangent of unloading; give it scaled_yield(p, factor), parameters with yield limits that are "
                "factor times as high, or p itself where nothing ever yields"
            )


def find_inverted_cell(histories: Sequence[History], u: fem.Function) -> int | None:
    """A cell of this rank that the displacement u turns inside out, if there is one; not collective."""
    inverted: int | None = None
    displacement = u if u.ufl_shape == (3,) else ufl.as_vector([u[k] for k in range(3)])
    stretch = ufl.det(ufl.Identity(3) + ufl.grad(displacement))
    for history in histories:
        values = history.evaluate(stretch)
        if values.size and not values.min() > 0.0:
            inverted = int(history.group.cells[values.min(axis=1).argmin()])
    return inverted


def find_large_increment(histories: Sequence[History]) -> tuple[float, int | None]:
    """The largest `increment_size` beyond 1, and its cell of this rank; else 1 and None. Not collective."""
    largest, where = 1.0, None
    for history in histories:
        values = history.increment_size()
        if values.size and not values.max() <= largest:
            largest = float(values.max())
            where = int(history.group.cells[values.max(axis=1).argmax()])
    return largest, where


def refuse_inverted_cell(mesh: TaggedMesh, cell: int | None) -> None:
    """Raise where a rank found a cell that is turned inside out. Collective.

    Args:
        mesh: of the body.
        cell: local number of such a cell of this rank, or None.

    Raises:
        InvertedCellError: on all ranks.
    """
    error = None
    if cell is not None:
        where = _describe_cell(mesh, cell)
        error = InvertedCellError(f"{where}, is turned inside out; take a smaller step, or a finer mesh there")
    parallel.raise_collectively(mesh.comm, error)


def refuse_large_increment(mesh: TaggedMesh, cell: int | None, *, ratio: float) -> None:
    """Raise where a rank found a step that is too large for its formulation. Collective.

    Args:
        mesh: of the body.
        cell: local number of the cell of this rank with the largest step, or None.
        ratio: of the step to the largest that the formulation integrates well.

    Raises:
        LargeIncrementError: on all ranks.
    """
    error = None
    if cell is not None:
        error = LargeIncrementError(
            f"the step is {ratio:.3g} times the largest that the formulation integrates accurately, in "
            f"{_describe_cell(mesh, cell)}; take a smaller step"
        )
    parallel.raise_collectively(mesh.comm, error)


def refuse_infinite_force(forms: DiscreteForms, force: NDArray[np.float64]) -> None:
    """Raise where internal forces (owned dofs,) are not finite, and say where. Collective.

    Raises:
        ConvergenceError: on all ranks.
    """
    layout = forms.layout
    bad = np.isin(layout.displacement_dofs, np.flatnonzero(~np.isfinite(force))).any(axis=1)
    error = None
    if bad.any():
        x = layout.node_x[bad][0]
        error = ConvergenceError(
            f"the internal forces at ({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g}) m in the undeformed body are not "
            "finite; take a smaller step"
        )
    parallel.raise_collectively(forms.mesh.comm, error)


def _describe_cell(mesh: TaggedMesh, cell: int) -> str:
    """A cell of this rank by its number in the mesh file and its centre."""
    domain = mesh.mesh
    x = domain.geometry.x[compat.cell_nodes(domain)[cell]].mean(axis=0)
    return (
        f"cell {domain.topology.original_cell_index[cell]}, at ({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g}) m in the "
        "undeformed body"
    )
