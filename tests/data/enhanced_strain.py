"""A trilinear brick with nine incompatible strains in each cell, which minimise the energy (Simo & Rifai 1990)."""

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

    def __post_init__(self):
        if not (0 < self.E < float("inf") and 0 < self.rho < float("inf") and -1 < self.nu < 0.5):
            raise ValueError(f"no material: {self}")


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
    return basix.ufl.mixed_element(
        [basix.ufl.element("Lagrange", cell, 1, shape=(gdim,)), basix.ufl.element("DG", cell, 0, shape=(9,))]
    )


def _law(e, p):
    return p.E / (1 + p.nu) * (e + p.nu / (1 - 2 * p.nu) * ufl.tr(e) * ufl.Identity(3))


def _strain(u):
    domain = ufl.domain.extract_unique_domain(u)
    d, a = ufl.split(u)
    vertices = ufl.geometry.CellVertices(domain)
    c = [ufl.as_vector([vertices[i, j] for j in range(3)]) for i in range(8)]
    centre = sum(c[1:], c[0]) / 8
    # edges at the centre: vertex i has the reference coordinates (i & 1, i >> 1 & 1, i >> 2)
    g = []
    for k in range(3):
        up = [c[i] for i in range(8) if i >> k & 1]
        low = [c[i] for i in range(8) if not i >> k & 1]
        g.append((sum(up[1:], up[0]) - sum(low[1:], low[0])) / 4)
    j0 = ufl.as_matrix([[g[k][i] for k in range(3)] for i in range(3)])
    inv = ufl.inv(j0)
    xi = 2 * inv * (ufl.SpatialCoordinate(domain) - centre)
    local = ufl.as_matrix((
        (a[0] * xi[0], (a[3] * xi[0] + a[4] * xi[1]) / 2, (a[5] * xi[0] + a[6] * xi[2]) / 2),
        ((a[3] * xi[0] + a[4] * xi[1]) / 2, a[1] * xi[1], (a[7] * xi[1] + a[8] * xi[2]) / 2),
        ((a[5] * xi[0] + a[6] * xi[2]) / 2, (a[7] * xi[1] + a[8] * xi[2]) / 2, a[2] * xi[2]),
    ))
    size = ufl.det(j0) ** (2 / 3)
    enhanced = size * inv.T * local * inv * ufl.det(j0) / abs(ufl.JacobianDeterminant(domain))
    return ufl.grad(d), enhanced


def strain_energy(u, p):
    h, enhanced = _strain(u)
    e = (h + h.T + h.T * h) / 2 + enhanced
    return [(ufl.inner(_law(e, p), e) / 2, Quadrature(4))]


def kinetic_energy(v, p):
    d, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(d, d), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    m = translation + ufl.cross(rotation, x)
    return ufl.as_vector([m[0], m[1], m[2]] + [0.0] * 9)


def stress(u, state, p):
    h, enhanced = _strain(u)
    return _law(ufl.sym(h) + enhanced, p)


def reference():
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0))
