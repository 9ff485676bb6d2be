"""Fields of one cell in a body with history: their values, accepted and on trial, and the tangent of their cells.

For a trial of the shared unknown u the fields a of each cell are those that make their own equations zero, a(u).  So
the forces of a cell are functions of u alone, and their derivative is the condensed one,

    r_u(u, a(u)),    K_uu - K_ua K_aa^-1 K_au.

What solves for them (`cell_field_loop`) keeps K_aa^-1 and K_ua of a tangent that was taken before, each cell its own:
these columns alone, a half of the work, where the condensed tangent is not wanted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.contract.cell_fields import CellFields
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.cell_matrices import CellMatrices, cell_dofs, cell_values, chunks
from flexmbd.continuum.finite_elements.condensation import (
    CondensedCells,
    condense,
    fill_whole,
    inverted,
    undetermined,
)
from flexmbd.continuum.finite_elements.condensed_stiffness import singular_error
from flexmbd.continuum.history.point_loop import CellUnknowns
from flexmbd.continuum.history.shared_parts import share_parts
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]


class CellFieldsSolved:
    """The fields of one cell of one group of cells. Constructing one is not collective.

    Attributes:
        unknowns: as the compiled loop takes them.
        accepted: (cells of this rank, m) those of the last accepted step.
    """

    def __init__(self, group: CellGroup, fields: CellFields, u: fem.Function, whole: fem.Function) -> None:
        """At rest, zero.

        Args:
            group: of cells.
            fields: of it.
            u: shared unknown on trial.
            whole: the formulation's own unknown, which its forms read; set by `fill` alone.
        """
        self._group, self._fields, self._u, self._whole = group, fields, u, whole
        self._is_updated = group.formulation.REFERENCE == "UPDATED"
        self._dofs = cell_dofs(u.function_space)
        cells, n, m = len(self._dofs), len(fields.shared_places), len(fields.cell_places)
        self.accepted: FloatArray = np.zeros((cells, m))
        self._accepted_u: FloatArray = np.zeros_like(u.x.array)
        self._terms: list[ufl.Form] = []
        self._columns: CellMatrices | None = None
        self._tangent: CellMatrices | None = None
        self.unknowns = CellUnknowns(
            shared=fields.shared_places.astype(np.int64),
            places=fields.cell_places.astype(np.int64),
            values=np.zeros((cells, m)),
            before=np.zeros_like(u.x.array),
            inverse=np.zeros((cells, m, m)),
            coupling=np.zeros((cells, m, n)),
            known=np.zeros(cells, dtype=np.int64),
            solved=np.ones(cells, dtype=np.int64),
            force=np.zeros(n + m),
            change=np.zeros(m),
            step=np.zeros(m),
            moved=np.zeros(n),
            search=np.zeros(4),
            lacks=np.zeros((2, m)),
        )

    def compile_columns(self, terms: Sequence[ufl.Form]) -> None:
        """Take the internal forces' virtual work, linear in test functions on the whole space. Collective, compiles."""
        space, element, self._terms = self._whole.function_space, self._fields.cell_element, [*terms]
        own = ufl.TrialFunction(ufl.FunctionSpace(space.mesh.ufl_domain(), element))
        columns = self._derivatives(self._fields.in_cells(own))
        self._columns = CellMatrices(columns, space, element)

    def compile_tangent(self) -> None:
        """Make ready for `condensed`. Collective, compiles."""
        if self._tangent is None:
            space = self._whole.function_space
            self._tangent = CellMatrices(self._derivatives(ufl.TrialFunction(space)), space)

    def unsolved(self) -> Indices:
        """The cells of the group whose fields the last pass did not solve for."""
        return self._group.cells[self.unknowns.solved[self._group.cells] == 0]

    def condensed(self, cells: Indices) -> CondensedCells:
        """Tangents of some cells on trial, condensed and kept for the steps that come; not collective."""
        assert self._tangent is not None  # noqa: S101  (see `compile_tangent`)
        found = condense(self._tangent.of_cells(cells, self._values), self._fields)
        self._keep(cells, found.inverse, found.coupling, found.singular)
        return found

    def _keep(
        self, cells: Indices, inverse: FloatArray, coupling: FloatArray, singular: NDArray[np.bool_]
    ) -> None:
        """Keep those parts of tangents that are not singular."""
        usable = cells[~singular]
        self.unknowns.inverse[usable] = inverse.transpose(0, 2, 1)[~singular]
        self.unknowns.coupling[usable] = coupling.transpose(0, 2, 1)[~singular]
        self.unknowns.known[usable] = 1

    def renew(self, cells: Indices) -> NDArray[np.bool_]:
        """Keep the tangents of some cells on trial; which of them have a singular part of the fields."""
        parts: list[NDArray[np.bool_]] = [np.zeros(0, dtype=bool)]
        for some in chunks(cells):
            columns = self._of_cells(some)
            inverse, singular = inverted(columns[:, self._fields.cell_places])
            self._keep(some, inverse, columns[:, self._fields.shared_places], singular)
            parts.append(singular)
        return np.concatenate(parts)

    def singular_error(self, cell: int) -> FormulationError:
        """What is wrong with a form whose equations do not determine its fields of one cell at rest."""
        return singular_error(self._group, self._fields, self._own(cell))

    def open_names(self, cell: int) -> str:
        """What a message calls the fields of a cell that the equations on trial leave open."""
        return self._fields.names(undetermined(self._own(cell)))

    def end_pass(self) -> None:
        """Note for which shared unknown they are solved."""
        self.unknowns.before[:] = self._u.x.array

    def fill(self, *, accepted: bool = False) -> None:
        """Set the formulation's own unknown to the trial, or to it with the accepted fields; not collective."""
        values = self.accepted if accepted else self.unknowns.values
        cells = self._group.cells
        dofs, shared = self._whole.function_space.dofmap.list[cells], self._u.x.array[self._dofs[cells]]
        fill_whole(self._whole, self._fields, dofs, shared, values[cells])

    def commit(self) -> None:
        """Accept the trial; where the unknown is that since the last accepted step, it begins at zero again."""
        if self._is_updated:
            self.unknowns.values[:] = 0.0
            self._accepted_u[:] = 0.0
        else:
            self._accepted_u[:] = self._u.x.array
        self.accepted[:] = self.unknowns.values
        self.unknowns.before[:] = self._accepted_u

    def revert(self) -> None:
        """Forget the trial."""
        self.unknowns.values[:] = self.accepted
        self.unknowns.before[:] = self._accepted_u

    def restore(self, accepted: FloatArray) -> None:
        """Go back to accepted fields (cells, m) of the shared unknown that is on trial, and forget tangents."""
        self.accepted[:] = accepted
        self._accepted_u[:] = self._u.x.array
        self.unknowns.known[:] = 0
        self.revert()

    def _derivatives(self, direction: ufl.core.expr.Expr) -> list[ufl.Form]:
        """Of the terms by the whole unknown; equal parts of each as one."""
        forms = [ufl.derivative(term, self._whole, direction) for term in self._terms]
        return [
            ufl.Form([one.reconstruct(share_parts([one.integrand()])[0]) for one in form.integrals()])
            for form in map(ufl.algorithms.expand_derivatives, forms)
        ]

    def _of_cells(self, cells: Indices) -> FloatArray:
        """(k, n + m, m) the columns of the fields in the tangents of some cells."""
        assert self._columns is not None  # noqa: S101  (compiled as the history is made)
        return self._columns.of_cells(cells, self._values)

    def _own(self, cell: int) -> FloatArray:
        """(m, m) the fields' part of the tangent of a cell."""
        return self._of_cells(np.array([cell], dtype=np.int32))[0][self._fields.cell_places]

    def _values(self, field: fem.Function, cells: Indices) -> FloatArray:
        """The values of a function that the forms read, on some cells."""
        if field is not self._whole:
            return cell_values(field, cells)
        whole = np.empty((len(cells), len(self.unknowns.force)))
        whole[:, self._fields.shared_places] = self._u.x.array[self._dofs[cells]]
        whole[:, self._fields.cell_places] = self.unknowns.values[cells]
        return whole


def no_cell_fields() -> CellUnknowns:
    """As the compiled loop takes them where there are none."""
    none, numbers = np.zeros(0), np.zeros(0, dtype=np.int64)
    return CellUnknowns(numbers, numbers, np.zeros((0, 0)), none, np.zeros((0, 0, 0)), np.zeros((0, 0, 0)), numbers,
                        numbers, none, none, none, none, none, np.zeros((2, 0)))  # fmt: skip
