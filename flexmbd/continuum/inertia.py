"""The Gram matrix behind every inertia integral of a moving flexible body.

For the scalar fields {1, x, y, z, phi_1x, phi_1y, phi_1z, phi_2x, ...} it holds the integrals of
density times one field times another.  All blocks of the mass matrix M(xi) of seed 3 eq. 3.23, its
derivatives, and gravity follow from it (compare Ambrosio & Nikravesh 1992, eq. 33-34).
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from flexmbd.continuum.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.model import ContinuumModel
from flexmbd.errors import FormulationError

# Largest relative difference between the mass matrix and that of one scalar field a component.
_SCALAR = 1e-10


def gram_matrix(
    model: ContinuumModel, modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> FloatArray:
    """Mass integrals of {1, position, modes}. Collective; the same to the bit on every rank.

    Args:
        model: with the consistent mass.
        modes: (owned dofs, n) displacements in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Returns:
        (4 + 3 n, 4 + 3 n): positions from the body frame, everything in its axes; symmetric.

    Raises:
        FormulationError: on all ranks: the kinetic energy is not density times velocity squared.
    """
    n = modes.shape[1]
    nodes = model.n_owned // 3
    fields = np.empty((nodes, 4 + 3 * n), order="F")
    fields[:, 0] = 1.0
    fields[:, 1:4] = (model.space.tabulate_dof_coordinates()[:nodes] - p) @ R
    for i in range(n):
        fields[:, 4 + 3 * i : 7 + 3 * i] = modes[:, i].reshape(nodes, 3) @ R
    mass = _scalar_mass(model)
    gram = inner(model.comm, fields, multiply(mass, fields))
    mass.destroy()
    return symmetric(gram)


def _scalar_mass(model: ContinuumModel) -> PETSc.Mat:
    """The mass matrix of one displacement component. Collective."""
    start = model.M.getOwnershipRange()[0]
    rows = PETSc.IS().createStride(model.n_owned // 3, start, 3, comm=model.comm)
    mass = model.M.createSubMatrix(rows, rows)
    rows.destroy()
    # one field with no symmetry shows whether the components are alike and not coupled
    x = model.space.tabulate_dof_coordinates()[: model.n_owned // 3]
    field = np.cos(x @ np.diag([1.0, 2.0, 3.0]) + x[:, [1]])
    whole = multiply(model.M, field.reshape(-1, 1)).reshape(-1, 3)
    error = whole - multiply(mass, field)
    size = np.sqrt(inner(model.comm, whole.reshape(-1, 1), whole.reshape(-1, 1)).item())
    off = np.sqrt(inner(model.comm, error.reshape(-1, 1), error.reshape(-1, 1)).item())
    if not off <= _SCALAR * size:
        raise FormulationError(
            f"{model.form_name}: the kinetic energy is not that of a plain displacement "
            f"field (off by {off / size:.1e}), so its inertia has no Gram matrix"
        )
    return mass
