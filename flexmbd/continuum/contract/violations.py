"""What breaks the contract of a form file: found in its source and by calls, without a mesh."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from flexmbd.continuum.contract.results import result_faults
from flexmbd.errors import FormulationError

CELLS = ("interval", "triangle", "quadrilateral", "tetrahedron", "hexahedron")
"""Names of the cells a formulation may support; those of less than three dimensions lie in space."""

_REQUIRED = {
    "element": 3,
    "kinetic_energy": 2,
    "rigid_motion": 3,
    "stress": 3,
    "reference": 0,
}
"""Callables of the contract and how many positional arguments each takes."""

_ENERGIES = {"strain_energy": 2, "residual": 4}
"""Exactly one of these."""

_OPTIONAL = {"cell_mean": 3, "energies": 3, "scaled_yield": 2, "increment_size": 3}
"""Callables that a form may have beside."""

_OF_HISTORY = ("scaled_yield", "increment_size")
"""Of these, those that only forms with a history may have."""

_TOGETHER = (
    {"motion": 3, "section_inertia": 1},
    {"state": 1, "update": 3},
    {"local_unknowns": 1, "local_residual": 4},
)
"""Optional: of each group all or none."""

_KEYWORDS = {
    "local_unknowns": ("z", ("residual", "update", "stress")),
    "cell_mean": ("mean", ("residual", "update", "stress", "local_residual", "energies")),
}
"""What a form with the first name hands to the others, by keyword."""

_IMPORTS = ("__future__", "ufl", "basix.ufl", "dataclasses", "typing", "flexmbd.forms")


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
    except OSError as error:
        raise FormulationError(f"{origin}: cannot be read: {error.strerror or error}") from error
    except (SyntaxError, ValueError) as error:
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
        elif isinstance(node, ast.Name) and node.id == "__import__":
            found.append(node.id)
    return [
        f"imports {name!r}; a form file imports only ufl, basix.ufl, dataclasses, typing and other forms"
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


def orders_by_cell(cells: tuple[str, ...], order: Mapping[Any, Any]) -> dict[str, dict[int, int]]:
    """The claimed L2 orders of the displacement by cell and degree.

    Args:
        cells: `CELLS` of a form file.
        order: its `ORDER`: by degree, or by cell and degree where the cells differ.
    """
    by_cell = all(isinstance(item, Mapping) for item in order.values())
    return {cell: dict(order[cell] if by_cell else order) for cell in cells}


def _constant_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    cells = getattr(module, "CELLS", None)
    if not isinstance(cells, tuple) or not cells or not all(cell in CELLS for cell in cells):
        yield "CELLS", f"CELLS must be a tuple of names out of {CELLS}, got {cells!r}"
        cells = None
    order: Any = getattr(module, "ORDER", None)
    by_cell = isinstance(order, Mapping) and cells is not None and set(order) == set(cells)
    if not (all(map(_maps_degrees, order.values())) if by_cell else _maps_degrees(order)):
        yield (
            "ORDER",
            "ORDER must map element degrees to L2 orders, as {1: 2}, or every one of CELLS to such a "
            f'map, as {{"tetrahedron": {{2: 3}}}}, got {order!r}',
        )
    reference = getattr(module, "REFERENCE", None)
    if reference not in ("INITIAL", "UPDATED"):
        yield "REFERENCE", f'REFERENCE must be "INITIAL" or "UPDATED", got {reference!r}'


def _maps_degrees(order: Any) -> bool:
    return (
        isinstance(order, Mapping)
        and bool(order)
        and all(type(n) is int and n > 0 for item in order.items() for n in item)
    )


def _callable_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    """By name; of two about one name the later is the graver."""
    yield from _keyword_faults(module)
    for name, arguments in _REQUIRED.items():
        if not hasattr(module, name):
            yield name, f"{name} is missing"
        else:
            yield from _signature_fault(module, name, arguments)
    for name, arguments in _OPTIONAL.items():
        if hasattr(module, name):
            yield from _signature_fault(module, name, arguments)
    there = [name for name in _ENERGIES if hasattr(module, name)]
    if not there:
        yield "strain_energy", "strain_energy is missing (or residual, where there is no energy)"
    elif len(there) == 2:
        yield "residual", "strain_energy and residual are both there; give one of them"
    for name in there:
        yield from _signature_fault(module, name, _ENERGIES[name])
    for group in _TOGETHER:
        present = [name for name in group if hasattr(module, name)]
        for name in present:
            yield from _signature_fault(module, name, group[name])
        if len(present) == 1:
            (missing,) = group.keys() - set(present)
            yield present[0], f"{present[0]} goes with {missing}, which is missing"
    yield from _history_faults(module, there)
    parameters = getattr(module, "Parameters", None)
    if parameters is None:
        yield "Parameters", "Parameters is missing"
    elif not (
        isinstance(parameters, type)
        and dataclasses.is_dataclass(parameters)
        and parameters.__dataclass_params__.frozen  # type: ignore[attr-defined]
    ):
        yield "Parameters", "Parameters must be a frozen dataclass"


def _history_faults(module: ModuleType, there: list[str]) -> Iterator[tuple[str, str]]:
    """``there``: which of `_ENERGIES`."""
    for name in _OF_HISTORY:
        if hasattr(module, name) and not hasattr(module, "state"):
            yield name, f"{name} goes with state, which is missing: it speaks of a history"
    if hasattr(module, "state") and there == ["strain_energy"]:
        yield "state", "state needs residual(u, v, state, p): strain_energy(u, p) does not see it"


def _signature_fault(module: ModuleType, name: str, arguments: int) -> Iterator[tuple[str, str]]:
    function = getattr(module, name)
    if not callable(function):
        yield name, f"{name} must be a function, got {function!r}"
    elif not _takes(function, arguments):
        yield name, f"{name} must take {arguments} positional arguments"


def _takes(function: Callable[..., Any], arguments: int) -> bool:
    try:
        inspect.signature(function).bind(*range(arguments))
    except (TypeError, ValueError):  # ValueError: a function of C without a signature
        return False
    return True


def _keyword_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    for name, (keyword, takers) in _KEYWORDS.items():
        for taker in takers if hasattr(module, name) else ():
            function = getattr(module, taker, None)
            if callable(function) and not _takes_keyword(function, keyword):
                yield taker, f"{taker} must take {keyword!r} as a keyword argument, since there is {name}"


def _takes_keyword(function: Callable[..., Any], keyword: str) -> bool:
    try:
        found = inspect.signature(function).parameters
    except ValueError:  # a function of C without a signature
        return False
    return keyword in found or any(item.kind is inspect.Parameter.VAR_KEYWORD for item in found.values())


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
    for cell, orders in orders_by_cell(module.CELLS, module.ORDER).items():
        for degree in orders:
            for fault in result_faults(module, cell, degree, broken=broken):
                places.setdefault(fault, []).append(f"{cell} {degree}")
    return [f"{fault} ({', '.join(where)})" for fault, where in places.items()]
