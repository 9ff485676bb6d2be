"""Elastic solid, St Venant-Kirchhoff, with Newtonian viscosity of its own: stress 2 eta dev(d) + zeta tr(d) I at the
strain rate d."""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("tetrahedron", "hexahedron")
ORDER = {1: 2, 2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """Shear and bulk modulus, Pa; density, kg/m^3; shear and bulk viscosity, Pa s."""

    mu: float
    bulk: float
    rho: float
    eta: float
    zeta: float


@dataclass(frozen=True)
class Quadrature:
    """Degree and scheme of a rule."""

    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube with its exact solution."""

    parameters: Parameters

    def displacement(self, x):
        return 1e-3 * ufl.as_vector((ufl.sin(2 * x[1]), ufl.cos(x[0] + x[2]), ufl.sin(x[0] * x[1])))

    def body_force(self, x):
        return -ufl.div(_stress(_strain(self.displacement(x)), self.parameters.mu, self.parameters.bulk))


def element(cell, gdim, degree):
    return basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))


def strain_energy(u, p):
    h = ufl.grad(u)
    strain = (h + h.T + h.T * h) / 2
    return [(ufl.inner(_stress(strain, p.mu, p.bulk), strain) / 2, Quadrature(2 * _degree(u)))]


def dissipation(v, p):
    rate = _strain(v)
    return [(ufl.inner(_stress(rate, p.eta, p.zeta), rate) / 2, Quadrature(2 * _degree(v)))]


def kinetic_energy(v, p):
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * _degree(v) + 2))]


def rigid_motion(x, translation, rotation):
    return translation + ufl.cross(rotation, x)


def stress(u, state, p):
    return _stress(_strain(u), p.mu, p.bulk)


def reference():
    return Reference(Parameters(mu=8.0e10, bulk=1.7e11, rho=7850.0, eta=3.0e5, zeta=1.0e5))


def _strain(u):
    return ufl.sym(ufl.grad(u))


def _stress(strain, shear, bulk):
    return 2 * shear * ufl.dev(strain) + bulk * ufl.tr(strain) * ufl.Identity(3)


def _degree(u):
    return u.ufl_function_space().ufl_element().embedded_superdegree
