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

from flexmbd.continuum.contract.entries import OptionalEntries, optional_entries
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
            plane stress it refers to the updated configuration, has a compiled law, or a dissipation.
    """
    form: Any = load_form(formulation)
    optional, name = optional_entries(form), form_name(form)
    _check(form, optional, name, plane_strain=plane_strain)
    first = next(cell for cell in ("hexahedron", "tetrahedron") if cell in form.CELLS)
    reference = form.reference()
    parameters = _parameters_of(form, name)
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
        **(_strained(form, optional) if plane_strain else _stressed(form, optional)),
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


def _parameters_of(form: Any, name: str) -> type:
    """Of a plane form: the solid's, and a thickness."""

    @dataclasses.dataclass(frozen=True)
    class Parameters:
        """The solid's parameters, and the thickness t, m, t > 0."""

        material: Any
        t: float

        def __post_init__(self) -> None:
            if not isinstance(self.material, form.Parameters):
                raise ValueError(f"material must be the Parameters of {name}, got {self.material!r}")
            if isinstance(self.t, bool) or not isinstance(self.t, (int, float)) or not 0.0 < self.t < float("inf"):
                raise ValueError(f"thickness t must be positive and finite (m), got {self.t!r}")
            object.__setattr__(self, "t", float(self.t))

    return Parameters


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


def _stressed(form: Any, optional: OptionalEntries) -> dict[str, Any]:
    """The functions of plane stress; the thickness strain is the first local unknown and the last of the history."""

    def own_state(state: Expr, p: Any) -> Expr | None:
        kept = state.ufl_shape[0] - 1
        return ufl.as_vector([state[i] for i in range(kept)]) if kept else None

    def own_z(u: Expr, p: Any) -> dict[str, Expr]:
        """A symbol for the solid's own local unknowns, for they hold gradients where they follow the displacement."""
        begin = None if optional.local_unknowns is None else optional.local_unknowns(p.material)
        if begin is None:
            return {}
        return {"z": ufl.Constant(extract_unique_domain(u), shape=ufl.as_ufl(begin).ufl_shape)}

    def thickened(value: Expr, u: Expr, z: Expr, own: dict[str, Expr], **options: Any) -> Expr:
        """With the thickness strain and the solid's own local unknowns out of z."""
        symbols = {}
        for symbol in own.values():
            n = range(*symbol.ufl_shape) if symbol.ufl_shape else None
            symbols[symbol] = z[1] if n is None else ufl.as_vector([z[1 + i] for i in n])
        return _thickened(value, u, z[0], symbols, **options)

    def work(u: Expr, v: Expr, state: Expr, p: Any, own: dict[str, Expr], step: dict[str, Any]) -> list[Any]:
        """The solid's, whose gradients are those in the plane."""
        if optional.strain_energy is not None:
            return [(ufl.derivative(term, u, v), rule) for term, rule in optional.strain_energy(u, p.material)]
        return list(form.residual(u, v, own_state(state, p), p.material, **own, **step))

    def state(p: Any) -> Expr:
        own = [] if optional.state is None else optional.state(p.material)
        return ufl.as_vector([*own, 0.0])

    def local_unknowns(p: Any) -> Expr:
        begin = None if optional.local_unknowns is None else optional.local_unknowns(p.material)
        own = ufl.as_ufl(begin) if begin is not None else None
        rest = [] if own is None else [own[i] for i in range(own.ufl_shape[0])] if own.ufl_shape else [own]
        return ufl.as_vector([0.0, *rest])

    def residual(u: Expr, v: Expr, state: Expr, p: Any, *, z: Expr, **step: Any) -> list[Any]:
        own = own_z(u, p)
        return [(p.t * thickened(term, u, z, own), rule) for term, rule in work(u, v, state, p, own, step)]

    def local_residual(z: Expr, u: Expr, state: Expr, p: Any, **step: Any) -> Expr:
        v = ufl.TestFunction(u.ufl_function_space())
        own = own_z(u, p)
        along = thickened(sum(term for term, _ in work(u, v, state, p, own, step)), u, z, own, along_normal=v)
        # over its slope at rest, so that it is of the size of strains
        begun = sum(term for term, _ in work(u, v, state_at_rest(p), p, own, step))
        begin = local_unknowns(p)
        tried = ufl.as_vector([_STRAIN, *(begin[i] for i in range(1, begin.ufl_shape[0]))])
        slope = thickened(begun, u, tried, own, along_normal=v, at_rest=True) / _STRAIN
        if not own:
            return ufl.as_vector([along / slope])
        lack = form.local_residual(own["z"], u, own_state(state, p), p.material, **step)
        lack = thickened(lack, u, z, own)
        return ufl.as_vector([along / slope, *([lack[i] for i in range(lack.ufl_shape[0])] if lack.ufl_shape else [lack])])

    state_at_rest = state

    def update(u: Expr, state: Expr, p: Any, *, z: Expr, **step: Any) -> Expr:
        if optional.update is None:
            return ufl.as_vector([z[0]])
        own = own_z(u, p)
        new = thickened(optional.update(u, own_state(state, p), p.material, **own, **step), u, z, own)
        return ufl.as_vector([*(new[i] for i in range(new.ufl_shape[0])), z[0]])

    def stress(u: Expr, state: Expr, p: Any, *, z: Expr, **step: Any) -> Expr:
        own = own_z(u, p)
        return thickened(form.stress(u, own_state(state, p), p.material, **own, **step), u, z, own)

    def energies(u: Expr, state: Expr, p: Any) -> dict[str, Any]:
        strain = state[state.ufl_shape[0] - 1]
        if optional.strain_energy is not None:
            terms = optional.strain_energy(u, p.material)
            parts = {f"elastic {k}" if k else "elastic": term for k, term in enumerate(terms)}
        else:
            parts = optional.energies(u, own_state(state, p), p.material)  # type: ignore[misc]
        return {name: (p.t * _thickened(term, u, strain, {}), rule) for name, (term, rule) in parts.items()}

    found: dict[str, Any] = {
        "state": state, "update": update, "local_unknowns": local_unknowns, "local_residual": local_residual,
        "residual": residual, "stress": stress,
    }  # fmt: skip
    if optional.energies is not None or optional.strain_energy is not None:
        found["energies"] = energies
    if optional.state is None:
        found["scaled_yield"] = lambda p, factor: p  # it never yields
        found["state_names"] = lambda p: {"thickness_strain": 1}
    elif optional.state_names is not None:
        names: Callable[..., Any] = optional.state_names
        found["state_names"] = lambda p: {**names(p.material), "thickness_strain": 1}
    return found


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
