"""Results of a form file's functions for a cell and a degree, checked without a mesh."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterator
from types import ModuleType
from typing import Any

import basix
import numpy as np
import ufl

from flexmbd.continuum.compat import topological_dimension
from flexmbd.continuum.contract.dissipation import dissipation_faults
from flexmbd.continuum.contract.entries import STEP, is_rate_dependent, optional_entries
from flexmbd.continuum.contract.gauge import gauge_faults
from flexmbd.continuum.contract.gyroscopic import gyroscopic_faults
from flexmbd.continuum.contract.surface_terms import FACET, surface_energy_faults, surface_kinetic_energy_faults
from flexmbd.continuum.contract.terms import term_faults
from flexmbd.continuum.contract.trial_symbols import GDIM, POINT, TrialSymbols, rest_faults, slope_at_rest, symbols_of
from flexmbd.errors import FormulationError

_ARITHMETIC = (
    "the parameters may be symbols, whose values are not known yet: use them in UFL arithmetic only, not in `if`, "
    "float(), min() and the like, and check their ranges in Parameters"
)


def result_faults(
    module: ModuleType, cell: str, degree: int, *, broken: Collection[str]
) -> Iterator[str]:
    """Faults of the functions' results; not collective.

    Args:
        module: a form file whose constants, `element` and `reference` are in order.
        cell: one of its cells.
        degree: one of its degrees on that cell.
        broken: names that shall not be called.
    """
    try:
        unknown = TrialSymbols(module, cell, degree)
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


def _runs_with_numbers(name: str, module: ModuleType, unknown: TrialSymbols) -> bool:
    numbers = copy.copy(unknown)
    numbers.parameters = module.reference().parameters
    try:
        list(_CHECKS[name](module, numbers))
    except Exception:  # the first error stands
        return False
    return True


def _strain_energy(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    terms = module.strain_energy(unknown.u, unknown.parameters)
    # the second derivative is the stiffness, the third the geometric stiffness
    yield from term_faults(terms, unknown.cell, lambda integrand: rest_faults(integrand, unknown, derivatives=3))


def _kinetic_energy(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    def look(integrand: ufl.core.expr.Expr) -> Iterator[str]:
        yield from rest_faults(integrand, unknown, derivatives=2)
        if slope_at_rest(integrand, unknown):
            yield (
                "the integrand has a part linear in v: write what is linear in v and in u as gyroscopic(u, v, p); "
                "without u it makes no force"
            )

    yield from term_faults(module.kinetic_energy(unknown.u, unknown.parameters), unknown.cell, look)


def _dissipation(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    terms = module.dissipation(unknown.u, unknown.parameters)
    faults = list(term_faults(terms, unknown.cell, lambda integrand: rest_faults(integrand, unknown, derivatives=2)))
    yield from faults
    if not faults and _is_first_of_its_dimension(module, unknown):
        yield from dissipation_faults(terms, unknown, rigid_motion=module.rigid_motion)


def _is_first_of_its_dimension(module: ModuleType, unknown: TrialSymbols) -> bool:
    """Whether the form was not tried before on a cell of that dimension: of the same fields it makes the same there."""
    dimension = topological_dimension(unknown.domain)
    cell = next(one for one in module.CELLS if len(basix.topology(basix.CellType[one])) == dimension + 1)
    degrees = module.ORDER[cell] if cell in module.ORDER else module.ORDER
    return (unknown.cell, unknown.degree) == (cell, next(iter(degrees)))


def _gyroscopic(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    rates = ufl.Coefficient(unknown.space)
    terms = module.gyroscopic(unknown.u, rates, unknown.parameters)
    faults = list(term_faults(terms, unknown.cell, lambda integrand: iter(())))
    yield from faults or gyroscopic_faults(terms, unknown, rates, rigid_motion=module.rigid_motion)


def _gauge(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    if optional_entries(module).residual is not None:
        yield "goes with strain_energy: it is a shift that costs no energy"
        return
    terms = module.strain_energy(unknown.u, unknown.parameters)
    density = sum((integrand for integrand, _ in terms), ufl.as_ufl(0.0))
    yield from gauge_faults(module.gauge(module.reference().parameters), density, unknown)


def _surface_energy(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    terms = module.surface_energy(unknown.u, unknown.parameters)
    faults = list(_facet_term_faults(terms, unknown))
    yield from faults or surface_energy_faults(terms, unknown)


def _surface_kinetic_energy(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    terms = module.surface_kinetic_energy(unknown.u, unknown.parameters)
    faults = list(_facet_term_faults(terms, unknown))
    yield from faults or surface_kinetic_energy_faults(terms, unknown)


def _facet_term_faults(terms: Any, unknown: TrialSymbols) -> Iterator[str]:
    if unknown.cell not in FACET:
        yield "is for facets of solids: a beam or shell has springs and masses of the scene"
        return
    yield from term_faults(
        terms, FACET[unknown.cell], lambda integrand: rest_faults(integrand, unknown, derivatives=2), on_facets=True
    )


def _residual(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    p = unknown.parameters
    given = keywords(module, p, dt=unknown.dt)
    law = optional_entries(module).point_law
    if law is not None:  # at rest there is no stress to look at: one that is the strain
        given["z"] = law(p).following(given["z"], ufl.Identity(6), unknown.u)
    terms = module.residual(unknown.u, unknown.v, _initial_state(module, unknown), p, **given)

    def look(integrand: ufl.core.expr.Expr) -> Iterator[str]:
        try:
            ufl.algorithms.compute_form_data(integrand * ufl.dx(domain=unknown.domain))
            linear = unknown.v in ufl.algorithms.extract_arguments(integrand)
        except ufl.algorithms.check_arities.ArityMismatch:
            linear = False
        if linear:
            yield from rest_faults(integrand, unknown, derivatives=2)
        else:
            yield "the integrand must be linear in v"

    yield from term_faults(terms, unknown.cell, look)


def _rigid_motion(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    t, w = ufl.as_vector((1.0, 2.0, 3.0)), ufl.as_vector((-2.0, 5.0, 7.0))
    motion = module.rigid_motion(unknown.x, t, w)
    yield from _expression_faults(motion, unknown.u.ufl_shape, "the unknown's shape")
    if getattr(motion, "ufl_shape", None) == unknown.u.ufl_shape:
        exact = np.array([1.0, 2.0, 3.0]) + np.cross([-2.0, 5.0, 7.0], POINT)
        found = [unknown.evaluate(motion[i], {}) for i in range(GDIM)]
        if None not in found and not np.allclose(np.array(found, dtype=float), exact, rtol=1e-12):
            yield "its first three components must be the displacement, translation + rotation x x"


def _stress(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    p = unknown.parameters
    stress = module.stress(unknown.u, _initial_state(module, unknown), p, **keywords(module, p, dt=unknown.dt))
    yield from _expression_faults(stress, None, "")


def _reference(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    problem = module.reference()
    for name in ("displacement", "body_force"):
        value = getattr(problem, name)(unknown.x)
        faults = list(_expression_faults(value, None, ""))
        if not faults and value.ufl_shape not in ((GDIM,), unknown.u.ufl_shape):
            faults = [f"must have the shape (3,) or the unknown's {unknown.u.ufl_shape}, got {value.ufl_shape}"]
        yield from (f"{name} {fault}" for fault in faults)


def _motion(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    xi = ufl.as_vector([0.1, 0.2, 0.3][: _section_dimension(unknown)])
    moved = module.motion(unknown.u, xi, unknown.parameters)
    yield from _expression_faults(moved, (GDIM,), "the shape of a displacement")


def _section_inertia(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    inertia = ufl.as_matrix(module.section_inertia(unknown.parameters))
    size = 1 + _section_dimension(unknown)
    yield from _expression_faults(inertia, (size, size), "the shape of {1, xi} by {1, xi}")


def _section_dimension(unknown: TrialSymbols) -> int:
    """How many coordinates a material point has beside its place on the cells."""
    # a solid's are those of its micro-structure
    return (GDIM - topological_dimension(unknown.domain)) or GDIM


def _update(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    state = _initial_state(module, unknown)
    if len(state.ufl_shape) != 1:
        yield f"needs a state(p) that is a vector, of shape (n,), got {state.ufl_shape}"
        return
    new = module.update(unknown.u, state, unknown.parameters, **keywords(module, unknown.parameters, dt=unknown.dt))
    yield from _expression_faults(new, state.ufl_shape, "the shape of state(p)")


def _local_residual(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    p = unknown.parameters
    begin = module.local_unknowns(p)
    if begin is None:
        return
    z = ufl.as_ufl(begin)
    step = step_keyword(module, unknown.dt)
    result = module.local_residual(z, unknown.u, _initial_state(module, unknown), p, **step)
    yield from _expression_faults(result, z.ufl_shape, "the shape of local_unknowns(p)")


def _cell_mean(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    mean = module.cell_mean(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from _expression_faults(mean, (), "the shape of a scalar")


def _energies(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    terms = module.energies(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from term_faults(terms.values(), unknown.cell, lambda integrand: iter(()))


def _increment_size(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    size = module.increment_size(unknown.u, _initial_state(module, unknown), unknown.parameters)
    yield from _expression_faults(size, (), "the shape of a scalar")


def _scaled_yield(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    reference = module.reference()
    for p in (reference.parameters, *getattr(reference, "yielding", ())):
        raised = module.scaled_yield(p, 2.0)
        if not isinstance(raised, module.Parameters):
            yield f"must return an instance of Parameters, got {type(raised).__name__}"
        elif _shapes(raised, unknown) != _shapes(p, unknown):
            yield "must return the same parameters with other numbers, and nothing else"


def _state_names(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    names, (n,) = module.state_names(unknown.parameters), _initial_state(module, unknown).ufl_shape
    counts = list(names.values())
    if not all(isinstance(name, str) and name for name in names) or not all(type(k) is int and k > 0 for k in counts):
        yield f"must give the number of components of each part of the history by its name, got {names!r}"
    elif sum(counts) != n:
        yield f"names {sum(counts)} components of a history of {n}"


def _expansion_faults(name: str, at_rest: float) -> Callable[[ModuleType, TrialSymbols], Iterator[str]]:
    """A check of `thermal_stretch` or `thermal_strain`, whose diagonal has a given value without a rise."""

    def check(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
        cold = vars(module)[name](unknown.parameters, ufl.as_ufl(0.0))
        faults = list(_expression_faults(cold, (GDIM, GDIM), "the shape"))
        yield from faults
        if not faults:
            found = [unknown.evaluate(cold[i, j], {}) for i in range(GDIM) for j in range(GDIM)]
            wanted = at_rest * np.eye(GDIM).ravel()
            if None not in found and not np.allclose(np.array(found, dtype=float), wanted, rtol=0.0, atol=1e-12):
                yield f"must be {'the identity' if at_rest else 'zero'} at dT = 0, the rise above the stress-free state"

    return check


def _thickness(module: ModuleType, unknown: TrialSymbols) -> Iterator[str]:
    yield from _expression_faults(ufl.as_ufl(module.thickness(unknown.parameters)), (), "the shape of a scalar")


def _shapes(parameters: Any, unknown: TrialSymbols) -> list[tuple[int, ...]]:
    """Of the symbols that parameters become."""
    return [value.shape for value in symbols_of(parameters, unknown.domain)[1].values()]


def keywords(module: Any, p: Any, *, dt: Any) -> dict[str, Any]:
    """The arguments `z` and `dt` of a form's functions, where it has them: where z begins, and the step's length."""
    return {**solved(module, p), **step_keyword(module, dt)}


def step_keyword(module: Any, dt: Any) -> dict[str, Any]:
    """The argument `dt` of a form's functions; none where stress depends on no rates."""
    return {STEP: ufl.as_ufl(dt)} if is_rate_dependent(module) else {}


def solved(module: Any, p: Any) -> dict[str, Any]:
    """The argument `z` of a form's functions with what its local unknowns begin with; none where it has none."""
    law = optional_entries(module).point_law
    if law is not None:
        return {"z": law(p).at_rest()}
    local_unknowns = optional_entries(module).local_unknowns
    begin = None if local_unknowns is None else local_unknowns(p)
    return {} if begin is None else {"z": ufl.as_ufl(begin)}


_CHECKS: dict[str, Callable[[ModuleType, TrialSymbols], Iterator[str]]] = {
    "strain_energy": _strain_energy,
    "residual": _residual,
    "kinetic_energy": _kinetic_energy,
    "dissipation": _dissipation,
    "gyroscopic": _gyroscopic,
    "gauge": _gauge,
    "surface_energy": _surface_energy,
    "surface_kinetic_energy": _surface_kinetic_energy,
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
    "state_names": _state_names,
    "thermal_stretch": _expansion_faults("thermal_stretch", 1.0),
    "thermal_strain": _expansion_faults("thermal_strain", 0.0),
    "thickness": _thickness,
}


def _initial_state(module: ModuleType, unknown: TrialSymbols) -> Any:
    state = optional_entries(module).state
    return None if state is None else ufl.as_ufl(state(unknown.parameters))


def _expression_faults(value: Any, shape: tuple[int, ...] | None, what: str) -> Iterator[str]:
    if not isinstance(value, ufl.core.expr.Expr):
        yield f"must return a UFL expression, got {type(value).__name__}"
    elif shape is not None and value.ufl_shape != shape:
        yield f"must have {what} {shape}, got {value.ufl_shape}"
