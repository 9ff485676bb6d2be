"""Micropolar elastic solid (Cosserat's), linear: points that move and turn, and whose micro-structure has inertia.

Unknown: displacement u (m) and micro-rotation phi (rad) of a three-dimensional body, six components a point. With the
strain e = grad u - [phi x] and the curvature k = grad phi the energies per volume are

    W = lambda/2 tr(e)^2 + mu sym(e):sym(e) + coupling skew(e):skew(e) + mu length^2 k:k
    T = rho/2 (u' . u' + micro_inertia phi' . phi')

A rigid rotation w turns the micro-structure too, phi' = w, so that a body's inertia is that of its mass as points and
micro_inertia times its mass about each axis. The same kinetic energy is that of material points at xi about the centre
of each element of structure, which move by u + phi x xi and have the moments of `section_inertia`; by these a moving
body carries it. Assumes small displacements and rotations, isotropy, and the curvature energy of a single length; a
load does not change the stiffness, so that a body that spins fast comes out too soft.

Reference: Eringen 1966, Linear theory of micropolar elasticity, J. Math. Mech. 15, 909-923, there with
kappa = 2 coupling, mu_Eringen = mu - coupling, gamma = 2 mu length^2 and alpha = beta = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

from flexmbd.forms._shared import (
    Expr,
    IsotropicElastic,
    Terms,
    check_positive,
    degrees,
    is_tetrahedron,
    shear_modulus,
    small_strain_stress,
)
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import thermal_strain as thermal_strain

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material: `IsotropicElastic`, whose shear modulus is mu, and its structure.

    Attributes:
        coupling: modulus of rotation against the displacement's own, Pa, positive.
        length: m, positive; of the curvature's energy.
        micro_inertia: square of the micro-structure's radius of gyration about any axis, m^2, at least zero; a
            body that moves as a whole in explicit steps takes none.

    Raises:
        ValueError: a value is not a finite number inside its range.
    """

    coupling: float
    length: float
    micro_inertia: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, ("coupling", "length"))
        if not 0.0 <= self.micro_inertia < float("inf"):
            raise ValueError(f"micro_inertia must be at least 0 and finite (m^2), got {self.micro_inertia}")


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube whose exact displacement and rotation are known.

    Attributes:
        parameters: the material.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement, m, and rotation, rad, (6,), at the point x; prescribed on the whole boundary."""
        return ufl.as_vector([*_exact_displacement(x), *_exact_rotation(x)])

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, and body couple, N m/m^3, (6,), with which they are in equilibrium."""
        p, u, phi = self.parameters, _exact_displacement(x), _exact_rotation(x)
        skew = ufl.skew(ufl.grad(u)) - _cross_matrix(phi)
        couple = 4 * p.coupling * (phi - ufl.curl(u) / 2)
        force = -ufl.div(small_strain_stress(u, p) + 2 * p.coupling * skew)
        bending = -ufl.div(2 * shear_modulus(p) * p.length**2 * ufl.grad(phi))
        return ufl.as_vector([*force, *(couple + bending)])


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Continuous vector Lagrange element on `cell` for displacement and rotation together."""
    return basix.ufl.element("Lagrange", cell, degree, shape=(2 * gdim,))


def strain_energy(u: Expr, p: Parameters) -> Terms:
    """Energy per initial volume, J/m^3."""
    move, turn = _displacement(u), _rotation(u)
    slip = ufl.skew(ufl.grad(move)) - _cross_matrix(turn)
    strain = ufl.sym(ufl.grad(move))
    energy = ufl.inner(small_strain_stress(move, p), strain) / 2 + p.coupling * ufl.inner(slip, slip)
    curvature = shear_modulus(p) * p.length**2 * ufl.inner(ufl.grad(turn), ufl.grad(turn))
    return [(energy + curvature, _rule(u))]


def kinetic_energy(v: Expr, p: Parameters) -> Terms:
    """Kinetic energy per initial volume, J/m^3."""
    move, turn = _displacement(v), _rotation(v)
    squares = ufl.inner(move, move) + p.micro_inertia * ufl.inner(turn, turn)
    return [(p.rho / 2 * squares, _rule(v))]


def motion(u: Expr, xi: Expr, p: Parameters) -> Expr:
    """Displacement, m, of the material point at xi (3,), m, from the centre of its element of structure."""
    return _displacement(u) + ufl.cross(_rotation(u), xi)


def section_inertia(p: Parameters) -> Expr:
    """Moments of an element of structure per volume, rho {1, xi} {1, xi}, (4, 4): kg/m^3, kg/m^2, kg/m."""
    # about each axis two of these add up to rho micro_inertia
    second = p.rho * p.micro_inertia / 2
    rows = [p.rho, second, second, second]
    return ufl.as_matrix([[value if i == j else 0 for j in range(4)] for i, value in enumerate(rows)])


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """Displacement, m, and rotation, rad, at x of an infinitesimal rigid motion."""
    return ufl.as_vector([*(translation + ufl.cross(rotation, x)), *rotation])


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Symmetric part of the stress, Pa, 3 x 3; linear in u, so modes may be superposed."""
    return small_strain_stress(_displacement(u), p)


def reference() -> Reference:
    """A static problem of smooth, three-dimensional displacement and rotation for the order tests."""
    return Reference(Parameters(E=7.5e9, nu=0.25, rho=1200.0, coupling=1e9, length=0.1, micro_inertia=4e-3))


def _displacement(u: Expr) -> Expr:
    return ufl.as_vector([u[i] for i in range(3)])


def _rotation(u: Expr) -> Expr:
    return ufl.as_vector([u[i] for i in range(3, 6)])


def _cross_matrix(w: Expr) -> Expr:
    """The matrix of the product w x, which is the gradient of a rigid rotation's displacement."""
    return ufl.as_matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def _rule(u: Expr) -> Quadrature:
    """Exact for products of two values, on curved cells too."""
    n, g = degrees(u)
    return Quadrature(2 * n + (3 * (g - 1) if is_tetrahedron(u) else 3 * g - 1))


def _exact_displacement(x: Expr) -> Expr:
    s = [ufl.sin(ufl.pi * x[i] / 2) for i in range(3)]
    c = [ufl.cos(ufl.pi * x[i] / 2) for i in range(3)]
    return 1e-3 * ufl.as_vector((s[0] * c[1] * s[2], c[0] * c[1] * s[2], s[0] * s[1] * c[2]))


def _exact_rotation(x: Expr) -> Expr:
    return 1e-3 * ufl.as_vector((ufl.sin(x[1] + x[2]), ufl.cos(x[0] * x[2]), ufl.sin(x[0] - x[1])))
