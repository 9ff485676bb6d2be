"""The same matrices on any number of ranks, by the model that assembles them in use."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, cast

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.entries import has_facet_terms, is_layered, optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.history_trial import FIRST, SECOND, keeps_strains, trial_step, yielding_parameters
from flexmbd.continuum.contract_suite.outcome import Figure
from flexmbd.continuum.contract_suite.trial import FloatArray, equilibration
from flexmbd.continuum.contract_suite.trial_mesh import SURFACE, distorted_mesh, tagged
from flexmbd.continuum.finite_elements.model import ContinuumModel
from flexmbd.continuum.finite_elements.surface_group import Surfaces
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel

_DIVISIONS = 3


def same_on_all_ranks(form: Formulation, cell: str, degree: int, *, comm: MPI.Comm) -> list[Figure]:
    """Stiffness and mass of a mesh that the ranks share, against those of one rank alone. Collective.

    The ranks number their dofs differently; eigenvalues, and what rigid motions make of the
    matrices, do not depend on that.

    Args:
        form: a checked form file.
        cell: one of its cells.
        degree: one of its degrees on that cell.
        comm: two ranks or more.
    """
    names = ["K", "M", "rigid motions' mass"]
    find: Callable[..., tuple[FloatArray, ...]] = _spectra
    if keeps_strains(form):
        names, find = [*names, "forces after yielding"], _spectra_and_forces
    together = find(form, cell, degree, comm=comm)
    # on rank 0 alone, after the others have compiled with it
    alone = parallel.on_root(comm, lambda: find(form, cell, degree, comm=MPI.COMM_SELF))
    return [
        Figure(f"{name}, off by", float(abs(one - many).max() / abs(one).max()), 1e-10)
        for name, one, many in zip(names, alone, together, strict=True)
    ]


def _spectra_and_forces(form: Formulation, cell: str, degree: int, *, comm: MPI.Comm) -> tuple[FloatArray, ...]:
    """As `_spectra`; and the forces after a step that yields, of nodes in the order of their places. Collective."""
    spectra = _spectra(form, cell, degree, comm=comm)
    source, parameters = cast(ModuleType, form), yielding_parameters(form)[0]
    mesh, surfaces = history_mesh(form, cell, degree, comm=comm), _surfaces(form, parameters)
    body = NonlinearModel(mesh, source, parameters, degree=degree, surfaces=surfaces)
    x, layout = body.layout.node_x, body.layout
    moved = layout.at_dofs(0.01 * (x @ FIRST.T + np.sin(x) @ SECOND), owned=False)
    body.commit(moved, dt=trial_step(form))
    forces = layout.displacements(body.force(np.zeros(layout.n_local), dt=0.0))
    rows = parallel.gather_rows(comm, np.hstack([x[: len(forces)], forces]))

    def in_order() -> FloatArray:
        gathered = np.asarray(rows)
        order = np.lexsort(gathered[:, :3].round(6).T)
        return np.asarray(gathered[order, 3:])

    return *spectra, parallel.on_root(comm, in_order)


def _spectra(
    form: Formulation, cell: str, degree: int, *, comm: MPI.Comm
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Eigenvalues of the scaled K and M, and the (6, 6) mass of rigid motions. Collective."""
    parts = [parallel.gather_rows(comm, rows) for rows in _matrices(form, cell, degree, comm)]

    def compute() -> tuple[FloatArray, FloatArray, FloatArray]:
        stiffness, mass, motions = (part for part in parts if part is not None)
        return _eigenvalues(stiffness), _eigenvalues(mass), motions.T @ mass @ motions

    return parallel.on_root(comm, compute)


def _matrices(
    form: Formulation, cell: str, degree: int, comm: MPI.Comm
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """This rank's rows of stiffness, mass and rigid motions, of the body that has such a form. Collective."""
    source, parameters = cast(ModuleType, form), form.reference().parameters
    if optional_entries(form).strain_energy is not None:
        mesh = tagged(distorted_mesh(cell, n=_DIVISIONS, layered=is_layered(form), comm=comm))
        model = ContinuumModel(mesh, source, parameters, degree=degree, surfaces=_surfaces(form, parameters))
        return _rows(model.K), _rows(model.M), model.rigid_motions(np.zeros(3), np.eye(3))
    mesh, surfaces = history_mesh(form, cell, degree, comm=comm), _surfaces(form, parameters)
    body = NonlinearModel(mesh, source, parameters, degree=degree, surfaces=surfaces)
    stiffness, layout = body.tangent(np.zeros(body.layout.n_local), dt=0.0), body.layout
    rigid = layout.rigid_columns(np.zeros(3), np.eye(3))[: body.n_owned]
    return _rows(stiffness), _rows(body.mass()), rigid


def _surfaces(form: Formulation, parameters: Any) -> Surfaces:
    """Where a form has terms on facets they are tried on the whole surface."""
    return {SURFACE: (cast(ModuleType, form), parameters)} if has_facet_terms(form) else {}


def history_mesh(form: Formulation, cell: str, degree: int, *, comm: MPI.Comm) -> TaggedMesh:
    """A distorted mesh of the degree that a form with history needs. Collective."""
    nodes = degree if form.REFERENCE == "UPDATED" else 1
    return tagged(distorted_mesh(cell, n=_DIVISIONS, degree=nodes, layered=is_layered(form), comm=comm))


def _eigenvalues(matrix: FloatArray) -> FloatArray:
    d = equilibration(matrix)
    # the unit of the whole stays, so that a factor common to all entries is seen
    d /= np.exp(np.log(d).mean())
    return np.asarray(np.linalg.eigvalsh(d[:, None] * matrix * d))


def _rows(matrix: PETSc.Mat) -> FloatArray:
    """This rank's rows of a matrix, dense."""
    start, columns, values = matrix.getValuesCSR()
    rows = np.zeros((len(start) - 1, matrix.getSize()[1]))
    rows[np.repeat(np.arange(len(rows)), np.diff(start)), columns] = values
    return rows
