"""Conditions on energies on facets: springs at rest when the body is, and mass that is isotropic.

They are looked at pointwise, by values of the unknown and of its gradient, for the values that the parameters have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import ufl

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.hessian import EXACT, SecondDerivative, is_semidefinite
from flexmbd.continuum.contract.trial_symbols import GDIM, FloatArray, TrialSymbols, affine, slope_at_rest

FACET = {"tetrahedron": "triangle", "hexahedron": "quadrilateral"}
"""The facets of each cell of a solid."""


def surface_energy_faults(terms: Sequence[Any], unknown: TrialSymbols) -> Iterator[str]:
    """Faults of springs on facets whose terms are in order; not collective.

    Of a further unknown, as a pressure or a potential, an energy may be of either sign: the whole has a saddle there.

    Args:
        terms: of the unknown `unknown.u`.
        unknown: the symbols, with the parameters' values.
    """
    density = _sum(terms)
    yield from _rest_faults(density, unknown, linear="a load: Pressure or Traction")
    hessian = SecondDerivative(density, unknown).at(affine(unknown.u.ufl_shape, seed=None))
    if hessian is None:
        return
    moved = np.concatenate([unknown.moved, np.repeat(unknown.moved, GDIM)])  # by values, then by gradients
    if not is_semidefinite(hessian[np.ix_(moved, moved)]):
        yield "is not convex at rest: some displacement would gain energy by it; check the signs of the stiffnesses"


def surface_kinetic_energy_faults(terms: Sequence[Any], unknown: TrialSymbols) -> Iterator[str]:
    """Faults of mass on facets; as `surface_energy_faults`."""
    density = _sum(terms)
    second = SecondDerivative(density, unknown)
    faults = list(_rest_faults(density, unknown, linear="of gyroscopic forces, which nothing carries"))
    yield from faults
    if faults:
        return
    hessian = second.at(affine(unknown.u.ufl_shape, seed=None))
    if hessian is None:
        return
    mass = float(np.trace(hessian[:GDIM, :GDIM])) / GDIM
    if not second.is_constant or not _is_mass(hessian, mass):
        yield (
            "must be m/2 v.v of the displacement's velocity v, with a mass per area m alike in all directions. One "
            "that depends on the direction, as that of a fluid moved along the normal, gives a rigid body another mass "
            "along each axis, for which neither the mass integrals of a record nor a lumped mass have a place"
        )
    elif not mass >= 0.0:
        yield f"has a mass per area of {mass:.6g} kg/m^2; it must be a number from 0 on"


def check_values(form: Any, cell: str, degree: int, *, parameters: Any) -> list[str]:
    """The same of a form that keeps the contract, for the values of other parameters; not collective."""
    module: ModuleType = form
    unknown = TrialSymbols(module, cell, degree, parameters=parameters)
    optional, u, p = optional_entries(form), unknown.u, unknown.parameters
    faults = []
    if optional.surface_energy is not None:
        found = surface_energy_faults(optional.surface_energy(u, p), unknown)
        faults += [f"surface_energy {fault}" for fault in found]
    if optional.surface_kinetic_energy is not None:
        found = surface_kinetic_energy_faults(optional.surface_kinetic_energy(u, p), unknown)
        faults += [f"surface_kinetic_energy {fault}" for fault in found]
    return faults


def _sum(terms: Sequence[Any]) -> ufl.core.expr.Expr:
    return sum((integrand for integrand, _ in terms), ufl.as_ufl(0.0))


def _rest_faults(density: ufl.core.expr.Expr, unknown: TrialSymbols, *, linear: str) -> Iterator[str]:
    at_rest = unknown.evaluate(density, {unknown.u: affine(unknown.u.ufl_shape, seed=None)})
    if at_rest is not None and np.isfinite(at_rest) and at_rest != 0.0:
        yield f"must be zero at rest, is {at_rest:.3g}"
    elif slope_at_rest(density, unknown):
        yield f"must have no linear part, which is that of {linear}"


def _is_mass(hessian: FloatArray, mass: float) -> bool:
    expected = np.zeros_like(hessian)
    expected[:GDIM, :GDIM] = mass * np.eye(GDIM)
    # numbers that are not finite are told with the mass
    return not (abs(hessian - expected).max() > EXACT * abs(hessian).max())
