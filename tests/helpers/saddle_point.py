"""A form file with pressures: the solid of small strain with its pressure as an unknown of its own.

The functional mu e:e + p div u - p^2 / (2 lambda) is stationary; Taylor and Hood's element.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("tetrahedron", "hexahedron")
ORDER = {2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """E: Pa; nu; rho: kg/m^3."""

    E: float = 1e7
    nu: float = 0.4
    rho: float = 1100.0


@dataclass(frozen=True)
class Quadrature:
    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    parameters: Parameters = Parameters()

    def displacement(self, x):
        return 1e-3 * ufl.as_vector((x[1], x[2], x[0]))

    def body_force(self, x):
        return 0 * x


def element(cell, gdim, degree):
    displacement = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return basix.ufl.mixed_element([displacement, basix.ufl.element("Lagrange", cell, degree - 1)])


def _parts(w):
    return ufl.as_vector([w[i] for i in range(3)]), w[3]


def strain_energy(u, p):
    move, pressure = _parts(u)
    lam, mu = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), p.E / (2 * (1 + p.nu))
    strain = ufl.sym(ufl.grad(move))
    energy = mu * ufl.inner(strain, strain) + pressure * ufl.tr(strain)
    return [(energy, Quadrature(4)), (-(pressure**2) / (2 * lam), Quadrature(4))]


def kinetic_energy(v, p):
    move, _ = _parts(v)
    return [(p.rho / 2 * ufl.inner(move, move), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    return ufl.as_vector([*(translation + ufl.cross(rotation, x)), 0])


def stress(u, state, p):
    move, pressure = _parts(u)
    mu = p.E / (2 * (1 + p.nu))
    return 2 * mu * ufl.sym(ufl.grad(move)) + pressure * ufl.Identity(3)


def reference():
    return Reference()
