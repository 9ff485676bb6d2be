"""Unknowns beside the displacement of a body that moves: without mass, in balance at each instant.

A pressure, an electric potential, a damage: scalars, or components in the body's axes, that couple the cells as the
displacement does.  They move with no node; their equations have no inertia, and hold at every step's end.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]

_REMEDY = (
    "take implicit steps (ImplicitContinuum) where they are rotations, give it none where it is small, load it slowly "
    "(flexmbd.continuum.follow), or reduce it (craig_bampton)"
)


def owned_further_dofs(body: NonlinearModel) -> NDArray[np.int64]:
    """This rank's own dofs beside the displacement, ascending."""
    dofs = body.layout.further_dofs
    return dofs[dofs < body.n_owned]


def kinds_of_unknowns(body: NonlinearModel) -> Sequence[NDArray[np.integer] | slice]:
    """This rank's own dofs of each kind, whose energies are of one sign: all that moves; and of a field what does not.

    Rotations move, wherever the unknown has them. Collective.
    """
    layout = body.layout
    if not layout.has_further:
        return [slice(None)]
    moves = layout.kinematic
    still = [field.dofs[(field.dofs < body.n_owned) & ~moves[field.dofs]] for field in layout.fields]
    return [np.flatnonzero(moves[: body.n_owned]), *still]


def with_unit_rows_of_further_unknowns(body: NonlinearModel, mass: PETSc.Mat) -> PETSc.Mat:
    """A copy of a mass matrix with ones on the diagonal of further unknowns, which may not stand in it. Collective."""
    matrix = mass.copy()
    if not body.layout.has_further:
        return matrix
    ones = PETSc.Mat().createAIJ(mass.getSizes(), nnz=1, comm=body.comm)
    for row in owned_further_dofs(body) + mass.getOwnershipRange()[0]:
        ones.setValue(row, row, 1.0)
    ones.assemble()
    matrix.axpy(1.0, ones, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    ones.destroy()
    return matrix


def refuse_inertia_of_further_unknowns(body: NonlinearModel, lumped: FloatArray) -> None:
    """Refuse further unknowns with mass of their own. Collective.

    Args:
        body: the body.
        lumped: (owned dofs, and maybe ghosts,) its lumped mass.

    Raises:
        FormulationError: on all ranks: there are some.
    """
    if not body.layout.has_further:
        return
    error = None
    if any(body.comm.allgather(bool(lumped[owned_further_dofs(body)].any()))):
        error = FormulationError(
            f"{body.groups[0].form_name} has unknowns besides the displacement with a kinetic energy of their own, "
            f"which a body with history that moves does not carry; {_REMEDY}"
        )
    parallel.raise_collectively(body.comm, error)
