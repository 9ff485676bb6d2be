"""Soft tissue: a compressible matrix and two families of dispersed fibres in the plane of x and y.

Gasser, Ogden & Holzapfel 2006, Hyperelastic modelling of arterial layers with distributed collagen fibre orientations,
Journal of the Royal Society Interface 3, doi:10.1098/rsif.2005.0073: per initial volume, with C = F^T F,

    W = mu/2 (tr C - 3 - 2 ln J) + lam/2 (ln J)^2 + sum over both families of k1 / (2 k2) (exp(k2 E^2) - 1),
    E = kappa (tr C - 3) + (1 - 3 kappa) (a . C a - 1),    a = (cos angle, +-sin angle, 0).

The matrix is that of `neo_hookean`, in the place of the paper's incompressible one; fibres bear pressure as well as
pull.
"""

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("tetrahedron", "hexahedron")
ORDER = {1: 2, 2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """mu, lam (matrix), k1 (fibres), Pa; k2, kappa (dispersion, 0 to 1/3), angle to x (rad); rho, kg/m^3."""

    mu: float
    lam: float
    k1: float
    k2: float
    kappa: float
    angle: float
    rho: float

    def __post_init__(self):
        for name in ("mu", "lam", "k1", "k2", "rho"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} must be positive and finite, got {getattr(self, name)}")
        if not 0.0 <= self.kappa <= 1 / 3:
            raise ValueError(f"kappa must lie between 0 (aligned) and 1/3 (isotropic), got {self.kappa}")


@dataclass(frozen=True)
class Quadrature:
    """Exact to this degree."""

    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    """A static problem of the linearised solid with its exact solution."""

    parameters: Parameters

    def displacement(self, x):
        """m, on the unit cube."""
        return 1e-3 * ufl.as_vector((ufl.sin(2 * x[1] + x[2]), ufl.cos(x[0] + x[2]), ufl.sin(x[0] * x[1])))

    def body_force(self, x):
        """N/m^3."""
        return -ufl.div(_stress_at_rest(ufl.sym(ufl.grad(self.displacement(x))), self.parameters))


def element(cell, gdim, degree):
    """Displacements."""
    return basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))


def strain_energy(u, p):
    """One term; from H = grad u, without the cancellation of C - 1 at small strain."""
    return [(_energy(ufl.grad(u), p), Quadrature(2 * _degree(u) + 1))]


def kinetic_energy(v, p):
    """One term."""
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * _degree(v) + 2))]


def rigid_motion(x, translation, rotation):
    """Of the displacement."""
    return translation + ufl.cross(rotation, x)


def stress(u, state, p):
    """Cauchy stress, Pa: dW/dF F^T / J."""
    h = ufl.variable(ufl.grad(u))
    f = ufl.Identity(3) + h
    return ufl.diff(_energy(h, p), h) * f.T / ufl.det(f)


def reference():
    """Of an artery's size; fibres at 34 degrees."""
    return Reference(Parameters(mu=5e5, lam=2e6, k1=1e6, k2=5.0, kappa=0.1, angle=0.6, rho=1100.0))


def _energy(h, p):
    i1 = 2 * ufl.tr(h) + ufl.inner(h, h)
    log_j = ufl.ln(ufl.det(ufl.Identity(3) + h))
    energy = p.mu / 2 * (i1 - 2 * log_j) + p.lam / 2 * log_j**2
    for a in _fibres(p):
        e = p.kappa * i1 + (1 - 3 * p.kappa) * (2 * ufl.dot(a, h * a) + ufl.dot(h * a, h * a))
        energy += p.k1 / (2 * p.k2) * (ufl.exp(p.k2 * e**2) - 1)
    return energy


def _stress_at_rest(strain, p):
    total = 2 * p.mu * strain + p.lam * ufl.tr(strain) * ufl.Identity(3)
    for a in _fibres(p):
        spread = p.kappa * ufl.Identity(3) + (1 - 3 * p.kappa) * ufl.outer(a, a)
        total += 4 * p.k1 * ufl.inner(spread, strain) * spread
    return total


def _fibres(p):
    c, s = ufl.cos(p.angle), ufl.sin(p.angle)
    return [ufl.as_vector((c, s, 0)), ufl.as_vector((c, -s, 0))]


def _degree(u):
    return u.ufl_function_space().ufl_element().embedded_superdegree
