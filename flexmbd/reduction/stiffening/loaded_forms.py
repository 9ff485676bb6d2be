"""The forms of a loaded body that may spin: internal and centrifugal forces, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray


@dataclass(frozen=True, eq=False)
class LoadedForms:
    """Internal and centrifugal forces and the derivatives of both, for the values of `at` and `spin`."""

    at: fem.Function
    spin: fem.Constant
    internal: list[fem.Form]
    centrifugal: list[fem.Form]
    stiffness: list[fem.Form]
    softening: list[fem.Form]


def loaded_forms(
    model: LinearModel, groups: Sequence[CellGroup], *, origin: FloatArray, spinning: bool
) -> LoadedForms:
    """Compile. Collective.

    Args:
        model: without springs on facets.
        groups: its cells, with their formulations at the temperature of the state.
        origin: (3,) m, on the axis of the spin.
        spinning: whether there is any.
    """
    at, v = fem.Function(model.space), ufl.TestFunction(model.space)
    spin = fem.Constant(model.mesh.mesh, np.zeros(3))
    work = assembly.internal_work(groups, at, v)
    centrifugal = _centrifugal_work(model, at, spin, origin=origin) if spinning else []
    return LoadedForms(
        at=at,
        spin=spin,
        internal=[fem.form(term) for term in work],
        centrifugal=[fem.form(term) for term in centrifugal],
        stiffness=assembly.derivatives(work, at),
        softening=assembly.derivatives([-term for term in centrifugal], at),
    )


def _centrifugal_work(
    model: LinearModel, at: fem.Function, spin: fem.Constant, *, origin: FloatArray
) -> list[ufl.Form]:
    """Virtual work of the centrifugal forces: the derivative of the kinetic energy of spin x r by r.

    Without what the sections' own rotary inertia adds to it.
    """
    others = [ufl.zero() for _ in range(at.ufl_shape[0] - 3)]

    def turned(place: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        return ufl.as_vector([*ufl.cross(spin, ufl.as_vector([place[i] for i in range(3)])), *others])

    r = ufl.SpatialCoordinate(model.mesh.mesh) - fem.Constant(model.mesh.mesh, origin)
    velocity = turned([r[i] + at[i] for i in range(3)])
    along = turned(ufl.TestFunction(model.space))
    forms = (ufl.derivative(energy, at, along) for energy in model.kinetic_energy(at))
    works = [ufl.replace(ufl.algorithms.expand_derivatives(form), {at: velocity}) for form in forms]
    return [work for work in works if not work.empty()]  # of what a spin does not stretch nothing is left


def assembled_vector(forms: Sequence[fem.Form], model: LinearModel) -> FloatArray:
    """(owned dofs,) the sum of linear forms. Collective."""
    total = np.zeros(model.n_owned)
    for form in forms:
        vector = fem.assemble_vector(form)
        vector.scatter_reverse(la.InsertMode.add)
        total += vector.array[: model.n_owned]
    return total
