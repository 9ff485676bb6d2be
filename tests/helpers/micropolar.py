"""A form file with rotations: the micropolar solid, its unknown the displacement and a rotation a point.

Energy of the strain, of the rotation against the displacement's own, and of the rotation's gradient;
Eringen 1966, Linear theory of micropolar elasticity, in its simplest case.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("tetrahedron", "hexahedron")
ORDER = {1: 2, 2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """mu: Pa; kappa: Pa, of the coupling; gamma: N, of the rotation's gradient; rho: kg/m^3; j: m^2."""

    mu: float = 3e9
    kappa: float = 1e9
    gamma: float = 2e6
    rho: float = 1200.0
    j: float = 1e-3


@dataclass(frozen=True)
class Quadrature:
    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    parameters: Parameters = Parameters()

    def displacement(self, x):
        return 1e-3 * ufl.as_vector((x[0], x[0] + x[2], 0, -0.5, 0, 0.5))

    def body_force(self, x):
        return 0 * x


def element(cell, gdim, degree):
    return basix.ufl.element("Lagrange", cell, degree, shape=(2 * gdim,))


def mixed_element(cell, gdim, degree):
    """The same of two elements, the rotation's of degree one."""
    parts = [basix.ufl.element("Lagrange", cell, n, shape=(gdim,)) for n in (degree, 1)]
    return basix.ufl.mixed_element(parts)


def _parts(w):
    return ufl.as_vector([w[i] for i in range(3)]), ufl.as_vector([w[i] for i in range(3, 6)])


def strain_energy(u, p):
    move, turn = _parts(u)
    strain = ufl.sym(ufl.grad(move))
    slip = turn - ufl.curl(move) / 2
    energy = p.mu * ufl.inner(strain, strain) + p.gamma / 2 * ufl.inner(ufl.grad(turn), ufl.grad(turn))
    return [(energy, Quadrature(4)), (p.kappa * ufl.inner(slip, slip), Quadrature(4))]


def kinetic_energy(v, p):
    move, turn = _parts(v)
    return [(p.rho / 2 * (ufl.inner(move, move) + p.j * ufl.inner(turn, turn)), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    move = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*move, *rotation])


def stress(u, state, p):
    return 2 * p.mu * ufl.sym(ufl.grad(_parts(u)[0]))


def reference():
    return Reference()
