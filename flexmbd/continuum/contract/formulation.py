"""The contract of a form file, as a Protocol over modules, and its loading with all faults at once.

A formulation is a module; it needs no base class and no registration. `load` finds it, checks it
without a mesh, and reports every violation in one error. It makes no collective call, and does the
same on every rank.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import pkgutil
import sys
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import basix.ufl
import ufl
from dolfinx import fem

import flexmbd.forms
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.local_newton import point_keywords
from flexmbd.continuum.contract.shared_nodes import share_nodes
from flexmbd.continuum.contract.violations import import_violations, orders_by_cell, violations
from flexmbd.errors import FormulationError

_SOUND: weakref.WeakSet[ModuleType] = weakref.WeakSet()
"""Modules that were found sound: looking at a long form takes seconds."""


class Quadrature(Protocol):
    """The quadrature rule of one term."""

    @property
    def degree(self) -> int:
        """Polynomial degree that is integrated exactly, at least 0."""

    @property
    def scheme(self) -> str:
        """Name of basix's scheme: "default", "vertex", ..."""


IntegralTerm: TypeAlias = tuple[ufl.core.expr.Expr, Quadrature]
"""A scalar integrand and its own rule; each term is assembled as a form of its own."""


class Reference(Protocol):
    """A static problem whose exact solution is known.

    On the unit cube; for surfaces on the unit square of the plane z = 0, for lines on the unit
    interval of the x axis.
    """

    @property
    def parameters(self) -> Any:
        """The formulation's `Parameters`."""

    def displacement(self, x: ufl.core.expr.Expr, /) -> ufl.core.expr.Expr:
        """Exact displacement, m, at the point x, (3,), or the exact unknown, of the unknown's shape.

        The unknowns that a rigid motion moves are prescribed on the whole boundary. Of others nothing is: they are to
        have none of their natural condition there, as D . n = 0 of an electric potential.
        """

    def body_force(self, x: ufl.core.expr.Expr, /) -> ufl.core.expr.Expr:
        """Force at the point x per unit of the body's measure (N/m^3; for lines N/m), (3,).

        Or of the unknown's shape: then the load on each component of the unknown.
        """


@runtime_checkable
class Formulation(Protocol):
    """The functions and attributes of a form file; see `forms/solid_linear.py` and docs/writing_a_form.md.

    In every function the parameters `p` are read by name and used in UFL arithmetic only: they may
    be numbers, or constants whose values change without a new compilation (`symbols`).

    The first three components of the unknown are the displacement; of a mixed element the first
    sub-element. Optional functions of a form file: `entries.OptionalEntries`.
    """

    @property
    def Parameters(self) -> type[Any]:  # noqa: N802  (a class of the form file)
        """Frozen dataclass of SI values; bad values raise ValueError."""

    @property
    def CELLS(self) -> tuple[str, ...]:  # noqa: N802
        """Names of the cells it supports."""

    @property
    def ORDER(self) -> Mapping[Any, Any]:  # noqa: N802
        """L2 order of the displacement it claims, by element degree.

        Or, where the cells differ, by cell and degree; `orders` reads both.
        """

    @property
    def REFERENCE(self) -> str:  # noqa: N802
        """The configuration its gradients and integrals refer to: "INITIAL" or "UPDATED"."""

    def element(self, cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
        """Element of the unknown."""

    def strain_energy(self, u: ufl.core.expr.Expr, p: Any) -> Sequence[IntegralTerm]:
        """Strain energy, J per unit of the body's measure, as terms whose sum it is.

        With pressures and the like among the unknowns: the functional that is stationary.
        """

    def kinetic_energy(self, v: ufl.core.expr.Expr, p: Any) -> Sequence[IntegralTerm]:
        """Kinetic energy, J per unit of the body's measure, as terms whose sum it is."""

    def rigid_motion(
        self, x: ufl.core.expr.Expr, translation: ufl.core.expr.Expr, rotation: ufl.core.expr.Expr
    ) -> ufl.core.expr.Expr:
        """The unknown, at x, of an infinitesimal rigid motion."""

    def stress(self, u: ufl.core.expr.Expr, state: Any, p: Any) -> ufl.core.expr.Expr:
        """Stress, Pa, for recovery; `state` is None where there is no history."""

    def reference(self) -> Reference:
        """A small problem with its exact solution."""


def orders(form: Formulation, cell: str) -> dict[int, int]:
    """The degrees that a formulation has on a cell, and the L2 order it claims for each.

    Args:
        form: a checked form file.
        cell: one of its `CELLS`.
    """
    return orders_by_cell(form.CELLS, form.ORDER)[cell]


def internal_work(
    form: Formulation, u: ufl.core.expr.Expr, v: ufl.core.expr.Expr, *, p: Any
) -> list[IntegralTerm]:
    """Virtual work of the internal forces at u, without history and time, on v: terms linear in v.

    Args:
        form: with `strain_energy`, whose derivative it then is, or with `residual`.
        u: the unknown, a function or coefficient.
        v: on the same space, a test function for one.
        p: parameters.
    """
    optional = optional_entries(form)
    if optional.residual is not None:
        at_rest = None if optional.state is None else ufl.as_ufl(optional.state(p))
        terms = list(optional.residual(u, v, at_rest, p, **point_keywords(form, u, at_rest, p)))
    else:
        terms = [(ufl.derivative(density, u, v), rule) for density, rule in form.strain_energy(u, p)]
    return [(share_nodes(density), rule) for density, rule in terms]


def load_form(source: str | Path | ModuleType) -> Formulation:
    """Find a formulation and check it against the contract; the same on every rank, not collective.

    A form file is code, which runs when it is loaded: load those whose source is trusted. What it may not import is
    refused before it runs. A file that has not changed is the same module at each call, and is looked at once.

    Args:
        source: a name in `flexmbd.forms`, the path of a form file, or an imported module.

    Raises:
        FormulationError: there is no such form, it cannot be imported, or it breaks the contract;
            the message lists all violations.
    """
    if isinstance(source, ModuleType):
        module = source
        _refuse_imports(getattr(source, "__file__", None), name=source.__name__)
    elif isinstance(source, Path):
        _refuse_imports(source, name=str(source))
        module = _import(f"form_file.{source.stem}", path=source)
    else:
        known = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__) if info.name[0] != "_"]
        if source not in known:
            raise FormulationError(
                f"flexmbd.forms has no {source!r}, only {', '.join(known)}; "
                "for a form file of your own pass a pathlib.Path, and on the command line a path that ends in .py"
            )
        name = f"flexmbd.forms.{source}"
        spec = importlib.util.find_spec(name)
        _refuse_imports(spec.origin if spec is not None else None, name=name)
        module = _import(name, path=None)
    if module not in _SOUND and (faults := violations(module)):
        raise FormulationError(_listed(module.__name__, faults))
    _SOUND.add(module)
    return cast(Formulation, module)


def symbols(parameters: Any, *, mesh: Any) -> Any:
    """The same parameters with each float, and tuple of floats, a DOLFINx constant, also in parts; not collective.

    A form written with them is compiled once for all materials, not once for each value.

    Args:
        parameters: an instance of a formulation's `Parameters`.
        mesh: the mesh, or its UFL domain, the constants live on.
    """
    twin = object.__new__(type(parameters))
    for field in dataclasses.fields(parameters):
        value = getattr(parameters, field.name)
        numbers = value if isinstance(value, tuple) else (value,)
        if numbers and all(isinstance(number, float) for number in numbers):
            value = fem.Constant(mesh, value)
        elif dataclasses.is_dataclass(value):
            value = symbols(value, mesh=mesh)
        # a frozen dataclass, whose range checks do not apply to symbols
        object.__setattr__(twin, field.name, value)
    return twin


def set_symbols(twin: Any, parameters: Any) -> None:
    """Give the constants of `symbols` the values of other parameters of the same kind; not collective."""
    for field in dataclasses.fields(parameters):
        symbol, value = getattr(twin, field.name), getattr(parameters, field.name)
        if isinstance(symbol, fem.Constant):
            symbol.value = value
        elif dataclasses.is_dataclass(value):
            set_symbols(symbol, value)


def _listed(name: str, faults: Sequence[str]) -> str:
    lines = "".join(f"\n  - {fault}" for fault in faults)
    count = f"{len(faults)} violation{'s' if len(faults) > 1 else ''}"
    return f"{name} breaks the contract of a form file ({count}):{lines}"


def _refuse_imports(origin: str | Path | None, *, name: str) -> None:
    """Refuse what a form file may not import, before any of it runs."""
    if faults := import_violations(origin):
        raise FormulationError(_listed(name, faults))


def _import(name: str, *, path: Path | None) -> ModuleType:
    """Import a form file, which runs it."""
    try:
        if path is None:
            return importlib.import_module(name)
        if path.suffix != ".py":
            raise ImportError("not a Python file (.py)")
        # the same file is the same module, so that its Parameters are of one class
        version = path.resolve(), path.read_bytes()
        known = sys.modules.get(name)
        if known is not None and getattr(known, "__form_version__", None) == version:
            return known
        module = ModuleType(name)
        module.__dict__.update(__file__=str(path), __form_version__=version)
        # dataclasses looks its module up by name
        sys.modules[name] = module
        # without Python's cache, which takes a file rewritten within a second for the old one
        exec(compile(version[1], path, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:  # noqa: BLE001  (a form file is foreign code, and may call exit())
        sys.modules.pop(name, None)
        fault = f"it cannot be imported: {type(error).__name__}: {error}"
        raise FormulationError(_listed(str(path or name), [fault])) from error
    return module
