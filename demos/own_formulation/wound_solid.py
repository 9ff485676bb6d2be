"""A solid wound from fibres around an axis along x; St Venant-Kirchhoff, transversely isotropic.

The fibres run along helices: at an angle to the axis, and tangential to the circles around it. With a their
direction, E the strain of Green and Lagrange, e = a . E a, the energy per volume is (Spencer 1984, Continuum
Theory of the Mechanics of Fibre-Reinforced Composites, chapter 1)

    W = lam/2 tr(E)^2 + mu_T tr(E^2) + alpha e tr(E) + 2 (mu_L - mu_T) |E a|^2 + beta/2 e^2.

Its constants follow from the moduli along and across the fibres. The angle is positive for right-handed helices.
"""

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("hexahedron",)
ORDER = {1: 2, 2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """Moduli along (1) and across (2) the fibres, Pa; Poisson's ratios; kg/m^3; rad; a point (y, z) of the axis, m."""

    E1: float
    E2: float
    G12: float
    nu12: float
    nu23: float
    rho: float
    angle: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        delta = 1 - self.nu23 - 2 * self.nu12**2 * self.E2 / self.E1
        positive = (self.E1, self.E2, self.G12, self.rho, delta, 1 + self.nu23)
        if not all(0 < value < float("inf") for value in positive):
            raise ValueError(f"moduli and density must be positive, and 2 nu12^2 E2/E1 < 1 - nu23 < 2: {self}")


@dataclass(frozen=True)
class Quadrature:
    """Of one term."""

    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    """A smooth displacement, and the force that holds it."""

    parameters: Parameters

    def displacement(self, x):
        """In m."""
        return 1e-3 * ufl.as_vector([ufl.sin(2 * x[i] + x[(i + 1) % 3]) * ufl.cos(x[(i + 2) % 3]) for i in range(3)])

    def body_force(self, x):
        """In N/m^3."""
        return -ufl.div(_stress(ufl.sym(ufl.grad(self.displacement(x))), x, self.parameters))


def element(cell, gdim, degree):
    return basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))


def strain_energy(u, p):
    h, x = ufl.grad(u), ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))
    return [(_energy((h + h.T + h.T * h) / 2, x, p), Quadrature(5))]


def kinetic_energy(v, p):
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(7))]


def rigid_motion(x, translation, rotation):
    return translation + ufl.cross(rotation, x)


def stress(u, state, p):
    return _stress(ufl.sym(ufl.grad(u)), ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u)), p)


def reference():
    return Reference(Parameters(1.35e11, 9e9, 5e9, 0.3, 0.4, 1600.0, 0.35, centre=(-1.0, -0.5)))


def _energy(strain, x, p):
    y, z = x[1] - p.centre[0], x[2] - p.centre[1]
    c, s = ufl.cos(p.angle), ufl.sin(p.angle) / ufl.sqrt(y**2 + z**2)
    a = ufl.as_vector((c, -s * z, s * y))
    nu21 = p.nu12 * p.E2 / p.E1
    delta = 1 - p.nu23 - 2 * p.nu12 * nu21
    c11, c12 = p.E1 * (1 - p.nu23) / delta, p.E1 * nu21 / delta
    lam, mu = p.E2 * (p.nu23 + p.nu12 * nu21) / ((1 + p.nu23) * delta), p.E2 / (2 * (1 + p.nu23))
    along, trace = ufl.dot(a, strain * a), ufl.tr(strain)
    across = lam / 2 * trace**2 + mu * ufl.inner(strain, strain) + (c12 - lam) * along * trace
    beta = c11 + lam - 2 * c12 - 4 * p.G12 + 2 * mu
    return across + 2 * (p.G12 - mu) * ufl.dot(strain * a, strain * a) + beta / 2 * along**2


def _stress(strain, x, p):
    strain = ufl.variable(strain)
    return ufl.sym(ufl.diff(_energy(strain, x, p), strain))
