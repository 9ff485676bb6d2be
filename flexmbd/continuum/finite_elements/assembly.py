"""Internal forces and kinetic energy of a body as forms, and their derivatives as PETSc matrices.

Each term of each cell group is a form of its own, with its own quadrature rule: DOLFINx may evaluate
a form of several rules wrongly.  The matrices follow by `ufl.derivative`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx.mesh
import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.contract import formulation, quadrature
from flexmbd.continuum.contract.formulation import IntegralTerm
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.errors import FormulationError


def internal_work(
    groups: Sequence[CellGroup], u: fem.Function, v: ufl.core.expr.Expr
) -> list[ufl.Form]:
    """Virtual work, J, of the internal forces at u on v, term by term and group by group.

    Not collective. Linear in v; the derivative of the strain energy where there is one.
    """
    mesh = u.function_space.mesh
    return [
        integral(term, group, mesh)
        for group in groups
        for term in formulation.internal_work(group.formulation, u, v, p=group.symbols)
    ]


def kinetic_energy(groups: Sequence[CellGroup], v: fem.Function) -> list[ufl.Form]:
    """Kinetic energy of the velocity v, J, term by term and group by group; not collective."""
    mesh = v.function_space.mesh
    return [
        integral(term, group, mesh)
        for group in groups
        for term in group.kinetic_energy(v)
    ]


def dissipation(groups: Sequence[CellGroup], v: fem.Function) -> list[ufl.Form]:
    """Rayleigh's function of the rates v, W, of the groups that have one, term by term; not collective."""
    mesh = v.function_space.mesh
    return [
        integral(term, group, mesh)
        for group in groups
        for term in group.dissipation(v)
    ]


def gyroscopic(groups: Sequence[CellGroup], space: fem.FunctionSpace) -> list[fem.Form]:
    """Virtual work of the gyroscopic forces that rates require, bilinear and skew, of the groups that have such.

    Of the kinetic energy T1(u, v): T1(w, d) - T1(d, w), w the trial function (rates), d the test function. Collective.
    """
    u, v = fem.Function(space), fem.Function(space)
    w, d = ufl.TrialFunction(space), ufl.TestFunction(space)

    def energy(term: ufl.Form, along_u: ufl.core.expr.Expr, along_v: ufl.core.expr.Expr) -> ufl.Form:
        return ufl.algorithms.expand_derivatives(ufl.derivative(ufl.derivative(term, u, along_u), v, along_v))

    terms = [
        integral(term, group, space.mesh)
        for group in groups
        for term in group.gyroscopic(u, v)
    ]
    return _compiled(energy(term, w, d) - energy(term, d, w) for term in terms)


def integral(term: IntegralTerm, group: CellGroup, mesh: dolfinx.mesh.Mesh) -> ufl.Form:
    """A term integrated over the cells of its group by its own rule; not collective."""
    density, rule = term
    metadata = quadrature.metadata(mesh.topology.cell_name(), rule)
    if group.name is None:
        return density * ufl.dx(domain=mesh, metadata=metadata)
    # the number is the same for every group, and so is the compiled code
    cells = ufl.Measure("dx", domain=mesh, subdomain_data=[(1, group.cells)], metadata=metadata)
    return density * cells(1)


def derivatives(terms: Iterable[ufl.Form], u: fem.Function) -> list[fem.Form]:
    """Derivatives of linear forms by u, for the values u has when they are assembled. Collective."""
    return _compiled(_derivative(term, u) for term in terms)


def derivatives_at_rest(terms: Iterable[ufl.Form], u: fem.Function) -> list[fem.Form]:
    """Derivatives of linear forms by u at u = 0. Collective."""
    # u = 0 as a symbol, so that what vanishes at rest is not computed
    zero = {u: ufl.zero(u.ufl_shape)}
    return _compiled(ufl.replace(_derivative(term, u), zero) for term in terms)


def directional_derivatives_at_rest(
    terms: Iterable[ufl.Form], u: fem.Function, directions: Sequence[fem.Function]
) -> list[fem.Form]:
    """Derivatives of linear forms by u along each of several directions, at u = 0: linear forms. Collective."""
    forms = list(terms)
    for direction in directions:
        forms = [ufl.derivative(form, u, direction) for form in forms]
    zero = {u: ufl.zero(u.ufl_shape)}
    expanded = [ufl.replace(ufl.algorithms.expand_derivatives(form), zero) for form in forms]
    return _compiled(form for form in expanded if form.integrals())


def assemble(
    forms_by_name: Mapping[str, Sequence[fem.Form]], groups: Sequence[CellGroup], space: fem.FunctionSpace
) -> list[PETSc.Mat]:
    """Sums of bilinear forms as matrices. Collective.

    They are assembled one after the other in one DOLFINx matrix, which takes half the time of
    assembling in PETSc matrices, where every entry's place is looked up.

    Args:
        forms_by_name: for each matrix its forms, by what a message calls it.
        groups: of the model that the forms are of.
        space: of the unknown.

    Returns:
        AIJ matrices over all dofs, spread by rows, the block size that of the space; symmetric.

    Raises:
        FormulationError: on all ranks: a matrix has entries that are not finite.
    """
    blocks = empty_matrix([form for forms in forms_by_name.values() for form in forms], groups, space)
    matrices = []
    for name, forms in forms_by_name.items():
        blocks.set_value(0.0)
        for form in forms:
            fem.assemble_matrix(blocks, form)
        blocks.scatter_reverse()
        matrices.append(finished(blocks, groups, name=name, comm=space.mesh.comm))
    return matrices


def finished(blocks: la.MatrixCSR, groups: Sequence[CellGroup], *, name: str, comm: MPI.Comm) -> PETSc.Mat:
    """A summed block matrix as a PETSc AIJ matrix, symmetric. Collective.

    Raises:
        FormulationError: on all ranks: it has entries that are not finite.
    """
    _check_finite(blocks, groups, name=name, comm=comm)
    return _to_petsc(comm, blocks)


def _derivative(term: ufl.Form, u: fem.Function) -> ufl.Form:
    along = ufl.TrialFunction(u.function_space)
    return ufl.algorithms.expand_derivatives(ufl.derivative(term, u, along))


def _compiled(forms: Iterable[ufl.Form]) -> list[fem.Form]:
    """Without those that vanish, of which DOLFINx makes None."""
    return [form for form in map(fem.form, forms) if form is not None]


def empty_matrix(
    forms: Sequence[fem.Form], groups: Sequence[CellGroup], space: fem.FunctionSpace
) -> la.MatrixCSR:
    """A matrix whose pattern has the entries of all cells. Collective."""
    if len(groups) == 1 and forms:
        return fem.create_matrix(forms[0])
    return shared_pattern(space)


def shared_pattern(space: fem.FunctionSpace) -> la.MatrixCSR:
    """A matrix whose pattern has all entries of all cells. Collective, may compile."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    return fem.create_matrix(fem.form(ufl.inner(u, v) * ufl.dx))


def _check_finite(
    blocks: la.MatrixCSR, groups: Sequence[CellGroup], *, name: str, comm: MPI.Comm
) -> None:
    """Refuse entries that are not finite. Collective."""
    if comm.allreduce(bool(np.isfinite(blocks.data).all()), op=MPI.LAND):
        return
    forms = ", ".join(dict.fromkeys(group.form_name for group in groups))
    raise FormulationError(
        f"the {name} of {forms} has entries that are not finite: a parameter that does not fit the "
        "cells, as a section's orientation along its beam, or a division by zero at rest"
    )


class PetscCopy:
    """A block matrix that is filled again and again, as a PETSc AIJ matrix. Constructing one is collective.

    The entries' places are found once; on one rank PETSc reads the very array that `refill` writes.
    """

    def __init__(self, comm: MPI.Comm, blocks: la.MatrixCSR) -> None:
        """Look at the pattern; the values are taken by `refill`."""
        places = _csr(blocks, np.arange(len(blocks.data), dtype=np.int64))
        self._places = places.data
        self._csr = places.indptr.astype(PETSc.IntType), places.indices.astype(PETSc.IntType)
        self._values = np.zeros(len(self._places))
        self._matrix = _petsc_matrix(comm, blocks, *self._csr, self._values)

    def refill(self, blocks: la.MatrixCSR) -> PETSc.Mat:
        """Take over the values of the finished matrix; always the same PETSc matrix. Collective."""
        np.take(blocks.data, self._places, out=self._values)
        if self._matrix.comm.size > 1:
            self._matrix.setValuesCSR(*self._csr, self._values)
        self._matrix.assemble()
        self._matrix.stateIncrease()
        return self._matrix


def _to_petsc(comm: MPI.Comm, blocks: la.MatrixCSR) -> PETSc.Mat:
    """A finished block matrix as a PETSc AIJ matrix. Collective.

    On one rank PETSc takes the arrays over without a copy.
    """
    csr = _csr(blocks, blocks.data)
    if 2 * np.count_nonzero(csr.data) < len(csr.data):
        # a mass has nothing between the components, two thirds of the stiffness' pattern
        csr.eliminate_zeros()
    kind = PETSc.IntType
    matrix = _petsc_matrix(comm, blocks, csr.indptr.astype(kind), csr.indices.astype(kind), csr.data)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix


def _csr(blocks: la.MatrixCSR, values: NDArray[Any]) -> scipy.sparse.csr_array:
    """The rows this rank owns, columns numbered over all ranks and ascending, with `values` for the blocks' data."""
    rows, columns = blocks.index_map(0), blocks.index_map(1)
    bs = blocks.block_size[0]
    n = rows.size_local
    start = blocks.indptr[: n + 1]
    local = blocks.indices[: start[-1]]
    numbers = columns.local_to_global(
        np.arange(columns.size_local + columns.num_ghosts, dtype=np.int32)
    )
    data = values[: start[-1] * bs * bs].reshape(-1, bs, bs)
    shape = (bs * n, bs * columns.size_global)
    csr = scipy.sparse.bsr_array((data, numbers[local], start), shape=shape).tocsr()
    csr.sort_indices()
    return csr


def _petsc_matrix(
    comm: MPI.Comm, blocks: la.MatrixCSR, indptr: NDArray[Any], indices: NDArray[Any], data: NDArray[Any]
) -> PETSc.Mat:
    bs, rows, columns = blocks.block_size[0], blocks.index_map(0), blocks.index_map(1)
    matrix = PETSc.Mat().createAIJWithArrays(
        ((bs * rows.size_local, None), (bs * columns.size_local, None)),
        (indptr, indices, data),
        bsize=bs,
        comm=comm,
    )
    matrix.assemble()
    return matrix
