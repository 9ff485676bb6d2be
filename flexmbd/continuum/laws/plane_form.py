"""Plane strain and plane stress by a formulation of a solid, for flat meshes of triangles or quadrilaterals.

The displacement has values in the plane alone, so that its gradient is that of plane strain, and a solid's own terms,
times the thickness, are those of a slice of a prism.  In plane stress the gradient has a part along the normal n,

    grad u + l n n,

with the thickness strain l, a further unknown at each point, for which the work of the solid's stress on n n vanishes.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import ufl
from ufl.algorithms import expand_derivatives
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction
from ufl.domain import extract_unique_domain

from flexmbd.continuum.contract.entries import OptionalEntries, is_rate_dependent, optional_entries
from flexmbd.continuum.contract.formulation import load_form, orders
from flexmbd.continuum.finite_elements.cell_group import form_name
from flexmbd.errors import FormulationError
from flexmbd.given import checked

_CELLS = ("triangle", "quadrilateral")
_STRAIN = 1e-8  # by which the slope of a stress is found
_REFUSED = ("motion", "gyroscopic", "surface_energy", "surface_kinetic_energy")


@checked("plane_strain", error=FormulationError)
def plane_form(formulation: str | Path | ModuleType, *, plane_strain: bool) -> ModuleType:
    """Make a plane formulation of one of a solid. Not collective: called on each rank.

    Its ``Parameters(material=..., t=...)`` are those of the solid and the thickness, m.  A body of it lies in a plane
    along two axes of its mesh, and moves in that plane.

    Args:
        formulation: of a solid whose unknown is the displacement: a module, the name of one in `flexmbd.forms`, or a
            form file's path.
        plane_strain: whether nothing strains along the normal; else there is no stress along it.

    Raises:
        FormulationError: the solid has unknowns besides the displacement, gyroscopic forces or terms on facets; in
            plane stress it refers to the updated configuration, has a compiled law or a dissipation, or depends on
            rates.
    """
    form: Any = load_form(formulation)
    optional, name = optional_entries(form), form_name(form)
    _check(form, optional, name, plane_strain=plane_strain)
    first = next(cell for cell in ("hexahedron", "tetrahedron") if cell in form.CELLS)
    reference = form.reference()
    parameters = _parameters_of(form.Parameters, name)
    trial = parameters(reference.parameters, 1.0)
    made = ModuleType(f"plane_{'strain' if plane_strain else 'stress'}({name})")
    vars(made).update({
        "__doc__": f"{name} in plane {'strain' if plane_strain else 'stress'}.",
        "Parameters": parameters,
        "CELLS": _CELLS,
        "ORDER": dict(orders(form, first)),
        "REFERENCE": form.REFERENCE,
        "element": form.element,
        "rigid_motion": form.rigid_motion,
        "kinetic_energy": lambda v, p: _thick(form.kinetic_energy(v, p.material), p),
        "reference": lambda: PlaneReference(trial, reference),
        "thickness": lambda p: p.t,
        **(_strained(form, optional) if plane_strain else _PlaneStress(form, optional).entries()),
    })  # fmt: skip
    if optional.scaled_yield is not None:
        scaled: Callable[..., Any] = optional.scaled_yield
        vars(made)["scaled_yield"] = lambda p, factor: dataclasses.replace(p, material=scaled(p.material, factor))
    return made


@dataclasses.dataclass(frozen=True)
class PlaneReference:
    """The static problem of the solid, with a thickness.

    Attributes:
        parameters: of the plane form.
        solid: problem.
    """

    parameters: Any
    solid: Any

    def displacement(self, x: Expr) -> Expr:
        """As the solid's."""
        return self.solid.displacement(x)

    def body_force(self, x: Expr) -> Expr:
        """As the solid's."""
        return self.solid.body_force(x)


@functools.cache
def _parameters_of(own: type, name: str) -> type:
    """Of a plane form: the solid's own, and a thickness. The same class at each call."""

    @dataclasses.dataclass(frozen=True)
    class PlaneParameters:
        """The solid's parameters, and the thickness t, m, t > 0."""

        material: Any
        t: float

        def __post_init__(self) -> None:
            if not isinstance(self.material, own):
                raise ValueError(f"material must be the Parameters of {name}, got {self.material!r}")
            if isinstance(self.t, bool) or not isinstance(self.t, (int, float)) or not 0.0 < self.t < float("inf"):
                raise ValueError(f"thickness t must be positive and finite (m), got {self.t!r}")
            object.__setattr__(self, "t", float(self.t))

    PlaneParameters.__qualname__ = "PlaneParameters"
    return PlaneParameters


def _check(form: Any, optional: OptionalEntries, name: str, *, plane_strain: bool) -> None:
    """Refuse forms that cannot be plane."""
    what = {
        "has no cells of a solid": not {"hexahedron", "tetrahedron"} & set(form.CELLS),
        "has unknowns besides the displacement": form.element(form.CELLS[0], 3, min(orders(form, form.CELLS[0])))
        .reference_value_shape != (3,),
        **{f"has {entry}": getattr(optional, entry) is not None for entry in _REFUSED},
    }  # fmt: skip
    if not plane_strain:
        what |= {
            "refers to the updated configuration": form.REFERENCE == "UPDATED",
            "has a compiled law": optional.point_law is not None,
            "has a dissipation": optional.dissipation is not None,
            "depends on rates": is_rate_dependent(form),
        }
    faults = [fault for fault, is_so in what.items() if is_so]
    if faults:
        rest = "take plane_strain=True, or a layer of bricks" if not plane_strain and len(faults) == 1 else (
            "take a solid of the initial configuration whose unknown is the displacement"
        )
        raise FormulationError(f"{name} {' and '.join(faults)}, and cannot be made a plane form: {rest}")


def _thick(terms: Any, p: Any) -> list[Any]:
    """Terms per volume as those per area."""
    return [(p.t * density, rule) for density, rule in terms]


def _strained(form: Any, optional: OptionalEntries) -> dict[str, Any]:
    """The functions of plane strain."""
    found: dict[str, Any] = {}
    for name, place in (
        ("strain_energy", 1), ("residual", 3), ("dissipation", 1), ("state", 0), ("update", 2), ("local_unknowns", 0),
        ("local_residual", 3), ("point_law", 0), ("cell_mean", 2), ("increment_size", 2), ("state_names", 0),
    ):  # fmt: skip
        function = getattr(optional, name)
        if function is not None:
            has_terms = name in ("strain_energy", "residual", "dissipation")
            found[name] = _of_material(function, place, has_terms=has_terms)
    found["stress"] = _of_material(form.stress, 2, has_terms=False)
    if optional.energies is not None:
        energies: Callable[..., Any] = optional.energies

        def thick(u: Expr, state: Expr, p: Any, **given: Any) -> dict[str, Any]:
            terms = energies(u, state, p.material, **given)
            return {name: (p.t * density, rule) for name, (density, rule) in terms.items()}

        found["energies"] = thick
    return found


def _of_material(function: Callable[..., Any], place: int, *, has_terms: bool) -> Callable[..., Any]:
    """A function that takes the solid's parameters out of those at a place of its arguments."""

    @functools.wraps(function)
    def taking(*arguments: Any, **given: Any) -> Any:
        p = arguments[place]
        made = function(*arguments[:place], p.material, *arguments[place + 1 :], **given)
        return _thick(made, p) if has_terms else made

    return taking


@dataclasses.dataclass(frozen=True)
class _PlaneStress:
    """The functions of plane stress; the thickness strain is the first local unknown and the last of the history.

    Attributes:
        form: of the solid.
        optional: its optional functions.
    """

    form: Any
    optional: OptionalEntries

    def entries(self) -> dict[str, Any]:
        """By name."""
        names = ["state", "update", "local_unknowns", "local_residual", "residual", "stress"]
        if self.optional.energies is not None or self.optional.strain_energy is not None:
            names.append("energies")
        if self.optional.state is None or self.optional.state_names is not None:
            names.append("state_names")
        found = {name: getattr(self, name) for name in names}
        # what keeps no history of its own never yields
        return found if self.optional.state is not None else {**found, "scaled_yield": lambda p, factor: p}

    def state(self, p: Any) -> Expr:
        own = [] if self.optional.state is None else self.optional.state(p.material)
        return ufl.as_vector([*own, 0.0])

    def state_names(self, p: Any) -> dict[str, int]:
        own = {} if self.optional.state_names is None else self.optional.state_names(p.material)
        return {**own, "thickness_strain": 1}

    def local_unknowns(self, p: Any) -> Expr:
        return ufl.as_vector([0.0, *_listed(self._own_begin(p))])

    def residual(self, u: Expr, v: Expr, state: Expr, p: Any, *, z: Expr) -> list[Any]:
        own = self._own_z(u, p)
        return [(p.t * _solid(term, u, z, own), rule) for term, rule in self._work(u, v, state, p, own)]

    def local_residual(self, z: Expr, u: Expr, state: Expr, p: Any) -> Expr:
        v, own = ufl.TestFunction(u.ufl_function_space()), self._own_z(u, p)
        pull, pull_at_rest = (
            sum(term for term, _ in self._work(u, v, history, p, own)) for history in (state, self.state(p))
        )
        along = _solid(pull, u, z, own, along_normal=v)
        # over its slope at rest, so that it is of the size of strains
        tried = ufl.as_vector([_STRAIN, *_listed(self._own_begin(p))])
        slope = _solid(pull_at_rest, u, tried, own, along_normal=v, at_rest=True) / _STRAIN
        lack = None
        if own:
            lack = _solid(self.form.local_residual(own["z"], u, _own_state(state), p.material), u, z, own)
        return ufl.as_vector([along / slope, *_listed(lack)])

    def update(self, u: Expr, state: Expr, p: Any, *, z: Expr) -> Expr:
        if self.optional.update is None:
            return ufl.as_vector([z[0]])
        own = self._own_z(u, p)
        new = _solid(self.optional.update(u, _own_state(state), p.material, **own), u, z, own)
        return ufl.as_vector([*_listed(new), z[0]])

    def stress(self, u: Expr, state: Expr, p: Any, *, z: Expr) -> Expr:
        own = self._own_z(u, p)
        return _solid(self.form.stress(u, _own_state(state), p.material, **own), u, z, own)

    def energies(self, u: Expr, state: Expr, p: Any) -> dict[str, Any]:
        strain = state[state.ufl_shape[0] - 1]
        if self.optional.strain_energy is not None:
            terms = self.optional.strain_energy(u, p.material)
            parts = {f"elastic {k}" if k else "elastic": term for k, term in enumerate(terms)}
        else:
            parts = self.optional.energies(u, _own_state(state), p.material)  # type: ignore[misc]
        return {name: (p.t * _thickened(term, u, strain, {}), rule) for name, (term, rule) in parts.items()}

    def _own_begin(self, p: Any) -> Expr | None:
        """What the solid's own local unknowns begin with."""
        begin = None if self.optional.local_unknowns is None else self.optional.local_unknowns(p.material)
        return None if begin is None else ufl.as_ufl(begin)

    def _own_z(self, u: Expr, p: Any) -> dict[str, Expr]:
        """A symbol for the solid's own local unknowns, for they hold gradients where they follow the displacement."""
        begin = self._own_begin(p)
        return {} if begin is None else {"z": ufl.Constant(extract_unique_domain(u), shape=begin.ufl_shape)}

    def _work(self, u: Expr, v: Expr, state: Expr, p: Any, own: dict[str, Expr]) -> list[Any]:
        """The solid's, whose gradients are those in the plane."""
        if self.optional.strain_energy is not None:
            return [(ufl.derivative(term, u, v), rule) for term, rule in self.optional.strain_energy(u, p.material)]
        return list(self.form.residual(u, v, _own_state(state), p.material, **own))


def _own_state(state: Expr) -> Expr | None:
    """The solid's history; None where it has none."""
    kept = state.ufl_shape[0] - 1
    return ufl.as_vector([state[i] for i in range(kept)]) if kept else None


def _listed(value: Expr | None) -> list[Expr]:
    """The components of a scalar or vector; none of nothing."""
    if value is None:
        return []
    return [value[i] for i in range(value.ufl_shape[0])] if value.ufl_shape else [value]


def _solid(value: Expr, u: Expr, z: Expr, own: dict[str, Expr], **options: Any) -> Expr:
    """An expression of the solid with the thickness strain and its own local unknowns out of z."""
    symbols = {}
    for symbol in own.values():
        parts = [z[1 + i] for i in range(*(symbol.ufl_shape or (1,)))]
        symbols[symbol] = ufl.as_vector(parts) if symbol.ufl_shape else parts[0]
    return _thickened(value, u, z[0], symbols, **options)


def _thickened(
    value: Expr,
    u: Expr,
    strain: Expr,
    symbols: dict[Expr, Expr],
    *,
    along_normal: Expr | None = None,
    at_rest: bool = False,
) -> Expr:
    """An expression with a thickness strain in the gradient of the displacement.

    Args:
        value: of the displacement's gradient.
        u: displacement.
        strain: of the thickness.
        symbols: what is to stand in the place of symbols.
        along_normal: a virtual displacement whose gradient is to be that of a unit of thickness strain.
        at_rest: whether the displacement has no gradient besides.
    """
    n = _normal(u)
    gradient = strain * ufl.outer(n, n)
    gradients = {u: gradient if at_rest else ufl.grad(u) + gradient}
    if along_normal is not None:
        gradients[along_normal] = ufl.outer(n, n)
    return map_expr_dag(_Replaced(gradients, symbols), expand_derivatives(apply_algebra_lowering(value)))


class _Replaced(MultiFunction):  # type: ignore[misc]
    """Puts others in the place of some gradients and symbols."""

    def __init__(self, gradients: dict[Expr, Expr], symbols: dict[Expr, Expr]) -> None:
        super().__init__()
        self._gradients, self._symbols = gradients, symbols

    expr = MultiFunction.reuse_if_untouched

    def grad(self, node: Expr) -> Expr:
        """That of a function, whose operands were not looked at."""
        return self._gradients.get(node.ufl_operands[0], node)

    def constant(self, node: Expr) -> Expr:
        """A symbol, or a parameter."""
        return self._symbols.get(node, node)


def _normal(u: Expr) -> Expr:
    """The unit normal of the cells."""
    jacobian = ufl.Jacobian(extract_unique_domain(u))
    first, second = (ufl.as_vector([jacobian[i, k] for i in range(3)]) for k in (0, 1))
    n = ufl.cross(first, second)
    return n / ufl.sqrt(ufl.dot(n, n))
