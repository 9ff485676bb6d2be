"""The stiffness by the stress of expansion that is held: what a temperature adds to that of the strains it causes.

The stress of a rise of temperature theta with the static displacement a is C : (strain(a) - expansion(theta)); that of
a is `stress_stiffness`, and this is the other part, the integral of minus C : expansion(theta) : (grad b^T grad c).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from ufl.corealg.map_dag import map_expr_dag

from flexmbd.continuum.contract.substituted_field import SubstitutedField
from flexmbd.continuum.finite_elements.assembly import integral
from flexmbd.continuum.finite_elements.held_expansion import held_expansion
from flexmbd.continuum.finite_elements.temperature import heated_terms
from flexmbd.reduction.stiffening.stress_stiffness import (
    assembled_on_modes,
    is_quadratic,
    marked_strains,
    matrix_of_whole_field,
    of_whole_fields,
    second_order_gradient,
    symmetric_sum,
    without_variables,
)

if TYPE_CHECKING:
    from flexmbd.continuum.finite_elements.linear_model import LinearModel

FloatArray = NDArray[np.float64]


def thermal_stiffness(model: LinearModel, rises: Sequence[fem.Function], modes: FloatArray) -> FloatArray:
    """The part of the geometric stiffness of each rise that its static displacement does not have. Collective.

    Args:
        model: each term of its strain energy is integrated by its own rule, as the stiffness is.
        rises: l of them, K.
        modes: (local dofs including ghosts, n) phi.

    Returns:
        (l, n, n) symmetric, N/m, the same to the bit on every rank.
    """
    total = np.zeros((len(rises), modes.shape[1], modes.shape[1]))
    if total.size == 0:
        return total
    values = np.stack([rise.x.array for rise in rises], axis=1)
    at, whole = fem.Function(rises[0].function_space), model.unknown_columns(modes)
    for forms in _forms(model, at).values():
        for form in forms:
            total += assembled_on_modes(fem.form(form), at, fields=values, modes=whole)
    everywhere = model.comm.bcast(model.comm.reduce(total, root=0), root=0)
    fields = [found for found in map(held_expansion(model).fields, rises) if found is not None]
    more = of_whole_fields(model, np.stack(fields, axis=1), whole) if fields else None
    return np.ascontiguousarray(everywhere if more is None else everywhere + more)


def thermal_stiffness_matrix(model: LinearModel, rise: fem.Function) -> PETSc.Mat | None:
    """The same of one rise over all dofs, as a new AIJ matrix; None where it is zero. Collective."""
    found = [symmetric_sum(model, _forms(model, rise))]
    fields = held_expansion(model).fields(rise)
    if fields is not None:
        found.append(matrix_of_whole_field(model, fields))
    matrices = [one for one in found if one is not None]
    for other in matrices[1:]:
        matrices[0].axpy(1.0, other, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        other.destroy()
    return matrices[0] if matrices else None


def _forms(model: LinearModel, rise: fem.Function) -> dict[int, list[ufl.Form]]:
    """Bilinear forms of the formulations' own unknown by the place of their cell group, without fields of one cell."""
    u, temperature = fem.Function(model.unknown_space), fem.Function(rise.function_space)
    found: dict[int, list[ufl.Form]] = {}
    for k, group in enumerate(model.groups):
        cold = group.formulation.strain_energy(u, group.symbols)
        for term, (density, rule) in zip(cold, heated_terms(group, u, temperature), strict=True):
            if is_quadratic(term, u) or (group.has_sections and not marked_strains(term)):
                continue
            strains = marked_strains((density, rule)) if group.has_sections else []
            if strains:
                integrand = _by_strains(density, strains, u, temperature, rise)
            else:
                integrand = _by_gradient(density, u, temperature, rise)
            form = integral((integrand, rule), group, u.function_space.mesh)
            if not ufl.algorithms.expand_derivatives(form).empty():
                found.setdefault(k, []).append(form)
    return found


def _by_gradient(
    density: ufl.core.expr.Expr, u: fem.Function, temperature: fem.Function, rise: fem.Function
) -> ufl.core.expr.Expr:
    """The second derivative at rest along the rise and along the second-order gradient."""
    small = [fem.Constant(u.function_space.mesh, 0.0) for _ in range(2)]
    s, t = map(ufl.variable, small)
    along = SubstitutedField(u, ufl.zero(u.ufl_shape), t * second_order_gradient(u.function_space))
    expression = map_expr_dag(along, ufl.algorithms.expand_derivatives(density))
    expression = ufl.replace(expression, {temperature: s * rise})
    expression = ufl.algorithms.expand_derivatives(ufl.diff(ufl.diff(expression, t), s))
    return ufl.replace(without_variables(expression), dict.fromkeys(small, ufl.zero()))


def _by_strains(
    density: ufl.core.expr.Expr,
    strains: Sequence[ufl.core.expr.Expr],
    u: fem.Function,
    temperature: fem.Function,
    rise: fem.Function,
) -> ufl.core.expr.Expr:
    """The stress of the rise, times the second derivative of each strain that the form marks as a variable."""
    b, c = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    parts = []
    for strain in strains:
        stress = ufl.derivative(ufl.diff(density, strain), temperature, rise)
        second_order = ufl.derivative(ufl.derivative(strain, u, b), u, c)
        parts.append(ufl.inner(stress, second_order))
    whole = without_variables(ufl.algorithms.expand_derivatives(sum(parts)))
    return ufl.replace(whole, {u: ufl.zero(u.ufl_shape), temperature: ufl.zero()})
