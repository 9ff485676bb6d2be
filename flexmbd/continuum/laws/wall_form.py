"""A formulation of a solid-shell made of a solid's: any law in the strain of a thin wall; docs/writing_a_form.md."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import ufl
from ufl.core.expr import Expr

from flexmbd.continuum.contract.entries import OptionalEntries, optional_entries
from flexmbd.continuum.contract.formulation import load_form, orders
from flexmbd.continuum.contract.quadrature import is_rule
from flexmbd.errors import FormulationError
from flexmbd.forms import _thin_wall, solid_shell
from flexmbd.forms._wall_law import WallLaw
from flexmbd.given import checked

_CELL = "hexahedron"
_REFUSED = ("point_law", "motion", "dissipation", "gyroscopic", "gauge", "surface_energy", "surface_kinetic_energy")
_OF_STEP = ("local_residual", "residual", "update", "stress", "energies", "increment_size")
_AS_IT_IS = ("Parameters", "reference", "local_unknowns", "scaled_yield")


@checked("modulus", error=FormulationError)
def wall_form(
    formulation: str | Path | ModuleType, *, layers: int = 5, modulus: Callable[[Any], Expr] | None = None
) -> ModuleType:
    """Make a solid-shell of a solid's formulation, with its law. Not collective: called on each rank.

    The formulation is one like a form file, for hexahedra of degree 1 in layers (`meshes.wall`), with the parameters of
    the solid; its mean over cells is not taken.  It expands as the law says.

    Args:
        formulation: of a solid whose unknown is the displacement: a module, the name of one in `flexmbd.forms`, or a
            form file's path.
        layers: points through the thickness, from 2 to 99; elastic walls need 2.  Which: docs/writing_a_form.md.
        modulus: of the parameters p, Pa, of the size of the material's stiffness, in UFL arithmetic; it changes no
            result.  None: p.E, which the parameters must have then.

    Raises:
        FormulationError: the solid has unknowns besides the displacement, no hexahedra of degree 1, or what a
            solid-shell cannot carry; another number of points; no modulus.
    """
    form: Any = load_form(formulation)
    optional = optional_entries(form)
    name = form.__name__.rpartition(".")[2]
    if type(layers) is not int or not is_rule(WallLaw(form, layers, _young).rule, _CELL):
        raise FormulationError(f"layers must be a number of points through the thickness, 2 to 99, got {layers!r}")
    _check(form, optional, name)
    if modulus is None:
        if "E" not in {item.name for item in dataclasses.fields(form.Parameters)}:
            raise FormulationError(
                f"{name}: its parameters have no E; say modulus=lambda p: ..., Pa, of the size of the stiffness"
            )
        modulus = _young
    wall = WallLaw(form, layers, modulus)
    made = ModuleType(f"wall({name})")
    entries: dict[str, Any] = {
        "__doc__": f"A solid-shell with the law of {name}, {layers} points through the thickness.",
        "CELLS": (_CELL,),
        "ORDER": dict(solid_shell.ORDER),
        "REFERENCE": "INITIAL",
        "LAYERED": True,
        "element": _thin_wall.element,
        "rigid_motion": _thin_wall.rigid_motion,
        "kinetic_energy": wall.kinetic_energy,
        **{name: vars(form)[name] for name in _AS_IT_IS if name in vars(form)},
    }
    for entry in _OF_STEP:
        if entry in vars(form):
            entries[entry] = _like(vars(form)[entry], getattr(wall, entry))
    if optional.strain_energy is not None:
        entries["strain_energy"] = wall.strain_energy
    if optional.thermal_stretch is not None or optional.thermal_strain is not None:
        entries["thermal_stretch"] = _stretch(optional)
    if optional.state is not None:
        entries["state"] = wall.state
    if optional.state_names is not None:
        entries["state_names"] = wall.state_names
    vars(made).update(entries)
    return made


def _young(p: Any) -> Expr:
    return p.E


def _stretch(optional: OptionalEntries) -> Callable[..., Expr]:
    """A law's stretch of free expansion; of one of small strain 1 + that, as the wall turns by any angle."""
    if optional.thermal_stretch is not None:
        return optional.thermal_stretch
    small: Callable[..., Expr] = optional.thermal_strain  # type: ignore[assignment]

    def stretch(p: Any, dT: Expr) -> Expr:  # noqa: N803
        return ufl.Identity(3) + small(p, dT)

    return stretch


def _check(form: Any, optional: OptionalEntries, name: str) -> None:
    """Refuse forms that cannot be a wall's."""
    if _CELL not in form.CELLS or 1 not in orders(form, _CELL):
        raise FormulationError(f"{name} has no hexahedra of degree 1, of which walls are made")
    if form.element(_CELL, 3, 1).reference_value_shape != (3,):
        raise FormulationError(f"{name} has unknowns besides the displacement; a wall takes the law of a plain solid")
    refused = [entry for entry in _REFUSED if vars(optional)[entry] is not None]
    if refused:
        raise FormulationError(f"{name} has {' and '.join(refused)}, which a wall does not take over")


def _like(function: Callable[..., Any], of_wall: Callable[..., Any]) -> Callable[..., Any]:
    """A function of the wall with the signature of the law's, without the mean over cells."""

    def walled(*arguments: Any, **given: Any) -> Any:
        return of_wall(*arguments, **given)

    found = inspect.signature(function)
    kept = [item for item in found.parameters.values() if item.name != "mean"]
    walled.__signature__ = found.replace(parameters=kept)  # type: ignore[attr-defined]
    return walled
