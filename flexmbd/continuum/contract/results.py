"""What the functions of a form file return for a cell and a degree, looked at without a mesh."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Collection, Iterator
from types import ModuleType
from typing import Any

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl

from flexmbd.continuum.compat import topological_dimension
from flexmbd.continuum.contract.dof_layout import check_element
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.terms import term_faults
from flexmbd.continuum.contract.ufl_values import NoValueError, Terminals, evaluate
from flexmbd.errors import FormulationError

_GDIM = 3
_POINT = (0.2, 0.3, 0.4)

_SIZES = (
    ufl.classes.JacobianDeterminant,
    ufl.classes.CellVolume,
    ufl.classes.CellDiameter,
    ufl.classes.Circumradius,
    ufl.classes.MinCellEdgeLength,
    ufl.classes.MaxCellEdgeLength,
)

_DERIVATIVES = ("value", "first derivative", "second derivative", "third derivative")


_ARITHMETIC = (
    "the parameters may be symbols, whose values are not known yet: use them in UFL arithmetic only, not in `if`, "
    "float(), min() and the like, and check their ranges in Parameters"
)

FloatArray = npt.NDArray[np.float64]


class _Unknown:
    """The symbols a form file's functions are called with, on one cell and degree."""

    def __init__(self, module: ModuleType, cell: str, degree: int) -> None:
        self.cell = cell
        self.domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(_GDIM,)))
        element = module.element(cell, _GDIM, degree)
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
            ufl.classes.SpatialCoordinate: np.array(_POINT),
            ufl.classes.CellCoordinate: np.full(dim, 0.25),
            ufl.classes.Jacobian: axes[:, :dim],
            ufl.classes.JacobianInverse: axes[:, :dim].T,
            ufl.classes.CellNormal: axes[:, -1],
            **dict.fromkeys(_SIZES, np.array(1.0)),
        }
        self.geometry = {kind: _constant(value) for kind, value in constants.items()}

        self.parameters, values = _symbols(module.reference().parameters, self.domain)
        self.geometry.update({symbol: _constant(value) for symbol, value in values.items()})

    def evaluate(self, expression: ufl.core.expr.Expr, fields: Terminals) -> float | None:
        """A scalar at a point, NaN or infinite where it has no value; None where only a mesh has one."""
        try:
            return evaluate(expression, {**self.geometry, **fields})
        except NoValueError:
            return None


def result_faults(
    module: ModuleType, cell: str, degree: int, *, broken: Collection[str]
) -> Iterator[str]:
    """What is wrong with what the functions return; not collective.

    Args:
        module: a form file whose constants, `element` and `reference` are in order.
        cell: one of its cells.
        degree: one of its degrees on that cell.
        broken: names that shall not be called.
    """
    try:
        unknown = _Unknown(module, cell, degree)
    except FormulationError as error:
        yield f"element: {error}"
        return
    except Exception as error:
        yield f"element: {type(error).__name__}: {error}"
        return
    for name in _CHECKS:
        if name in broken or name not in vars(module):
            continue
        try:
            faults = list(_CHECKS[name](module, unknown))
        except Exception as error:
            faults = [f"{type(error).__name__}: {error}"]
            if _runs_with_numbers(name, module, unknown):
                faults = [f"{faults[0]}; {_ARITHMETIC}"]
        yield from (f"{name}: {fault}" for fault in faults)


def _runs_with_numbers(name: str, module: ModuleType, unknown: _Unknown) -> bool:
    numbers = copy.copy(unknown)
    numbers.parameters = module.reference().parameters
    try:
        list(_CHECKS[name](module, numbers))
    except Exception:  # the first error stands
        return False
    return True


def _strain_energy(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    terms = module.strain_energy(unknown.u, unknown.parameters)
    # the second derivative is the stiffness, the third the geometric stiffness
    yield from term_faults(terms, unknown.cell, lambda integrand: _rest_faults(integrand, unknown, derivatives=3))


def _kinetic_energy(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    def look(integrand: ufl.core.expr.Expr) -> Iterator[str]:
        yield from _rest_faults(integrand, unknown, derivatives=2)
        if _slope_at_rest(integrand, unknown):
            yield (
                "the integrand has a part linear in v: its gyroscopic forces are carried neither by bodies nor by "
                "records; leave it out, or let a rotor of its own carry the angular momentum"
            )

    yield from term_faults(module.kinetic_energy(unknown.u, unknown.parameters), unknown.cell, look)


def _residual(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    p = unknown.parameters
    terms = module.residual(unknown.u, unknown.v, _initial_state(module, unknown), p, **solved(module, p))

    def look(integrand: ufl.core.expr.Expr) -> Iterator[str]:
        try:
            ufl.algorithms.compute_form_data(integrand * ufl.dx(domain=unknown.domain))
            linear = unknown.v in ufl.algorithms.extract_arguments(integrand)
        except ufl.algorithms.check_arities.ArityMismatch:
            linear = False
        if linear:
            yield from _rest_faults(integrand, unknown, derivatives=2)
        else:
            yield "the integrand must be linear in v"

    yield from term_faults(terms, unknown.cell, look)


def _rigid_motion(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    t, w = ufl.as_vector((1.0, 2.0, 3.0)), ufl.as_vector((-2.0, 5.0, 7.0))
    motion = module.rigid_motion(unknown.x, t, w)
    yield from _expression_faults(motion, unknown.u.ufl_shape, "the unknown's shape")
    if getattr(motion, "ufl_shape", None) == unknown.u.ufl_shape:
        exact = np.array([1.0, 2.0, 3.0]) + np.cross([-2.0, 5.0, 7.0], _POINT)
        found = [unknown.evaluate(motion[i], {}) for i in range(_GDIM)]
        if None not in found and not np.allclose(np.array(found, dtype=float), exact, rtol=1e-12):
            yield "its first three components must be the displacement, translation + rotation x x"


def _stress(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    p = unknown.parameters
    stress = module.stress(unknown.u, _initial_state(module, unknown), p, **solved(module, p))
    yield from _expression_faults(stress, None, "")


def _reference(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    problem = module.reference()
    for name in ("displacement", "body_force"):
        value = getattr(problem, name)(unknown.x)
        faults = list(_expression_faults(value, None, ""))
        if not faults and value.ufl_shape not in ((_GDIM,), unknown.u.ufl_shape):
            faults = [f"must have the shape (3,) or the unknown's {unknown.u.ufl_shape}, got {value.ufl_shape}"]
        yield from (f"{name} {fault}" for fault in faults)


def _motion(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    sections = _section_dimension(unknown)
    if sections == 0:
        yield "is for lines and surfaces: a solid has no section"
        return
    xi = ufl.as_vector([0.1, 0.2][:sections])
    moved = module.motion(unknown.u, xi, unknown.parameters)
    yield from _expression_faults(moved, (_GDIM,), "the shape of a displacement")


def _section_inertia(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    inertia = ufl.as_matrix(module.section_inertia(unknown.parameters))
    size = 1 + _section_dimension(unknown)
    yield from _expression_faults(inertia, (size, size), "the shape of {1, xi} by {1, xi}")


def _section_dimension(unknown: _Unknown) -> int:
    return _GDIM - topological_dimension(unknown.domain)


def _update(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    state = _initial_state(module, unknown)
    if len(state.ufl_shape) != 1:
        yield f"needs a state(p) that is a vector, of shape (n,), got {state.ufl_shape}"
        return
    new = module.update(unknown.u, state, unknown.parameters, **solved(module, unknown.parameters))
    yield from _expression_faults(new, state.ufl_shape, "the shape of state(p)")


def _local_residual(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    p = unknown.parameters
    begin = module.local_unknowns(p)
    if begin is None:
        return
    z = ufl.as_ufl(begin)
    result = module.local_residual(z, unknown.u, _initial_state(module, unknown), p)
    yield from _expression_faults(result, z.ufl_shape, "the shape of local_unknowns(p)")


def _cell_mean(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    mean = module.cell_mean(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from _expression_faults(mean, (), "the shape of a scalar")


def _energies(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    terms = module.energies(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from term_faults(terms.values(), unknown.cell, lambda integrand: iter(()))


def _increment_size(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    size = module.increment_size(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from _expression_faults(size, (), "the shape of a scalar")


def _scaled_yield(module: ModuleType, unknown: _Unknown) -> Iterator[str]:
    reference = module.reference()
    for p in (reference.parameters, *getattr(reference, "yielding", ())):
        raised = module.scaled_yield(p, 2.0)
        if not isinstance(raised, module.Parameters):
            yield f"must return an instance of Parameters, got {type(raised).__name__}"
        elif _shapes(raised, unknown) != _shapes(p, unknown):
            yield "must return the same parameters with other numbers, and nothing else"


def _shapes(parameters: Any, unknown: _Unknown) -> list[tuple[int, ...]]:
    """Of the symbols that parameters become."""
    return [value.shape for value in _symbols(parameters, unknown.domain)[1].values()]


def solved(module: Any, p: Any) -> dict[str, Any]:
    """The argument `z` of a form's functions with what its local unknowns begin with; none where it has none."""
    local_unknowns = optional_entries(module).local_unknowns
    begin = None if local_unknowns is None else local_unknowns(p)
    return {} if begin is None else {"z": ufl.as_ufl(begin)}


_CHECKS: dict[str, Callable[[ModuleType, _Unknown], Iterator[str]]] = {
    "strain_energy": _strain_energy,
    "residual": _residual,
    "kinetic_energy": _kinetic_energy,
    "rigid_motion": _rigid_motion,
    "stress": _stress,
    "reference": _reference,
    "motion": _motion,
    "section_inertia": _section_inertia,
    "update": _update,
    "local_residual": _local_residual,
    "cell_mean": _cell_mean,
    "energies": _energies,
    "scaled_yield": _scaled_yield,
    "increment_size": _increment_size,
}


class _Symbol(ufl.Constant):
    """A parameter whose value is not known yet."""

    def __float__(self) -> float:
        # UFL's own looks for a value without end
        raise TypeError("a symbol is not a number")


def _symbols(parameters: Any, domain: ufl.Mesh) -> tuple[Any, dict[Any, FloatArray]]:
    """The parameters as `formulation.symbols` makes them in use, without a mesh; and the symbols' values."""
    twin, values = object.__new__(type(parameters)), {}
    for field in dataclasses.fields(parameters):
        value = getattr(parameters, field.name)
        numbers = value if isinstance(value, tuple) else (value,)
        if numbers and all(isinstance(number, float) for number in numbers):
            symbol = _Symbol(domain, shape=np.shape(value))
            values[symbol], value = np.array(value), symbol
        elif dataclasses.is_dataclass(value):
            value, inner = _symbols(value, domain)
            values.update(inner)
        object.__setattr__(twin, field.name, value)
    return twin, values


def _initial_state(module: ModuleType, unknown: _Unknown) -> Any:
    state = optional_entries(module).state
    return None if state is None else ufl.as_ufl(state(unknown.parameters))


def _expression_faults(value: Any, shape: tuple[int, ...] | None, what: str) -> Iterator[str]:
    if not isinstance(value, ufl.core.expr.Expr):
        yield f"must return a UFL expression, got {type(value).__name__}"
    elif shape is not None and value.ufl_shape != shape:
        yield f"must have {what} {shape}, got {value.ufl_shape}"


def _rest_faults(
    integrand: ufl.core.expr.Expr, unknown: _Unknown, *, derivatives: int
) -> Iterator[str]:
    """Is the integrand finite at u = 0, with the derivatives the machinery takes?"""
    u, space = unknown.u, unknown.space
    size = u.ufl_shape
    values = {u: _affine(size, seed=None), unknown.v: _affine(size, seed=10)}
    for order in range(derivatives + 1):
        if order > 0:
            direction = ufl.Argument(space, order)
            values[direction] = _affine(size, seed=order)
            integrand = ufl.derivative(integrand, u, direction)
        value = unknown.evaluate(integrand, values)
        if value is None:
            return
        if not math.isfinite(value):
            yield f"the {_DERIVATIVES[order]} at u = 0 is not finite"
            return


def _slope_at_rest(integrand: ufl.core.expr.Expr, unknown: _Unknown) -> float:
    """The first derivative at u = 0 along some direction; zero where only a mesh could say, or it has no value."""
    u, direction = unknown.u, ufl.Argument(unknown.space, 1)
    fields = {u: _affine(u.ufl_shape, seed=None), direction: _affine(u.ufl_shape, seed=1)}
    slope = unknown.evaluate(ufl.derivative(integrand, u, direction), fields)
    return 0.0 if slope is None or not math.isfinite(slope) else slope


def _affine(shape: tuple[int, ...], *, seed: int | None) -> Callable[[int], FloatArray]:
    """A field affine in x, and its gradients; zero without a seed."""
    gradient = np.zeros((*shape, _GDIM))
    if seed is not None:
        gradient = np.random.default_rng(seed).normal(size=gradient.shape)

    def field(depth: int) -> FloatArray:
        if depth == 0:
            return np.asarray(gradient @ np.array(_POINT))
        return gradient if depth == 1 else np.zeros((*gradient.shape, *(_GDIM,) * (depth - 1)))

    return field


def _constant(value: FloatArray) -> Callable[[int], FloatArray]:
    return lambda depth: value
