"""A form at a temperature: the same functions, of the part of the displacement's gradient that is not expansion.

With the stretch F_th of free expansion (`thermal_stretch`) the elastic part of F = I + H is F_e = F F_th^-1, so that

    H_e = (H - (F_th - I)) F_th^-1,    energies det(F_th) W(H_e),    virtual work det(F_th) P(H_e) : (grad v F_th^-1);

with its small strain eps_th (`thermal_strain`) H_e = H - eps_th. Either takes the place of the gradient in all that
the form says of u, so that stress, history, means over cells and equations of points are those of the elastic part.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, cast

import ufl
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract.shared_nodes import share_nodes
from flexmbd.continuum.contract.substituted_field import SubstitutedField
from flexmbd.continuum.contract.ufl_values import NoValueError, evaluate
from flexmbd.errors import FormulationError

#: Functions of the displacement that return expressions, with its place among their arguments.
_EXPRESSIONS = {"stress": 0, "update": 0, "cell_mean": 0, "increment_size": 0, "local_residual": 1}


def expansion_of(form: Any) -> Callable[[Any, Any], Expr] | None:
    """The function (p, dT) that names a form's expansion, or None; not collective."""
    optional = optional_entries(form)
    return optional.thermal_strain if optional.thermal_stretch is None else optional.thermal_stretch


def expands(form: Any, parameters: Any) -> bool:
    """Whether a rise of temperature strains a material whose form names an expansion; not collective."""
    named = expansion_of(form)
    if named is None:
        return False
    cold, warm = (named(parameters, ufl.as_ufl(rise)) for rise in (0.0, 1.0))
    try:
        return any(evaluate(warm[i, j] - cold[i, j], {}) != 0.0 for i in range(3) for j in range(3))
    except NoValueError:  # one that depends on the place
        return True


def heated(form: Formulation, rise: Expr) -> Formulation:
    """The form at a rise of temperature; not collective.

    Args:
        form: with `thermal_stretch` or `thermal_strain`.
        rise: K, above the temperature at which the body is free of stress; a scalar, as a function on the mesh.

    Returns:
        A module with the form's name, in which the functions of the displacement are those of its elastic part.
    """
    module = cast(ModuleType, form)
    twin = ModuleType(module.__name__)
    twin.__dict__.update(vars(module))
    elastic = _ElasticPart(form, rise)
    for name, place in _EXPRESSIONS.items():
        if name in vars(module):
            vars(twin)[name] = elastic.of_expression(vars(module)[name], place)
    for name, wrap in (("strain_energy", elastic.of_terms), ("energies", elastic.of_named_terms)):
        if name in vars(module):
            vars(twin)[name] = wrap(vars(module)[name])
    if "residual" in vars(module):
        vars(twin)["residual"] = elastic.of_work(vars(module)["residual"])
    return cast(Formulation, twin)


class _ElasticPart:
    """Puts the elastic part of the gradient for the gradient, at one rise of temperature."""

    def __init__(self, form: Any, rise: Expr) -> None:
        self._named, self._rise = _expansion(form), rise
        self._is_finite = optional_entries(form).thermal_stretch is not None

    def of_expression(self, function: Callable[..., Any], place: int) -> Callable[..., Any]:
        """A function that returns an expression, of whose arguments u has that place."""

        @functools.wraps(function)
        def elastic(*arguments: Any, **given: Any) -> Any:
            u = arguments[place]
            held, back = _held(given, u)
            return ufl.replace(self._substituted(function(*arguments, **held), u, arguments[-1]), back)

        return elastic

    def of_terms(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function (u, ..., p) that returns terms of the energy."""

        @functools.wraps(function)
        def elastic(*arguments: Any, **given: Any) -> Any:
            return [self._term(term, arguments) for term in function(*arguments, **given)]

        return elastic

    def of_named_terms(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function (u, state, p) that returns terms by name."""

        @functools.wraps(function)
        def elastic(*arguments: Any, **given: Any) -> Any:
            terms: Mapping[str, Any] = function(*arguments, **given)
            return {name: self._term(term, arguments) for name, term in terms.items()}

        return elastic

    def of_work(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function (u, v, state, p) that returns terms of the virtual work, linear in v."""

        @functools.wraps(function)
        def elastic(u: Any, v: Any, state: Any, p: Any, **given: Any) -> Any:
            held, unheld = _held(given, u)
            if not self._is_finite:
                terms = function(u, v, state, p, **held)
                return [(ufl.replace(self._substituted(work, u, p), unheld), rule) for work, rule in terms]
            # the elastic part varies by grad v F_th^-1
            virtual = ufl.Coefficient(u.ufl_function_space())
            back = ufl.inv(self._named(p, self._rise))
            along = SubstitutedField(virtual, v, ufl.grad(v) * back)
            terms = [self._term(term, (u, p)) for term in function(u, virtual, state, p, **held)]
            return [(ufl.replace(map_expr_dag(along, work), unheld), rule) for work, rule in terms]

        return elastic

    def _term(self, term: Any, arguments: tuple[Any, ...]) -> Any:
        density, rule = term
        p = arguments[-1]
        density = self._substituted(density, arguments[0], p)
        return (ufl.det(self._named(p, self._rise)) * density if self._is_finite else density), rule

    def _substituted(self, expression: Expr, u: Any, p: Any) -> Expr:
        elastic = SubstitutedField(u, u, self._gradient(u, p))
        return map_expr_dag(elastic, ufl.algorithms.expand_derivatives(share_nodes(expression)))

    def _gradient(self, u: Any, p: Any) -> Expr:
        """The elastic part of grad(u), of the displacement's three rows and those of further unknowns."""
        rows, expansion = u.ufl_shape[0], self._named(p, self._rise)
        if not self._is_finite:
            return ufl.grad(u) - _padded(expansion, rows)
        return (ufl.grad(u) - _padded(expansion - ufl.Identity(3), rows)) * ufl.inv(expansion)


def _expansion(form: Any) -> Callable[[Any, Any], Expr]:
    named = expansion_of(form)
    if named is None:
        raise FormulationError(f"{form.__name__} names no expansion")
    return named


def _held(given: Mapping[str, Any], u: Any) -> tuple[dict[str, Any], dict[Any, Any]]:
    """Keyword arguments without those that follow u, for which symbols stand, and these symbols' values.

    The solution of the equations at a point follows the elastic part of u already.
    """
    held, values = dict(given), {}
    for name, value in given.items():
        if isinstance(value, Expr) and u in ufl.algorithms.extract_coefficients(value):
            held[name] = ufl.Constant(u.ufl_function_space().ufl_domain(), shape=value.ufl_shape)
            values[held[name]] = value
    return held, values


def _padded(tensor: Expr, rows: int) -> Expr:
    """(rows, 3) the tensor (3, 3) above rows of zeros."""
    if rows == 3:
        return tensor
    return ufl.as_matrix([[tensor[i, j] if i < 3 else 0.0 for j in range(3)] for i in range(rows)])
