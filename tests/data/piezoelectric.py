"""Piezoelectric solid (poled along z, 6mm): displacement and electric potential, open electrodes but for a leak."""
from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("hexahedron",)
ORDER = {1: 2}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    c11: float
    c12: float
    c13: float
    c33: float
    c44: float
    e31: float
    e33: float
    e15: float
    k11: float
    k33: float
    rho: float
    scale: float = 1e9  # V per unit of the unknown
    leak: float = 0.0  # relative
    ground: float = 1e3  # 1/m

    def __post_init__(self):
        if not self.rho > 0:
            raise ValueError("rho must be positive")


@dataclass(frozen=True)
class Quadrature:
    degree: int
    scheme: str = "default"


def _split(u):
    d, phi = ufl.split(u)
    return d, phi


def element(cell, gdim, degree):
    return basix.ufl.mixed_element(
        [basix.ufl.element("Lagrange", cell, degree, shape=(gdim,)), basix.ufl.element("Lagrange", cell, degree)]
    )


def _laws(e, E, p):
    """stress (3,3), electric displacement (3,)"""
    c66 = (p.c11 - p.c12) / 2
    sxx = p.c11 * e[0, 0] + p.c12 * e[1, 1] + p.c13 * e[2, 2] - p.e31 * E[2]
    syy = p.c12 * e[0, 0] + p.c11 * e[1, 1] + p.c13 * e[2, 2] - p.e31 * E[2]
    szz = p.c13 * (e[0, 0] + e[1, 1]) + p.c33 * e[2, 2] - p.e33 * E[2]
    syz = 2 * p.c44 * e[1, 2] - p.e15 * E[1]
    sxz = 2 * p.c44 * e[0, 2] - p.e15 * E[0]
    sxy = 2 * c66 * e[0, 1]
    s = ufl.as_matrix(((sxx, sxy, sxz), (sxy, syy, syz), (sxz, syz, szz)))
    D = ufl.as_vector(
        (
            2 * p.e15 * e[0, 2] + p.k11 * E[0],
            2 * p.e15 * e[1, 2] + p.k11 * E[1],
            p.e31 * (e[0, 0] + e[1, 1]) + p.e33 * e[2, 2] + p.k33 * E[2],
        )
    )
    return s, D


def strain_energy(u, p):
    d, phi = _split(u)
    h = ufl.grad(d)
    e = (h + h.T + h.T * h) / 2
    E = -p.scale * ufl.grad(phi)
    s, D = _laws(e, E, p)
    w = (ufl.inner(s, e) - ufl.dot(D, E)) / 2
    w -= p.leak * p.k33 * p.scale**2 * phi**2 / 2
    return [(w, Quadrature(2 * _degree(u)))]


def kinetic_energy(v, p):
    d, _ = _split(v)
    return [(p.rho / 2 * ufl.inner(d, d), Quadrature(2 * _degree(v) + 2))]


def rigid_motion(x, translation, rotation):
    m = translation + ufl.cross(rotation, x)
    return ufl.as_vector((m[0], m[1], m[2], 0.0))


def stress(u, state, p):
    d, phi = _split(u)
    return _laws(ufl.sym(ufl.grad(d)), -p.scale * ufl.grad(phi), p)[0]


@dataclass(frozen=True)
class Reference:
    parameters: Parameters

    def displacement(self, x):
        # what a rigid motion does not move is not prescribed on the boundary: D . n = 0 there
        w = ufl.cos(ufl.pi * x[0]) * ufl.cos(ufl.pi * x[1]) * ufl.cos(ufl.pi * x[2])
        return ufl.as_vector((0 * w, 0 * w, 1e-3 * w, 5e-4 * w))

    def body_force(self, x):
        p = self.parameters
        w = self.displacement(x)
        d = ufl.as_vector((w[0], w[1], w[2]))
        s, D = _laws(ufl.sym(ufl.grad(d)), -p.scale * ufl.grad(w[3]), p)
        f = -ufl.div(s)
        q = -p.scale * ufl.div(D) - p.leak * p.k33 * p.scale**2 * w[3]
        return ufl.as_vector((f[0], f[1], f[2], q))


def reference():
    return Reference(PZT5A(leak=0.0))


def PZT5A(**more):
    return Parameters(c11=1.21e11, c12=7.54e10, c13=7.52e10, c33=1.11e11, c44=2.11e10, e31=-5.4, e33=15.8, e15=12.3,
                      k11=8.11e-9, k33=7.35e-9, rho=7750.0, **more)


def _degree(u):
    return u.ufl_function_space().ufl_element().embedded_superdegree


def surface_energy(u, p):
    _, phi = _split(u)
    return [(-p.ground * p.k33 * p.scale**2 * phi**2 / 2, Quadrature(2 * _degree(u)))]
