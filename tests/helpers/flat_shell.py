"""A form file of a surface: the flat shell of Reissner and Mindlin, linear, with a penalty on the drilling rotation.

Unknowns are displacement and rotation, both quadratic, and all of it integrated in full.
Reissner 1945, doi:10.1115/1.4009435.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("triangle", "quadrilateral")
ORDER = {2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """Pa; -; kg/m^3; thickness, m."""

    E: float
    nu: float
    rho: float
    t: float


@dataclass(frozen=True)
class Quadrature:
    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    parameters: Parameters

    def displacement(self, x):
        """Stretch, shear, bending and twist, all constant, with the rotations that go with them."""
        a, b = 1e-3, 1e-3
        w = a * x[0] ** 2 / 2 + b * x[0] * x[1]
        return ufl.as_vector((1e-3 * x[0], 2e-3 * x[0], w, b * x[0], -(a * x[0] + b * x[1]), 1e-3))

    def body_force(self, x):
        return 0 * ufl.as_vector((x[0], x[0], x[0]))


def element(cell, gdim, degree):
    return basix.ufl.element("Lagrange", cell, degree, shape=(6,))


def _parts(u):
    return ufl.as_vector([u[i] for i in range(3)]), ufl.as_vector([u[i] for i in range(3, 6)])


def _strains(u):
    n = ufl.CellNormal(ufl.domain.extract_unique_domain(u))
    flat = ufl.Identity(3) - ufl.outer(n, n)
    move, turn = _parts(u)
    g = ufl.grad(move)
    # the normal of a flat shell is the same everywhere
    fibre = -_cross_matrix(n) * ufl.grad(turn)
    membrane = ufl.sym(flat * g * flat)
    bend = ufl.sym(flat * fibre * flat)
    shear = flat * (g.T * n + ufl.cross(turn, n))
    spin = ufl.skew(flat * g * flat)
    drill = ufl.dot(turn, n) - ufl.inner(spin, _cross_matrix(n)) / 2
    return membrane, bend, shear, drill


def _cross_matrix(n):
    return ufl.as_matrix(((0, -n[2], n[1]), (n[2], 0, -n[0]), (-n[1], n[0], 0)))


def strain_energy(u, p):
    membrane, bend, shear, drill = _strains(u)
    c, g = p.E / (1 - p.nu**2), p.E / (2 * (1 + p.nu))

    def plane(e):
        return c / 2 * ((1 - p.nu) * ufl.inner(e, e) + p.nu * ufl.tr(e) ** 2)

    return [
        (p.t * plane(membrane) + p.t**3 / 12 * plane(bend) + g * p.t * drill**2, Quadrature(4)),
        (5 / 12 * g * p.t * ufl.inner(shear, shear), Quadrature(4)),
    ]


def kinetic_energy(v, p):
    move, turn = _parts(v)
    n = ufl.CellNormal(ufl.domain.extract_unique_domain(v))
    spin = ufl.cross(turn, n)
    return [(p.rho * p.t / 2 * ufl.inner(move, move) + p.rho * p.t**3 / 24 * ufl.inner(spin, spin), Quadrature(6))]


def rigid_motion(x, translation, rotation):
    move = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*move, *rotation])


def motion(u, xi, p):
    move, turn = _parts(u)
    n = ufl.CellNormal(ufl.domain.extract_unique_domain(u))
    return move + xi[0] * ufl.cross(turn, n)


def section_inertia(p):
    return p.rho * ufl.as_matrix(((p.t, 0), (0, p.t**3 / 12)))


def stress(u, state, p):
    return _strains(u)[0]


def reference():
    return Reference(Parameters(7e10, 0.3, 2700.0, 0.05))
