"""A brittle solid whose cracks are a field of damage: displacement u (m) and damage d, from 0 (sound) to 1 (broken).

    W = ((1 - d)^2 + residual) psi(u) + Gc / (2 length) (d^2 + length^2 |grad d|^2)

psi is Saint Venant's and Kirchhoff's energy, so that a body may turn by any angle.  In the equation of the damage
stands the largest psi that a point has seen, so that what is broken does not heal.  A crack is a band some four lengths
wide that takes Gc per area of its section; cells are to be a third of the length.  The damage has no mass.

References: Bourdin, Francfort & Marigo 2000, doi:10.1016/S0022-5096(99)00028-9 (the energy, AT2); Miehe, Hofacker &
Welschinger 2010, doi:10.1016/j.cma.2010.04.011 (the history).
"""

from dataclasses import dataclass

import basix.ufl
import ufl

CELLS = ("tetrahedron", "hexahedron")

ORDER = {1: 2}

REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """Young's modulus, Pa; Poisson's ratio; density, kg/m^3; work of fracture, J/m^2; length, m; stiffness left.

    Raises:
        ValueError: a value is out of its range.
    """

    E: float
    nu: float
    rho: float
    Gc: float
    length: float
    residual: float = 1e-8

    def __post_init__(self):
        for name in ("E", "rho", "Gc", "length", "residual"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} must be positive and finite, got {getattr(self, name)}")
        if not -1.0 < self.nu < 0.5:
            raise ValueError(f"nu must be above -1 and below 0.5, got {self.nu}")


@dataclass(frozen=True)
class Quadrature:
    """Degree and scheme of a rule."""

    degree: int
    scheme: str = "default"


@dataclass(frozen=True)
class Reference:
    """A static problem of a sound solid; materials that are damaged by strains of a percent."""

    parameters: Parameters
    yielding: tuple[Parameters, ...]

    def displacement(self, x):
        return 1e-3 * ufl.as_vector((ufl.sin(2 * x[1] + x[2]), ufl.cos(x[0] + x[2]), ufl.sin(x[0] * x[1])))

    def body_force(self, x):
        return -ufl.div(_sound_stress(self.displacement(x), self.parameters))


def element(cell, gdim, degree):
    displacement = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return basix.ufl.mixed_element([displacement, basix.ufl.element("Lagrange", cell, degree)])


def state(p):
    return ufl.as_vector([0.0])


def state_names(p):
    return {"driving_energy": 1}


def residual(u, v, state, p):
    displacement, d = ufl.split(u)
    virtual, virtual_d = ufl.split(v)
    h, g = ufl.grad(displacement), ufl.grad(virtual)
    stress = _left(d, p) * _law(_green(displacement), p)
    crack = p.Gc / p.length * (d * virtual_d + p.length**2 * ufl.dot(ufl.grad(d), ufl.grad(virtual_d)))
    drive = 2 * (1 - d) * _largest(displacement, state, p) * virtual_d
    return [(ufl.inner(stress, ufl.sym(g + h.T * g)) + crack - drive, Quadrature(2))]


def update(u, state, p):
    return ufl.as_vector([_largest(ufl.split(u)[0], state, p)])


def stress(u, state, p):
    displacement, d = ufl.split(u)
    return _left(d, p) * _sound_stress(displacement, p)


def energies(u, state, p):
    displacement, d = ufl.split(u)
    crack = p.Gc / (2 * p.length) * (d**2 + p.length**2 * ufl.dot(ufl.grad(d), ufl.grad(d)))
    return {
        "elastic": (_left(d, p) * _sound_energy(displacement, p), Quadrature(2)),
        "fracture": (crack, Quadrature(2)),
    }


def scaled_yield(p, factor):
    return p


def kinetic_energy(v, p):
    velocity, _ = ufl.split(v)
    return [(p.rho / 2 * ufl.inner(velocity, velocity), Quadrature(4))]


def rigid_motion(x, translation, rotation):
    motion = translation + ufl.cross(rotation, x)
    return ufl.as_vector([motion[0], motion[1], motion[2], 0.0])


def reference():
    brittle = Parameters(E=2.1e11, nu=0.3, rho=7850.0, Gc=1e6, length=0.2)
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, Gc=1e9, length=0.2), (brittle,))


def _left(d, p):
    return (1 - d) ** 2 + p.residual


def _green(displacement):
    h = ufl.grad(displacement)
    return (h + h.T + h.T * h) / 2


def _sound_stress(displacement, p):
    """Of small strains."""
    return _law(ufl.sym(ufl.grad(displacement)), p)


def _law(strain, p):
    return p.E / (1 + p.nu) * (strain + p.nu / (1 - 2 * p.nu) * ufl.tr(strain) * ufl.Identity(3))


def _sound_energy(displacement, p):
    strain = _green(displacement)
    return ufl.inner(_law(strain, p), strain) / 2


def _largest(displacement, state, p):
    return ufl.max_value(state[0], _sound_energy(displacement, p))
