"""Violations of the contract of a form file: found in its source and by calls, without a mesh."""

from __future__ import annotations

import ast
import dataclasses
import difflib
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from flexmbd.continuum.contract.entries import (
    CONSTANTS,
    ENERGIES,
    EXPANSIONS,
    KEYWORDS,
    LAYERED,
    OF_HISTORY,
    OPTIONAL,
    REQUIRED,
    STEP,
    STEP_TAKERS,
    TOGETHER,
    is_rate_dependent,
    optional_entries,
    takes_step,
)
from flexmbd.continuum.contract.results import result_faults
from flexmbd.errors import FormulationError

CELLS = ("interval", "triangle", "quadrilateral", "tetrahedron", "hexahedron")
"""Names of the cells a formulation may support; those of less than three dimensions lie in space."""

_IMPORTS = ("__future__", "ufl", "basix.ufl", "dataclasses", "typing", "flexmbd.forms")

_BY_KEYWORD = {STEP, *(keyword for keyword, _ in KEYWORDS.values())}

_VISCOSITY = "without a history a stress that depends on rates is the derivative of dissipation(v, p)"

# Two spellings are of one word from this share of letters in the same order on (difflib's ratio): one slip in a word
# of seven letters, where "stretch" is no "stress" and "energy" is not "energies".
_SAME_WORD = 0.85


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
    """List the violations of the contract that can be found without a mesh; not collective.

    What is broken itself is not tried further: a function that is missing, say, is not called.

    Args:
        module: the imported form file.
    """
    found = dict([*_constant_faults(module), *_callable_faults(module)])
    faults = [*found.values(), *_misspelt(module)]
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
    layered = getattr(module, LAYERED, False)
    if not isinstance(layered, bool):
        yield LAYERED, f"{LAYERED} must be True or False, got {layered!r}"
    elif layered and cells is not None and cells != ("hexahedron",):
        yield LAYERED, f'{LAYERED} is of hexahedra, and CELLS must be ("hexahedron",) then, got {cells!r}'


def _maps_degrees(order: Any) -> bool:
    return (
        isinstance(order, Mapping)
        and bool(order)
        and all(type(n) is int and n > 0 for item in order.items() for n in item)
    )


def _misspelt(module: ModuleType) -> Iterator[str]:
    """Names that look like one of the contract's that the file does not have.

    A function of the file's own may be called as it likes; what would be taken for a slip begins with an underscore.
    """
    there = set(vars(module))
    absent = {*CONSTANTS, LAYERED, *REQUIRED, *OPTIONAL} - there
    if there & {*ENERGIES}:
        absent -= {*ENERGIES}
    meant = {name.lower(): name for name in sorted(absent)}
    for name, value in vars(module).items():
        if name.startswith("_") or isinstance(value, ModuleType) or name in {*CONSTANTS, LAYERED, *REQUIRED, *OPTIONAL}:
            continue
        for close in difflib.get_close_matches(name.lower(), meant, n=1, cutoff=_SAME_WORD):
            yield (
                f"{name} is not a name of the contract; did you mean {meant[close]}? "
                f"A name of the file's own that is so close to it must begin with an underscore, as _{name}"
            )


def _callable_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    """By name; of two about one name the later is the graver."""
    yield from _keyword_faults(module)
    for name in REQUIRED:
        if name not in vars(module):
            yield name, f"{name} is missing"
    for name, arguments in {**REQUIRED, **OPTIONAL}.items():
        if name in vars(module):
            yield from _signature_fault(module, name, arguments)
    there = [name for name in ENERGIES if name in vars(module)]
    if not there:
        yield "strain_energy", "strain_energy is missing (or residual, where there is no energy)"
    elif len(there) == 2:
        yield "residual", "strain_energy and residual are both there; give one of them"
    for group in TOGETHER:
        present = [name for name in group if name in vars(module)]
        if len(present) == 1:
            (missing,) = set(group) - set(present)
            yield present[0], f"{present[0]} goes with {missing}, which is missing"
    yield from _history_faults(module)
    expansions = [name for name in EXPANSIONS if name in vars(module)]
    if len(expansions) == 2:
        yield expansions[1], f"{' and '.join(EXPANSIONS)} are both there; give one of them"
    if expansions and getattr(module, "REFERENCE", None) == "UPDATED":
        yield expansions[0], f"{expansions[0]} is for forms whose REFERENCE is \"INITIAL\""
    parameters = getattr(module, "Parameters", None)
    if parameters is None:
        yield "Parameters", "Parameters is missing"
    elif not (
        isinstance(parameters, type)
        and dataclasses.is_dataclass(parameters)
        and parameters.__dataclass_params__.frozen  # type: ignore[attr-defined]
    ):
        yield "Parameters", "Parameters must be a frozen dataclass"


def _history_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    optional = optional_entries(module)
    if is_rate_dependent(module):
        if optional.state is None:
            yield "residual", f"{STEP}, the length of the step, goes with state, which is missing: {_VISCOSITY}"
        for name in STEP_TAKERS:
            if callable(vars(module).get(name)) and not takes_step(vars(module)[name]):
                yield name, f"{name} must take {STEP!r}, the length of the step, as a keyword argument, as others do"
    for name in OF_HISTORY:
        if name in vars(module) and optional.state is None:
            yield name, f"{name} goes with state, which is missing: it speaks of a history"
    if optional.state is not None and optional.residual is None and optional.strain_energy is not None:
        yield "state", "state needs residual(u, v, state, p): strain_energy(u, p) does not see it"


def _signature_fault(module: ModuleType, name: str, arguments: int) -> Iterator[tuple[str, str]]:
    function = getattr(module, name)
    if not callable(function):
        yield name, f"{name} must be a function, got {function!r}"
    elif not _takes(function, arguments):
        yield name, f"{name} must take {arguments} positional arguments"


def _takes(function: Callable[..., Any], arguments: int) -> bool:
    try:
        found = inspect.signature(function)
        # those that are handed over by keyword may have no default
        given = [name for name, item in found.parameters.items() if item.kind is item.KEYWORD_ONLY]
        found.bind(*range(arguments), **dict.fromkeys(_BY_KEYWORD.intersection(given)))
    except (TypeError, ValueError):  # ValueError: a function of C without a signature
        return False
    return True


def _keyword_faults(module: ModuleType) -> Iterator[tuple[str, str]]:
    for name, (keyword, takers) in KEYWORDS.items():
        for taker in takers if name in vars(module) else ():
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
    if is_rate_dependent(module):
        length = getattr(reference, STEP, None)
        if not isinstance(length, float) or not 0.0 < length < float("inf"):
            yield (
                f"reference().{STEP} must be a positive float: the length, s, of the steps in which strains of a "
                f"percent are tried, got {length!r}"
            )
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
