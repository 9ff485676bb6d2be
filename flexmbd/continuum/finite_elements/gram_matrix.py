"""The Gram matrix behind every inertia integral of a moving flexible body.

For the scalar fields {1, x, y, z, phi_1x, phi_1y, phi_1z, phi_2x, ...} it holds the integrals of
density times one field times another.  All blocks of the mass matrix M(xi) of a floating frame, its
derivatives, and gravity follow from it (compare Ambrosio & Nikravesh 1992, eq. 33-34).

Where a formulation has cross-sections or micro-inertia (`motion`, `section_inertia`) the fields are those
of the material points of the sections; see `flexmbd.continuum.finite_elements.section_inertia`.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.section_inertia import section_gram
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric, total
from flexmbd.errors import FormulationError

# Fields that are multiplied by the mass at a time: the images of all would be two further copies of the modes.
_BLOCK = 48
# Largest relative difference between the mass matrix and what the Gram matrix is made of.
_SAME_MASS = 1e-10


def gram_matrix(
    model: LinearModel, modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> FloatArray:
    """Mass integrals of {1, position, modes}. Collective; the same to the bit on every rank.

    Args:
        model: with the consistent mass.
        modes: (owned dofs, n) in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Returns:
        (4 + 3 n, 4 + 3 n): positions from the body frame, everything in its axes; symmetric.

    Raises:
        FormulationError: on all ranks: the kinetic energy is not density times the displacement's
            velocity squared, nor that of the formulation's `motion` and `section_inertia`.
    """
    if model.has_sections:
        _check_sections(model)
        gram = section_gram(model, modes, p=p, R=R)
        return symmetric(gram)
    dofs, x = _nodes(model)
    n = modes.shape[1]
    fields = np.empty((len(dofs), 4 + 3 * n), order="F")
    fields[:, 0] = 1.0
    fields[:, 1:4] = (x - p) @ R
    for i in range(n):
        fields[:, 4 + 3 * i : 7 + 3 * i] = modes[dofs, i] @ R
    mass = _scalar_mass(model)
    gram = np.zeros((fields.shape[1],) * 2)
    for start in range(0, len(gram), _BLOCK):
        block = slice(start, min(start + _BLOCK, len(gram)))
        part = fields[:, start:].T @ multiply(mass, fields[:, block])
        gram[start:, block], gram[block, start:] = part, part.T
    mass.destroy()
    gram = total(model.comm, gram)
    return symmetric(gram)


def check_inertia(model: LinearModel) -> None:
    """Refuse a body whose inertia has no Gram matrix. Collective.

    Raises:
        FormulationError: on all ranks: as `gram_matrix`.
    """
    if model.has_sections:
        _check_sections(model)
    else:
        _scalar_mass(model).destroy()


def _nodes(model: LinearModel) -> tuple[NDArray[np.int32], FloatArray]:
    """Dofs (n, 3) and positions (n, 3) of this rank's own nodes, in the order of the dofs."""
    dofs = model.displacement_dofs[: model.n_owned_nodes]
    order = np.argsort(dofs[:, 0])
    return dofs[order], model.node_x[order]


def _scalar_mass(model: LinearModel) -> PETSc.Mat:
    """The mass matrix of one displacement component, rows as `_nodes` has them. Collective."""
    start = model.M.getOwnershipRange()[0]
    dofs, _ = _nodes(model)
    rows = PETSc.IS().createGeneral((start + dofs[:, 0]).astype(PETSc.IntType), comm=model.comm)
    mass = model.M.createSubMatrix(rows, rows)
    rows.destroy()
    # shows whether the components are alike, and neither coupled nor anything else has inertia
    test = _some_field(model)
    whole = multiply(model.M, test)
    expected = np.zeros_like(whole)
    expected[dofs, 0] = multiply(mass, test[dofs, 0])
    error = whole - expected
    size, off = (np.sqrt(inner(model.comm, v, v).item()) for v in (whole, error))
    if not off <= _SAME_MASS * size:
        raise FormulationError(_no_gram(model, off / size, "that of a plain displacement field"))
    return mass


def _check_sections(model: LinearModel) -> None:
    """Refuse sections whose energy is not the kinetic energy. Collective."""
    test = np.random.default_rng(model.comm.rank).normal(size=(model.n_owned, 1))
    gram = section_gram(model, test, p=np.zeros(3), R=np.eye(3))
    found = np.trace(gram[4:, 4:])
    expected = inner(model.comm, test, multiply(model.M, test)).item()
    off = abs(found - expected)
    if not off <= _SAME_MASS * expected:
        raise FormulationError(
            _no_gram(model, off / expected, "that of its motion and section_inertia")
        )


def _no_gram(model: LinearModel, off: float, what: str) -> str:
    return (
        f"{model.form_name}: the kinetic energy is not {what} (off by {off:.1e}), so its inertia has "
        "no Gram matrix; where unknowns beside the displacement have mass, motion and section_inertia say which "
        "material points it is of"
    )


def _some_field(model: LinearModel) -> FloatArray:
    """(owned dofs, 1) a smooth field without symmetry, one where there is no displacement."""
    dofs, x = _nodes(model)
    field = np.ones((model.n_owned, 1))
    field[dofs] = np.cos(x @ np.diag([1.0, 2.0, 3.0]) + x[:, [1]])[..., None]
    return field
