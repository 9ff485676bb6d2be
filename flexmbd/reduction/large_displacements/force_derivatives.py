"""Second and third derivatives of the internal forces at rest: those of the energy one degree higher."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import ufl
from dolfinx import fem

from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.surface_group import surface_work
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.reduction.stiffening.loaded_forms import assembled_vector


@dataclass(frozen=True, eq=False)
class ForceDerivatives:
    """Internal forces F(u) of a body and derivatives D2F[a, b], D3F[a, b, c] at u = 0; made by `force_derivatives`.

    Those of springs on facets are among them, and `springs` has them alone, where they are not linear.  All are vectors
    on the owned dofs, N per products of the directions (local dofs including ghosts); each call is collective.
    """

    model: LinearModel
    _at: fem.Function
    _directions: tuple[fem.Function, ...]
    _force: Sequence[fem.Form]
    _second: Sequence[fem.Form]
    _third: Sequence[fem.Form]
    springs: ForceDerivatives | None = None

    @property
    def vanish(self) -> bool:
        """Whether the forces are linear in the displacement."""
        return not self._second and not self._third

    def force(self, u: FloatArray) -> FloatArray:
        """F(u)."""
        self._at.x.array[:] = u
        return assembled_vector(self._force, self.model)

    def second(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """D2F[a, b]."""
        return self._along(self._second, a, b)

    def third(self, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
        """D3F[a, b, c]."""
        return self._along(self._third, a, b, c)

    def _along(self, forms: Sequence[fem.Form], *fields: FloatArray) -> FloatArray:
        for direction, field in zip(self._directions, fields, strict=False):
            direction.x.array[:] = field
        return assembled_vector(forms, self.model)


def force_derivatives(model: LinearModel) -> ForceDerivatives:
    """Compile. Collective."""
    u, v = fem.Function(model.space), ufl.TestFunction(model.space)
    alone = _compiled(model, surface_work(model.surfaces, u, v), u) if model.has_surface_energy else None
    whole = _compiled(model, model.internal_work(u, v), u)
    return replace(whole, springs=None if alone is None or alone.vanish else alone)


def _compiled(model: LinearModel, work: list[ufl.Form], u: fem.Function) -> ForceDerivatives:
    directions = tuple(fem.Function(model.space) for _ in range(3))
    return ForceDerivatives(
        model,
        u,
        directions,
        [fem.form(term) for term in work],
        assembly.directional_derivatives_at_rest(work, u, directions[:2]),
        assembly.directional_derivatives_at_rest(work, u, directions),
    )
