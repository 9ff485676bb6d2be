"""Phase field of brittle damage (AT2, Bourdin/Miehe), history of the largest energy; unknowns u (3) and d (1)."""
from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("hexahedron",)
ORDER = {1: 2}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    E: float
    nu: float
    rho: float
    Gc: float
    ell: float

    def __post_init__(self):
        if not (self.E > 0 and self.rho > 0 and self.Gc > 0 and self.ell > 0):
            raise ValueError("bad")


@dataclass(frozen=True)
class Quadrature:
    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    parameters: Parameters

    def displacement(self, x):
        return 1e-3 * ufl.as_vector((ufl.sin(2 * x[1] + x[2]), ufl.cos(x[0] + x[2]), ufl.sin(x[0] * x[1])))

    def body_force(self, x):
        return -ufl.div(_law(ufl.sym(ufl.grad(self.displacement(x))), self.parameters))


def element(cell, gdim, degree):
    parts = [basix.ufl.element("Lagrange", cell, degree, shape=(3,)), basix.ufl.element("Lagrange", cell, degree)]
    return basix.ufl.mixed_element(parts)


def _law(e, p):
    return p.E / (1 + p.nu) * (e + p.nu / (1 - 2 * p.nu) * ufl.tr(e) * ufl.Identity(3))


def state(p):
    return ufl.as_vector([0.0])


def _psi(u, p):
    e = ufl.sym(ufl.grad(ufl.split(u)[0]))
    return ufl.inner(_law(e, p), e) / 2


def _h(u, state, p):
    return ufl.max_value(state[0], _psi(u, p))


def residual(u, v, state, p):
    w, d = ufl.split(u)
    dw, dd = ufl.split(v)
    g = (1 - d) ** 2 + 1e-8
    s = g * _law(ufl.sym(ufl.grad(w)), p)
    phase = p.Gc / p.ell * (d * dd + p.ell**2 * ufl.dot(ufl.grad(d), ufl.grad(dd))) - 2 * (1 - d) * _h(u, state, p) * dd
    return [(ufl.inner(s, ufl.sym(ufl.grad(dw))) + phase, Quadrature(2))]


def update(u, state, p):
    return ufl.as_vector([_h(u, state, p)])


def stress(u, state, p):
    w, d = ufl.split(u)
    return ((1 - d) ** 2 + 1e-8) * _law(ufl.sym(ufl.grad(w)), p)


def kinetic_energy(v, p):
    w, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(w, w), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    m = translation + ufl.cross(rotation, x)
    return ufl.as_vector([m[0], m[1], m[2], 0.0])


def reference():
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, Gc=1e9, ell=0.2))
