"""The linear solid with springs and mass on facets: stiffness along the normal and across it, mass per area."""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms.solid_linear import CELLS as CELLS
from flexmbd.forms.solid_linear import ORDER as ORDER
from flexmbd.forms.solid_linear import REFERENCE as REFERENCE
from flexmbd.forms.solid_linear import Quadrature, Reference
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion
from flexmbd.forms.solid_linear import strain_energy as strain_energy
from flexmbd.forms.solid_linear import stress as stress


@dataclass(frozen=True)
class Parameters(solid_linear.Parameters):
    """Of the solid; stiffness of the springs along the normal and across it, N/m^3; mass on the facets, kg/m^2."""

    normal: float = 0.0
    across: float = 0.0
    mass: float = 0.0


def surface_energy(u, p):
    along = ufl.dot(u, ufl.FacetNormal(ufl.domain.extract_unique_domain(u)))
    energy = p.normal / 2 * along**2 + p.across / 2 * (ufl.inner(u, u) - along**2)
    return [(energy, Quadrature(2 * _degree(u) + 2))]


def surface_kinetic_energy(v, p):
    return [(p.mass / 2 * ufl.inner(v, v), Quadrature(2 * _degree(v) + 2))]


def reference():
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, normal=3e10, across=1e10, mass=50.0))


def _degree(u):
    return u.ufl_function_space().ufl_element().embedded_superdegree
