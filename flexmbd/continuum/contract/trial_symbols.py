"""The symbols that a form file's functions are called with, and values of what they return, without a mesh."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from functools import cached_property
from types import ModuleType
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl

from flexmbd.continuum.compat import topological_dimension
from flexmbd.continuum.contract.dof_layout import check_element
from flexmbd.continuum.contract.shared_nodes import share_nodes
from flexmbd.continuum.contract.ufl_values import NoValueError, Terminals, evaluate_expanded
from flexmbd.errors import FormulationError

FloatArray = npt.NDArray[np.float64]

GDIM = 3
"""Dimension of space."""

POINT = (0.2, 0.3, 0.4)
"""Where expressions are evaluated."""

_SIZES = (
    ufl.classes.JacobianDeterminant,
    ufl.classes.CellVolume,
    ufl.classes.CellDiameter,
    ufl.classes.Circumradius,
    ufl.classes.MinCellEdgeLength,
    ufl.classes.MaxCellEdgeLength,
)

_DERIVATIVES = ("value", "first derivative", "second derivative", "third derivative")


class TrialSymbols:
    """The symbols a form file's functions are called with, on one cell and degree."""

    def __init__(self, module: ModuleType, cell: str, degree: int, *, parameters: Any = None) -> None:
        """Not collective.

        Args:
            module: a form file whose constants, `element` and `reference` are in order.
            cell: one of its cells.
            degree: one of its degrees on that cell.
            parameters: whose values the symbols have; those of its reference if None.
        """
        self.cell, self.degree, self._module = cell, degree, module
        self.domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(GDIM,)))
        element = module.element(cell, GDIM, degree)
        if not isinstance(element, basix.ufl._ElementBase):
            raise FormulationError(f"must return a basix.ufl element, got {type(element).__name__}")
        check_element(element, name=module.__name__.rpartition(".")[2])
        self.space = ufl.FunctionSpace(self.domain, element)
        self.u = ufl.Coefficient(self.space)
        self.v = ufl.TestFunction(self.space)
        self.x = ufl.SpatialCoordinate(self.domain)

        # a cell of unit size that lies askew
        axes = np.linalg.qr(np.array([[2.0, 1, 1], [1, 2, 1], [1, 1, 2]]))[0]
        dim = topological_dimension(self.domain)
        constants = {
            ufl.classes.SpatialCoordinate: np.array(POINT),
            ufl.classes.CellCoordinate: np.full(dim, 0.25),
            ufl.classes.Jacobian: axes[:, :dim],
            ufl.classes.JacobianInverse: axes[:, :dim].T,
            ufl.classes.CellNormal: axes[:, -1],
            ufl.classes.FacetNormal: axes[:, -1],
            **dict.fromkeys(_SIZES, np.array(1.0)),
        }
        self.geometry = {kind: _constant(value) for kind, value in constants.items()}

        self.parameters, values = symbols_of(
            module.reference().parameters if parameters is None else parameters, self.domain
        )
        self.geometry.update({symbol: _constant(value) for symbol, value in values.items()})
        self.dt = _Symbol(self.domain)
        self.geometry[self.dt] = _constant(np.array(0.0))

    @cached_property
    def moved(self) -> npt.NDArray[np.bool_]:
        """(components of u,) which of them a rigid motion moves: displacements and rotations, not a pressure."""
        vectors = [ufl.as_vector(values) for values in ((0.3, 0.5, 0.7), (1.0, 2.0, 3.0), (0.2, -0.4, 0.9))]
        motion = self._module.rigid_motion(*vectors)
        values = [self.evaluate(motion[i], {}) for i in range(int(np.prod(self.u.ufl_shape, dtype=int)))]
        return np.array([value is None or value != 0.0 for value in values])

    def evaluate(self, expression: ufl.core.expr.Expr, fields: Terminals) -> float | None:
        """A scalar at a point, NaN or infinite where it has no value; None where only a mesh has one."""
        return self.evaluate_expanded(ufl.algorithms.expand_derivatives(share_nodes(expression)), fields)

    def evaluate_expanded(self, expression: ufl.core.expr.Expr, fields: Terminals) -> float | None:
        """The same of an expression whose derivatives are carried out."""
        try:
            return evaluate_expanded(expression, {**self.geometry, **fields})
        except NoValueError:
            return None


class _Symbol(ufl.Constant):
    """A parameter whose value is not known yet."""

    def __float__(self) -> float:
        # UFL's own looks for a value without end
        raise TypeError("a symbol is not a number")


def symbols_of(parameters: Any, domain: ufl.Mesh) -> tuple[Any, dict[Any, FloatArray]]:
    """The parameters as `formulation.symbols` makes them in use, without a mesh; and the symbols' values."""
    twin, values = object.__new__(type(parameters)), {}
    for field in dataclasses.fields(parameters):
        value = getattr(parameters, field.name)
        numbers = value if isinstance(value, tuple) else (value,)
        if numbers and all(isinstance(number, float) for number in numbers):
            symbol = _Symbol(domain, shape=np.shape(value))
            values[symbol], value = np.array(value), symbol
        elif dataclasses.is_dataclass(value):
            value, inner = symbols_of(value, domain)
            values.update(inner)
        object.__setattr__(twin, field.name, value)
    return twin, values


def rest_faults(
    integrand: ufl.core.expr.Expr, unknown: TrialSymbols, *, derivatives: int
) -> Iterator[str]:
    """Is the integrand finite at u = 0, with the derivatives the machinery takes?"""
    u, space = unknown.u, unknown.space
    size = u.ufl_shape
    values = {u: affine(size, seed=None), unknown.v: affine(size, seed=10)}
    for order in range(derivatives + 1):
        if order > 0:
            direction = ufl.Argument(space, order)
            values[direction] = affine(size, seed=order)
            integrand = ufl.derivative(integrand, u, direction)
        value = unknown.evaluate(integrand, values)
        if value is None:
            return
        if not math.isfinite(value):
            yield f"the {_DERIVATIVES[order]} at u = 0 is not finite"
            return


def slope_at_rest(integrand: ufl.core.expr.Expr, unknown: TrialSymbols) -> float:
    """The first derivative at u = 0 along some direction; zero where only a mesh could say, or it has no value."""
    u, direction = unknown.u, ufl.Argument(unknown.space, 1)
    fields = {u: affine(u.ufl_shape, seed=None), direction: affine(u.ufl_shape, seed=1)}
    slope = unknown.evaluate(ufl.derivative(integrand, u, direction), fields)
    return 0.0 if slope is None or not math.isfinite(slope) else slope


def affine(shape: tuple[int, ...], *, seed: int | None) -> Callable[[int], FloatArray]:
    """A field affine in x, and its gradients; zero without a seed."""
    gradient = np.zeros((*shape, GDIM))
    if seed is not None:
        gradient = np.random.default_rng(seed).normal(size=gradient.shape)

    def field(depth: int) -> FloatArray:
        if depth == 0:
            return np.asarray(gradient @ np.array(POINT))
        return gradient if depth == 1 else np.zeros((*gradient.shape, *(GDIM,) * (depth - 1)))

    return field


def _constant(value: FloatArray) -> Callable[[int], FloatArray]:
    return lambda depth: value
