"""What breaks the contract of a form file: found in its source and by calls, without a mesh."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl

from flexmbd.errors import FormulationError

_FUNCTIONS = {
    "element": 3,
    "strain_energy": 2,
    "kinetic_energy": 2,
    "rigid_motion": 3,
    "stress": 3,
    "reference": 0,
}
"""Callables of the contract and how many positional arguments each takes."""

_IMPORTS = ("__future__", "ufl", "basix.ufl", "dataclasses")
_CELLS = ("tetrahedron", "hexahedron")
_GDIM = 3

# The terminals that UFL evaluates by itself; asked for another it recurses without end.
_EVALUATED = (ufl.classes.ConstantValue, ufl.classes.MultiIndex, ufl.classes.SpatialCoordinate)


def import_violations(origin: str | Path | None) -> list[str]:
    """Find the imports a form file may not have, by reading its source; not collective.

    Args:
        origin: the source file; None (a module made in a session) has no source to read.

    Raises:
        FormulationError: the file cannot be read, or is not Python.
    """
    if origin is None:
        return []
    try:
        tree = ast.parse(Path(origin).read_bytes(), filename=str(origin))
    except (OSError, SyntaxError, ValueError) as error:
        raise FormulationError(f"{origin}: cannot be read as Python: {error}") from error
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level > 0:
            found.append("." * node.level + (node.module or ""))
        elif isinstance(node, ast.ImportFrom):
            # `from basix import ufl` brings basix.ufl
            module = node.module or ""
            found += [f"basix.{a.name}" for a in node.names] if module == "basix" else [module]
    return [
        f"imports {name!r}; a form file imports only ufl, basix.ufl and dataclasses"
        for name in found
        if not any(name == allowed or name.startswith(f"{allowed}.") for allowed in _IMPORTS)
    ]


def violations(module: ModuleType) -> list[str]:
    """List what breaks the contract, as far as it shows without a mesh; not collective.

    What is broken itself is not tried further: a function that is missing, say, is not called.

    Args:
        module: the imported form file.
    """
    found = dict([*_constant_faults(module), *_callable_faults(module)])
    faults = list(found.values())
    if not found.keys() & {"Parameters", "reference"}:
        reference_faults = list(_reference_faults(module))
        faults += reference_faults
        if not reference_faults and not found.keys() & {"CELLS", "ORDER", "element"}:
            faults += _function_faults(module, broken=found.keys())
    return faults


def _constant_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    cells = getattr(module, "CELLS", None)
    if not isinstance(cells, tuple) or not cells or not all(cell in _CELLS for cell in cells):
        yield "CELLS", f"CELLS must be a tuple of names out of {_CELLS}, got {cells!r}"
    order = getattr(module, "ORDER", None)
    if (
        not isinstance(order, Mapping)
        or not order
        or not all(isinstance(n, int) and n > 0 for item in order.items() for n in item)
    ):
        yield "ORDER", f"ORDER must map element degrees to L2 orders, as {{1: 2}}, got {order!r}"
    reference = getattr(module, "REFERENCE", None)
    if reference not in ("INITIAL", "UPDATED"):
        yield "REFERENCE", f'REFERENCE must be "INITIAL" or "UPDATED", got {reference!r}'


def _callable_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    for name, arguments in _FUNCTIONS.items():
        function = getattr(module, name, None)
        if function is None:
            yield name, f"{name} is missing"
        elif not callable(function):
            yield name, f"{name} must be a function, got {function!r}"
        elif not _takes(function, arguments):
            yield name, f"{name} must take {arguments} positional arguments"
    parameters = getattr(module, "Parameters", None)
    if parameters is None:
        yield "Parameters", "Parameters is missing"
    elif not (
        isinstance(parameters, type)
        and dataclasses.is_dataclass(parameters)
        and parameters.__dataclass_params__.frozen  # type: ignore[attr-defined]
    ):
        yield "Parameters", "Parameters must be a frozen dataclass"


def _takes(function: Callable[..., Any], arguments: int) -> bool:
    try:
        inspect.signature(function).bind(*range(arguments))
    except TypeError:
        return False
    return True


def _reference_faults(module: ModuleType) -> Iterator[str]:
    try:
        reference = module.reference()
    except Exception as error:
        yield f"reference() raises {type(error).__name__}: {error}"
        return
    if not isinstance(getattr(reference, "parameters", None), module.Parameters):
        yield "reference().parameters must be an instance of Parameters"
    for name in ("displacement", "body_force"):
        function = getattr(reference, name, None)
        if not callable(function) or not _takes(function, 1):
            yield f"reference().{name} must be a function of the point x"


def _function_faults(module: ModuleType, *, broken: Collection[str]) -> list[str]:
    """Call what is not broken, for every cell and degree, and look at what comes back."""
    places: dict[str, list[str]] = {}
    for cell, degree in itertools.product(module.CELLS, module.ORDER):
        for fault in _result_faults(module, cell, degree, broken=broken):
            places.setdefault(fault, []).append(f"{cell} {degree}")
    return [f"{fault} ({', '.join(where)})" for fault, where in places.items()]


def _result_faults(
    module: ModuleType, cell: str, degree: int, *, broken: Collection[str]
) -> Iterator[str]:
    p = module.reference().parameters
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(_GDIM,)))
    try:
        u = ufl.Coefficient(ufl.FunctionSpace(domain, module.element(cell, _GDIM, degree)))
    except Exception as error:
        yield f"element: {type(error).__name__}: {error}"
        return
    x, constant = ufl.SpatialCoordinate(domain), ufl.as_vector((1.0, 2.0, 3.0))
    calls = {
        "strain_energy": (u, p),
        "kinetic_energy": (u, p),
        "rigid_motion": (x, constant, constant),
        "stress": (u, None, p),
    }
    for name, arguments in calls.items():
        if name in broken:
            continue
        try:
            result = getattr(module, name)(*arguments)
            if name in ("strain_energy", "kinetic_energy"):
                faults = list(_energy_faults(list(result), u))
            elif not isinstance(result, ufl.core.expr.Expr):
                faults = [f"must return a UFL expression, got {type(result).__name__}"]
            elif name == "rigid_motion" and result.ufl_shape != u.ufl_shape:
                faults = [f"must have the unknown's shape {u.ufl_shape}, got {result.ufl_shape}"]
            else:
                faults = []
        except Exception as error:
            faults = [f"{type(error).__name__}: {error}"]
        yield from (f"{name}: {fault}" for fault in faults)


def _energy_faults(terms: Sequence[Any], u: ufl.Coefficient) -> Iterator[str]:
    if not terms:
        yield "has no terms"
    for number, term in enumerate(terms):
        label = f"term {number}"
        if isinstance(term, ufl.Form):
            rules = {repr(integral.metadata()) for integral in term.integrals()}
            yield f"{label} is a form with {len(rules)} rules; give (integrand, Quadrature) pairs"
            continue
        if not isinstance(term, tuple) or len(term) != 2:
            yield f"{label} must be a pair (integrand, Quadrature), got {type(term).__name__}"
            continue
        integrand, rule = term
        degree, scheme = getattr(rule, "degree", None), getattr(rule, "scheme", None)
        if not isinstance(degree, int) or degree < 0 or not isinstance(scheme, str):
            yield f"{label} must state a quadrature degree (int >= 0) and scheme (str), got {rule!r}"
        if not isinstance(integrand, ufl.core.expr.Expr):
            yield f"{label}: the integrand must be a UFL expression, got {type(integrand).__name__}"
        elif integrand.ufl_shape != () or integrand.ufl_free_indices != ():
            yield f"{label}: the integrand must be scalar, has shape {integrand.ufl_shape}"
        else:
            yield from (f"{label}: {fault}" for fault in _rest_faults(integrand, u))


def _rest_faults(integrand: ufl.core.expr.Expr, u: ufl.Coefficient) -> Iterator[str]:
    """Is the integrand finite at u = 0, with its first two derivatives, which give f and K?"""
    if not all(
        part is u or isinstance(part, _EVALUATED)
        for part in ufl.corealg.traversal.unique_pre_traversal(integrand)
        if isinstance(part, ufl.classes.Terminal)
    ):
        return
    space = u.ufl_function_space()
    size = space.value_shape
    values: dict[Any, Callable[..., npt.NDArray[np.float64]]] = {u: _affine(size, seed=None)}
    for order, what in enumerate(("value", "first derivative", "second derivative")):
        if order > 0:
            direction = ufl.Argument(space, order - 1)
            values[direction] = _affine(size, seed=order)
            integrand = ufl.derivative(integrand, u, direction)
        try:
            value = integrand((0.2, 0.3, 0.4), values)
        except (ZeroDivisionError, OverflowError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            yield f"the {what} at u = 0 is not finite"
            return


def _affine(shape: tuple[int, ...], *, seed: int | None) -> Callable[..., npt.NDArray[np.float64]]:
    """A field affine in x, with its derivatives, as UFL evaluates it; zero without a seed."""
    gradient = np.zeros((*shape, _GDIM))
    if seed is not None:
        gradient = np.random.default_rng(seed).normal(size=gradient.shape)

    def field(x: Sequence[float], derivatives: tuple[int, ...] = ()) -> npt.NDArray[np.float64]:
        if len(derivatives) > 1:
            return np.zeros(shape)
        return gradient[..., derivatives[0]] if derivatives else gradient @ np.asarray(x)

    return field
