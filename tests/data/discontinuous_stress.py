"""A solid by displacement and a stress that is discontinuous (Hellinger & Reissner): the stress minimises nothing.

On tetrahedra of degree 2 with a stress of degree 1 in each cell the stress is that of the displacement's strain, and the
body is that of `solid_linear`.
"""

from dataclasses import dataclass

import basix.ufl
import ufl

from flexmbd.forms import solid_linear

CELLS = ("tetrahedron",)
ORDER = {2: 3}
REFERENCE = "INITIAL"

Quadrature = solid_linear.Quadrature
reference = solid_linear.reference


@dataclass(frozen=True)
class Parameters(solid_linear.Parameters):
    pass


@dataclass(frozen=True)
class Reference:
    parameters: Parameters

    def displacement(self, x):
        return self._plain().displacement(x)

    def body_force(self, x):
        return self._plain().body_force(x)

    def _plain(self):
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def reference():
    p = solid_linear.reference().parameters
    return Reference(Parameters(p.E, p.nu, p.rho))


def element(cell, gdim, degree):
    stress = basix.ufl.element("DG", cell, degree - 1, shape=(3, 3), symmetry=True)
    return basix.ufl.mixed_element([basix.ufl.element("Lagrange", cell, degree, shape=(gdim,)), stress])


def _parts(u, p):
    """The strain, and the stress, which is held as a part of E."""
    d, s = ufl.split(u)
    h = ufl.grad(d)
    return (h + h.T + h.T * h) / 2, p.E * s


def strain_energy(u, p):
    e, s = _parts(u, p)
    complementary = ((1 + p.nu) * ufl.inner(s, s) - p.nu * ufl.tr(s) ** 2) / (2 * p.E)
    return [(ufl.inner(s, e) - complementary, Quadrature(2))]


def kinetic_energy(v, p):
    d, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(d, d), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    m = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*(m[i] for i in range(3)), *[0.0] * 9])


def stress(u, state, p):
    return _parts(u, p)[1]
