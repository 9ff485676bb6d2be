"""Elastic solid up to the incompressible, by displacement and pressure: compressible neo-Hookean.

Unknowns: displacement u (m) of a three-dimensional body, and pi = p / mu, where p (Pa) is the mean
stress and mu the shear modulus, so that all entries of the stiffness are of one size. Strong form in the
initial configuration:

    rho u'' = Div P + b,   P = dW/dF,   F = I + Grad u,   J = det F,   J - 1 = p / kappa,
    W = mu/2 (J^(-2/3) tr(F^T F) - 3) + p (J - 1) - p^2 / (2 kappa)

with mu = E / (2 (1 + nu)) and kappa = E / (3 (1 - 2 nu)), infinite for nu = 1/2. W is stationary, and not
least, in pi: the stiffness is that of a saddle point, and pi has no mass. Linearised at rest it is
the small-strain solid; large rotations and moderate strains are exact.

The elements are pairs that do not lock: Taylor and Hood's, quadratic displacement and continuous linear
pressure; and, trilinear, a pressure constant in each hexahedron, which keeps the order of the displacement
but whose pressures may alternate from cell to cell, so there nu is best kept below 1/2. There is no such
pair for the linear tetrahedron.

References: Boffi, Brezzi & Fortin 2013, Mixed Finite Element Methods and Applications, chapter 8,
doi:10.1007/978-3-642-36519-5; Holzapfel 2000, Nonlinear Solid Mechanics, section 6.4 (the energy).
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl

from flexmbd.forms._shared import (
    IncompressibleReference,
    IsotropicElastic,
    is_tetrahedron,
    isochoric_energy,
    shear_modulus,
    volume_change,
)
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import thermal_stretch as thermal_stretch

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by cell and element degree.
ORDER = {"tetrahedron": {2: 3}, "hexahedron": {1: 2, 2: 3}}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material of this form: `IsotropicElastic`, with -1 < nu <= 0.5."""

    def _check_nu(self) -> None:
        if not -1.0 < self.nu <= 0.5:
            raise ValueError(f"Poisson's ratio nu must be above -1 and at most 0.5, got {self.nu}")


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Vector Lagrange element for the displacement, and one degree lower one for the pressure."""
    displacement = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    pressure = basix.ufl.element("Lagrange", cell, degree - 1, discontinuous=degree == 1)
    return basix.ufl.mixed_element([displacement, pressure])


def strain_energy(
    u: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """The functional W per initial volume, J/m^3, of the unknown u = (displacement, pi).

    The rule integrates the stiffness at rest exactly on straight cells.
    """
    mu = shear_modulus(p)
    displacement, pi = ufl.split(u)
    h = ufl.grad(displacement)
    isochoric = isochoric_energy(h, mu)
    coupling = mu * pi * volume_change(h)
    compression = (mu * pi) ** 2 * 3 * (1 - 2 * p.nu) / (2 * p.E)
    n = _degree(u)
    return [(isochoric + coupling - compression, Quadrature(2 * n if is_tetrahedron(u) else 2 * n + 1))]


def kinetic_energy(
    v: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """Kinetic energy per initial volume, J/m^3, of the rate v of the unknown; on straight cells exact."""
    velocity, _ = ufl.split(v)
    n = _degree(v)
    return [(p.rho / 2 * ufl.inner(velocity, velocity), Quadrature(2 * n if is_tetrahedron(v) else 2 * n + 2))]


def rigid_motion(
    x: ufl.core.expr.Expr, translation: ufl.core.expr.Expr, rotation: ufl.core.expr.Expr
) -> ufl.core.expr.Expr:
    """The unknown at x of an infinitesimal rigid motion: translation + rotation x x, no pressure."""
    displacement = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*(displacement[i] for i in range(3)), 0.0])


def stress(u: ufl.core.expr.Expr, state: None, p: Parameters) -> ufl.core.expr.Expr:
    """Cauchy stress of the small-strain solid, Pa, 3 x 3; linear in u.

    The displacement is that relative to the body frame; `state` is None, the solid has no history.
    """
    displacement, pi = ufl.split(u)
    mu = shear_modulus(p)
    return 2 * mu * ufl.dev(ufl.sym(ufl.grad(displacement))) + mu * pi * ufl.Identity(3)


def reference() -> IncompressibleReference:
    """A static problem of a rubber."""
    return IncompressibleReference(Parameters(E=2.0e6, nu=0.4999, rho=1100.0))


def _degree(u: ufl.core.expr.Expr) -> int:
    """Polynomial degree of the displacement."""
    degree: int = u.ufl_function_space().ufl_element().embedded_superdegree
    return degree
