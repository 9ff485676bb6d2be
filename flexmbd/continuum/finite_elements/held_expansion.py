"""A body that is heated and held at rest in shape: forces, fields and stress per unit of a rise of temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum.contract.heated_form import heated
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness
from flexmbd.continuum.finite_elements.condition_places import first_dof
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.field_conditions import FieldConditions
from flexmbd.continuum.finite_elements.temperature import heated_groups
from flexmbd.continuum.matrices.blocks import multiply
from flexmbd.continuum.matrices.saddle_point import answer_alone
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]


class HeldExpansion:
    """A body that is heated and held at rest in shape, at small rises: the fields that follow, and the forces.

    With g the derivative of the internal forces by the temperature, along a rise, fields a that no rigid motion moves,
    as pressures and enhanced strains, are -K_aa^-1 g_a, and displacements are held by g_u - K_ua K_aa^-1 g_a. Those of
    one cell are solved for in their cell, others as unknowns of the body.
    """

    def __init__(
        self,
        forms: DiscreteForms,
        *,
        condensed: CondensedStiffness | None,
        stiffness: PETSc.Mat | None = None,
        conditions: FieldConditions | None = None,
    ) -> None:
        """Of a body; not collective.

        Args:
            forms: of the body, cold.
            condensed: its fields of one cell; None: there are none.
            stiffness: K at rest, by which other fields follow; None: they are held too.
            conditions: what holds a potential, built into K; those with values given are in short circuit.
        """
        self._forms, self._condensed, self._stiffness, self._conditions = forms, condensed, stiffness, conditions
        self._space = forms.whole if condensed is not None else forms.space
        self._owned = forms.layout.n_owned

    def forces(self, rise: fem.Function) -> FloatArray:
        """(owned dofs,) N that hold the body, per unit of a rise. Collective, may compile.

        Raises:
            FormulationError: as `fields`.
        """
        shared = self._shared(self._whole(rise))
        follows = self._follow(shared)
        if follows is None or self._stiffness is None:
            return shared
        shared = shared + multiply(self._stiffness, follows[:, None])[:, 0]
        shared[self._others] = 0.0
        return shared

    def fields(self, rise: fem.Function) -> FloatArray | None:
        """(local dofs of the formulations' own unknown including ghosts,) per unit of a rise; None: zero. Collective.

        Raises:
            FormulationError: on all ranks: no finite pressure holds the body.
        """
        whole = self._whole(rise)
        follows = self._follow(self._shared(whole))
        shared = fem.Function(self._forms.space).x
        if follows is not None:
            shared.array[: self._owned] = self._completed(follows)
            shared.scatter_forward()
        if self._condensed is None:
            return None if follows is None else np.asarray(shared.array)
        found = -self._condensed.answer(whole)
        return found if follows is None else found + self._condensed.whole_columns(shared.array[:, None])[:, 0]

    @property
    def _others(self) -> NDArray[np.bool_]:
        """(owned dofs,) which no rigid motion moves."""
        return ~self._forms.layout.kinematic[: self._owned]

    def _follow(self, shared: FloatArray) -> FloatArray | None:
        """(owned dofs,) what no rigid motion moves and cells share, by forces on it; None where there is nothing."""
        if self._stiffness is None or self._forms.is_definite:
            return None
        found = answer_alone(self._stiffness, self._others, -shared)
        if found is None:
            raise FormulationError(
                f"{self._forms.form_name}: what keeps its volume and expands where it is held has no finite pressure; "
                "give it a Poisson's ratio below 1/2, as 0.4999"
            )
        return found

    def _shared(self, whole: FloatArray) -> FloatArray:
        if self._condensed is None:
            forces = whole[: self._owned].copy()
        else:
            forces = self._condensed.shared_forces(whole)
        if self._conditions is not None:
            self._conditions.condense(self._forms.comm, forces, first=first_dof(self._forms))
        return forces

    def _completed(self, follows: FloatArray) -> FloatArray:
        if self._conditions is None:
            return follows
        return self._conditions.completed(self._forms.comm, follows[:, None], first=first_dof(self._forms))[:, 0]

    def _whole(self, rise: fem.Function) -> FloatArray:
        total = fem.Function(self._space).x
        for form in _thermal_work(self._forms.groups, self._space, rise):
            fem.assemble_vector(total.array, fem.form(form))
        total.scatter_reverse(la.InsertMode.add)
        total.scatter_forward()
        return np.asarray(total.array)


class HeatedModel(Protocol):
    """What is asked of a model at rest that is heated."""

    @property
    def forms(self) -> DiscreteForms:
        """The formulations on the mesh."""

    @property
    def condensed(self) -> CondensedStiffness | None:
        """Matrices of the fields of one cell; None: there are none."""

    @property
    def K(self) -> PETSc.Mat:
        """Stiffness, over all dofs."""

    @property
    def conditions(self) -> FieldConditions | None:
        """What holds a potential, built into K."""


def held_expansion(model: HeatedModel) -> HeldExpansion:
    """What holds a body where it is at rest and is heated; not collective."""
    return HeldExpansion(model.forms, condensed=model.condensed, stiffness=model.K, conditions=model.conditions)


def _thermal_work(groups: Sequence[CellGroup], space: fem.FunctionSpace, rise: fem.Function) -> list[ufl.Form]:
    """Virtual work of the forces that hold the body at rest in shape, per unit of a rise, term by term.

    The derivative of the internal forces by the temperature, along the rise, without displacement and temperature.
    """
    u, v = fem.Function(space), ufl.TestFunction(space)
    temperature = fem.Function(rise.function_space)
    work = assembly.internal_work(heated_groups(groups, temperature), u, v)
    forms = [_slope(term, {temperature: rise}, {u: ufl.zero(u.ufl_shape)}) for term in work]
    return [form for form in forms if not form.empty()]


def thermal_stress(group: CellGroup, fields: fem.Function, rise: fem.Function) -> ufl.core.expr.Expr:
    """Stress (3, 3) Pa of one group, without displacement, per unit of a rise; not collective.

    Args:
        group: cold.
        fields: on the formulation's own space, what follows per unit of the rise, as `HeldExpansion.fields`.
        rise: K.
    """
    u, temperature = fem.Function(fields.function_space), fem.Function(rise.function_space)
    warm = replace(group, formulation=heated(group.formulation, temperature))
    sigma = warm.formulation.stress(u, None, warm.symbols)
    return _slope(sigma, {temperature: rise, u: fields}, {u: ufl.zero(u.ufl_shape)})


def _slope(work: Any, along: dict[fem.Function, fem.Function], at: dict[Any, Any]) -> Any:
    """The derivative along some functions, where these and others are what is said, or zero."""
    slope = sum(ufl.algorithms.expand_derivatives(ufl.derivative(work, one, way)) for one, way in along.items())
    cold = ufl.replace(slope, {**{one: ufl.zero(one.ufl_shape) for one in along}, **at})
    return ufl.algorithms.expand_derivatives(cold)
