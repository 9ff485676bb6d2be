"""Elastic solid, St Venant-Kirchhoff; linearised at rest it is the small-strain solid.

Unknown: displacement u (m) of a three-dimensional body. Strong form in the initial configuration:

    rho u'' = Div(F S) + b,   F = I + Grad u,   S = lambda tr(E) I + 2 mu E,   E = (F^T F - I) / 2

with the energy W = lambda/2 tr(E)^2 + mu E:E per initial volume. The energy is that of finite
strain on purpose: its second derivative at u = 0 is the small-strain stiffness, and its third
derivative, from which the geometric stiffness follows, is not zero. Assumes an isotropic,
homogeneous material and small strain; large rotations are exact.

Reference: Bonet & Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, chapter 6,
doi:10.1017/CBO9780511755446.
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms._shared import IsotropicElastic, degrees, is_tetrahedron
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import element as element
from flexmbd.forms._shared import rigid_motion as rigid_motion
from flexmbd.forms._shared import thermal_stretch as thermal_stretch

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material of this form: `IsotropicElastic`."""


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube whose exact displacement is known.

    Attributes:
        parameters: the material.
    """

    parameters: Parameters

    def displacement(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        s = [ufl.sin(ufl.pi * x[i] / 2) for i in range(3)]
        c = [ufl.cos(ufl.pi * x[i] / 2) for i in range(3)]
        return 1e-3 * ufl.as_vector((s[0] * c[1] * s[2], c[0] * c[1] * s[2], s[0] * s[1] * c[2]))

    def body_force(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Body force, N/m^3, with which it is in equilibrium at small strain."""
        return -ufl.div(_small_strain_stress(self.displacement(x), self.parameters))


def strain_energy(
    u: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """St Venant-Kirchhoff energy per initial volume, J/m^3 (Bonet & Wood 2008, chapter 6).

    The rule integrates the stiffness at rest exactly on straight cells, and a constant stress
    exactly on curved ones (so the patch test holds there too): 2 x 2 x 2 points for the trilinear
    hexahedron.
    """
    strain = _green_lagrange(u)
    lam, mu = _lame(p)
    energy = lam / 2 * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)
    n, g = degrees(u)
    if is_tetrahedron(u):
        degree = (n - 1) + max(n - 1, 2 * (g - 1))
    else:
        degree = n + max(n, 2 * g - 1)
    return [(energy, Quadrature(degree))]


def kinetic_energy(
    v: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """Kinetic energy per initial volume, J/m^3, of the velocity v (m/s); exact on curved cells."""
    n, g = degrees(v)
    jacobian = 3 * (g - 1) if is_tetrahedron(v) else 3 * g - 1
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * n + jacobian))]


def stress(u: ufl.core.expr.Expr, state: None, p: Parameters) -> ufl.core.expr.Expr:
    """Cauchy stress of the small-strain solid, Pa, 3 x 3; linear in u, so modes may be superposed.

    The displacement is that relative to the body frame; `state` is None, the solid has no history.
    """
    return _small_strain_stress(u, p)


def reference() -> Reference:
    """A static problem of smooth, three-dimensional displacement for the order tests."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0))


def _lame(p: Parameters) -> tuple[float, float]:
    return p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), p.E / (2 * (1 + p.nu))


def _green_lagrange(u: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    h = ufl.grad(u)
    # from H rather than F^T F - I: no cancellation at small strain
    return (h + h.T + h.T * h) / 2


def _small_strain_stress(u: ufl.core.expr.Expr, p: Parameters) -> ufl.core.expr.Expr:
    strain = ufl.sym(ufl.grad(u))
    lam, mu = _lame(p)
    return lam * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
