"""The tangent of a body with history: derivatives of its forces, those through the means of cells included.

With means m = (integral of a over the cell) / (its measure) in the forces r(u, m(u)), the tangent is

    dr/du + dr/dm (x) dm/du

whose second part couples all dofs of one cell.  Both factors are derivatives of forms; with test functions
that end at the cell's border their vectors are those of the single cells, and the product is added cell by
cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.cell_matrices import add_to, chunks
from flexmbd.continuum.history.point_history import History
from flexmbd.multibody.kernels.base.compiling import entry_kernel

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class _Coupling:
    """What the means of one group's cells add.

    Attributes:
        forces, means: forms of dr/dm and of the derivative of the integral of a, on broken test functions.
        measure: form of the cells' measure, by cell.
        broken: dofs of the broken test functions by cell, (cells, nodes).
        cells: (k,) the cells of the group.
    """

    forces: fem.Form
    means: fem.Form
    measure: fem.Form
    broken: Indices
    cells: Indices


class MeanTangent:
    """The tangent as forms and a matrix that is filled again and again. Constructing one is collective."""

    def __init__(
        self,
        histories: Sequence[History],
        u: fem.Function,
        groups: Sequence[CellGroup],
        *,
        further: Sequence[fem.Form] = (),
    ) -> None:
        """Compile.

        Args:
            histories: of the body's groups.
            u: trial displacement.
            groups: the groups, for the matrix' pattern.
            further: bilinear forms that are added to the derivatives of the histories' terms.
        """
        self._space = u.function_space
        v = ufl.TestFunction(self._space)
        terms = [term for history in histories if history.solved is None for term in history.terms]
        self._forms = [*assembly.derivatives(terms, u), *further]
        self._condensed = [(one.solved, one.group.cells) for one in histories if one.solved is not None]
        self._blocks = (
            assembly.shared_pattern(self._space) if self._condensed
            else assembly.empty_matrix(self._forms, groups, self._space)
        )  # fmt: skip
        self._couplings = [_coupling(history, u, v) for history in histories if history.mean is not None]
        self._petsc = assembly.PetscCopy(self._space.mesh.comm, self._blocks)

    def assemble(self, more: Sequence[fem.Form] = ()) -> PETSc.Mat:
        """Assemble at the present values, with more bilinear forms. Collective."""
        blocks = self._blocks
        blocks.set_value(0.0)
        for form in (*self._forms, *more):
            fem.assemble_matrix(blocks, form)
        for coupling in self._couplings:
            self._add(coupling)
        for solved, cells in self._condensed:
            for some in chunks(cells):
                add_to(blocks, self._space, some, solved.condensed(some).matrices)
        blocks.scatter_reverse()
        return self._petsc.refill(blocks)

    def _add(self, coupling: _Coupling) -> None:
        cells, nodes = coupling.cells, coupling.broken[coupling.cells]
        measure = np.zeros(len(coupling.broken))
        fem.assemble_vector(measure, coupling.measure)
        left, right = np.zeros((2, coupling.broken.size * 3))
        fem.assemble_vector(left, coupling.forces)
        fem.assemble_vector(right, coupling.means)
        blocks, rows = self._blocks, self._space.dofmap.list[cells]
        first, second = (vector.reshape(-1, 3)[nodes] for vector in (left, right))
        add_products(blocks.data, blocks.indptr, blocks.indices, rows, first, second, 1.0 / measure[cells])


def _coupling(history: History, u: fem.Function, v: ufl.Argument) -> _Coupling:
    """Not collective but for compilation."""
    mean, domain = history.mean, u.function_space.mesh
    cell, degree = domain.topology.cell_name(), u.function_space.element.basix_element.degree
    broken = fem.functionspace(domain, basix.ufl.element("Lagrange", cell, degree, shape=(3,), discontinuous=True))
    w, unit = ufl.TestFunction(broken), fem.Constant(domain, 1.0)
    by_mean = sum(ufl.derivative(term, mean, unit) for term in history.terms)
    forces = ufl.replace(ufl.algorithms.expand_derivatives(by_mean), {v: w})
    averaged, measure = history.mean_forms()
    one = ufl.replace(averaged, {ufl.TestFunction(mean.function_space): unit})
    means = fem.form(ufl.derivative(one, u, w))
    return _Coupling(fem.form(forces), means, fem.form(measure), broken.dofmap.list, history.group.cells)


@entry_kernel
def add_products(data, indptr, indices, nodes, left, right, factor):  # type: ignore[no-untyped-def]
    """Add factor left (x) right of each cell to a matrix of 3 x 3 blocks.

    Args:
        data: of the matrix, blocks row by row.
        indptr: of the matrix.
        indices: of the matrix, ascending in a row.
        nodes: (k, n) block rows and columns of each cell.
        left: (k, n, 3).
        right: (k, n, 3).
        factor: (k,).
    """
    for k in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            begin, end = indptr[nodes[k, i]], indptr[nodes[k, i] + 1]
            for j in range(nodes.shape[1]):
                low, high, column = begin, end, nodes[k, j]
                while high - low > 1:
                    middle = (low + high) // 2
                    if indices[middle] <= column:
                        low = middle
                    else:
                        high = middle
                for a in range(3):
                    value = factor[k] * left[k, i, a]
                    for b in range(3):
                        data[9 * low + 3 * a + b] += value * right[k, j, b]
