"""The stiffness at rest of a body with fields of one cell, which are condensed in each cell, and the fields given back.

At rest the fields of a cell are linear in its shared unknowns, a = -L u with the lift L = K_aa^-1 K_au.  So any
bilinear form of small motions, B, is that of the shared ones by the congruence of each cell's matrix with (1, -L): for
B = K that is static condensation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.cell_fields import CellFields
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.cell_matrices import CellMatrices, add_to, cell_dofs, chunks
from flexmbd.continuum.finite_elements.condensation import condense, fill_whole, inverted, undetermined
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]

#: Bilinear forms of the whole unknown by the place of their cell group.
GroupForms = Mapping[int, Sequence[ufl.Form]]


class CondensedStiffness:
    """Condensed matrices of one body at rest. Constructing one is collective, and compiles.

    Attributes:
        fields: of one cell.
        whole: the space of the formulations' own unknown.
        lift: (cells of this rank including ghosts, m, n) L; of ghost cells zero.
    """

    def __init__(self, forms: DiscreteForms, fields: CellFields) -> None:
        """Factor the matrices of the fields.

        Raises:
            FormulationError: on all ranks: the equations of a field of one cell do not determine it.
        """
        self.fields, self.whole, self._forms = fields, forms.whole, forms
        self._cells = [group.cells for group in forms.groups]
        self._stiffness = [self._matrices([derivative]) for derivative in self._derivatives()]
        n, m = len(fields.shared_places), len(fields.cell_places)
        self.lift: FloatArray = np.zeros((len(forms.whole.dofmap.list), m, n))
        error = None
        for group, matrices in zip(forms.groups, self._stiffness, strict=True):
            for cells in chunks(group.cells):
                whole = matrices.of_cells(cells)
                condensed = condense(whole, fields)
                self.lift[cells] = condensed.lift
                if condensed.singular.any() and error is None:
                    error = singular_error(group, fields, whole[condensed.singular][0])
        parallel.raise_collectively(forms.mesh.comm, error)

    def stiffness(self, surfaces: Sequence[fem.Form] = (), *, factors: Sequence[float] | None = None) -> PETSc.Mat:
        """The stiffness of the shared unknowns, N/m. Collective.

        Args:
            surfaces: bilinear forms on the shared space that are added, as of springs on facets.
            factors: of each cell group; by default 1.

        Raises:
            FormulationError: on all ranks: an entry is not finite.
        """
        parts = factors or [1.0] * len(self._stiffness)
        groups = zip(self._cells, self._stiffness, parts, strict=True)
        return self._assembled([(cells, m.of_cells, factor) for cells, m, factor in groups], surfaces, name="stiffness")

    def matrix(self, forms: GroupForms, *, name: str) -> PETSc.Mat:
        """Bilinear forms of the whole unknown as a matrix of the shared one. Collective, may compile.

        Args:
            forms: by the place of their group.
            name: what a message calls the matrix.
        """
        parts = [(self._cells[k], self._matrices(some).of_cells, 1.0) for k, some in forms.items()]
        return self._assembled(parts, (), name=name)

    def whole_columns(self, columns: FloatArray) -> FloatArray:
        """Small motions as fields of the whole unknown; not collective.

        Args:
            columns: (local shared dofs including ghosts, k).

        Returns:
            (local dofs of `whole` including ghosts, k); what lies on ghost cells alone is zero.
        """
        function = fem.Function(self.whole)
        found = np.zeros((len(function.x.array), columns.shape[1]), order="F")
        for i in range(columns.shape[1]):
            self.fill(function, columns[:, i])
            found[:, i] = function.x.array
        return found

    def fill(self, function: fem.Function, shared: FloatArray) -> None:
        """Set a function on `whole` to a small motion (local shared dofs including ghosts,); not collective."""
        own = shared[cell_dofs(self._forms.space)]
        lists = self.whole.dofmap.list
        fill_whole(function, self.fields, lists, own, -np.einsum("cmn,cn->cm", self.lift, own))

    def shared_forces(self, forces: FloatArray) -> FloatArray:
        """Forces on the shared unknowns that forces on all cause, of a symmetric stiffness. Collective.

        Args:
            forces: (local dofs of `whole` including ghosts,), the ghosts' those of their owners.

        Returns:
            (owned shared dofs,).
        """
        space, lists = self._forms.space, self.whole.dofmap.list
        dofs, through = cell_dofs(space), fem.Function(space).x
        found = np.zeros_like(through.array)
        found[dofs] = forces[lists[:, self.fields.shared_places]]
        # of ghost cells the lift is zero
        own = np.einsum("cmn,cm->cn", self.lift, forces[lists[:, self.fields.cell_places]])
        np.add.at(through.array, dofs, -own)
        through.scatter_reverse(la.InsertMode.add)
        owned = self._forms.layout.n_owned
        return np.asarray(found[:owned] + through.array[:owned])

    def answer(self, forces: FloatArray) -> FloatArray:
        """The fields of one cell by forces on them, where nothing shared moves: K_aa^-1 f_a; not collective.

        Args:
            forces: as of `shared_forces`.

        Returns:
            (local dofs of `whole` including ghosts,); what lies on ghost cells alone is zero.
        """
        found, own = np.zeros_like(forces), self.fields.cell_places
        for group, matrices in zip(self._cells, self._stiffness, strict=True):
            for cells in chunks(group):
                dofs = self.whole.dofmap.list[cells][:, own]
                inverse, _ = inverted(matrices.of_cells(cells)[:, own[:, None], own])
                found[dofs] = np.einsum("cij,cj->ci", inverse, forces[dofs])
        return found

    def _derivatives(self) -> list[ufl.Form]:
        u, v = fem.Function(self.whole), ufl.TestFunction(self.whole)
        zero = {u: ufl.zero(u.ufl_shape)}
        found = []
        for group in self._forms.groups:
            work = sum(assembly.internal_work([group], u, v))
            slope = ufl.algorithms.expand_derivatives(ufl.derivative(work, u, ufl.TrialFunction(self.whole)))
            found.append(ufl.replace(slope, zero))
        return found

    def _matrices(self, forms: Sequence[ufl.Form]) -> CellMatrices:
        return CellMatrices(split_integrals(forms), self.whole)

    def _assembled(
        self,
        parts: Sequence[tuple[NDArray[np.int32], Callable[[Any], FloatArray], float]],
        further: Sequence[fem.Form],
        *,
        name: str,
    ) -> PETSc.Mat:
        forms, fields = self._forms, self.fields
        blocks = assembly.shared_pattern(forms.space)
        own, shared = fields.cell_places, fields.shared_places
        for cells, of_cells, factor in parts:
            for some in chunks(cells):
                whole, lift = of_cells(some), self.lift[some]
                # (1, -L)^T B (1, -L)
                half = whole[:, :, shared] - whole[:, :, own] @ lift
                add_to(blocks, forms.space, some, factor * (half[:, shared] - lift.transpose(0, 2, 1) @ half[:, own]))
        for form in further:
            fem.assemble_matrix(blocks, form)
        blocks.scatter_reverse()
        return assembly.finished(blocks, forms.groups, name=name, comm=forms.mesh.comm)


def split_integrals(forms: Sequence[ufl.Form]) -> list[ufl.Form]:
    """The same forms of one integral each."""
    return [ufl.Form([integral]) for form in forms for integral in form.integrals()]


def singular_error(group: CellGroup, fields: CellFields, matrix: FloatArray) -> FormulationError:
    """Of a cell whose fields are not determined by their own equations.

    Args:
        group: of the cell.
        fields: of it.
        matrix: (n + m, n + m) of the cell.
    """
    own = fields.cell_places
    names = fields.names(undetermined(matrix[np.ix_(own, own)]))
    return FormulationError(
        f"{group.form_name}: the {names} of the form are fields of one cell, and their own equations do not determine "
        "them: their part of a cell's stiffness is singular. Take away what depends on the rest (an enhanced strain "
        "that another one has, a rule with too few points), or make the field continuous"
    )
