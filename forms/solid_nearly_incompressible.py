"""Nearly incompressible elastic solid: compressible neo-Hookean, by selective reduced integration.

Unknown: displacement u (m) of a three-dimensional body. Strong form in the initial configuration:

    rho u'' = Div P + b,   P = dW/dF,   F = I + Grad u,   J = det F,
    W = mu/2 (J^(-2/3) tr(F^T F) - 3) + kappa/2 (J - 1)^2

with mu = E / (2 (1 + nu)) and kappa = E / (3 (1 - 2 nu)). The energy is split on purpose: the part that
keeps the volume is integrated in full, the volumetric part by fewer points, so that an element has fewer
conditions on its volume than unknowns and does not lock as nu approaches 1/2. Linearised at rest it is
the small-strain solid; large rotations and moderate strains are exact.

Quadratic hexahedra only, and why. Fewer points must still integrate the gradients of the shape functions
exactly, or constant stress is not a solution (the patch test): the 2 x 2 x 2 points of a triquadratic
hexahedron with straight edges do, the one point of a trilinear hexahedron does only in a parallelepiped.
One point of a linear tetrahedron is full integration, which locks; of a quadratic one it makes the
pressure constant in a cell, and the error larger than full integration does. For these cells see
`solid_mixed`. Curved cells pass the patch test only in the limit.

References: Malkus & Hughes 1978, doi:10.1016/0045-7825(78)90005-1 (reduced integration as mixed method);
Holzapfel 2000, Nonlinear Solid Mechanics, section 6.4 (the energy).
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms._shared import (
    IncompressibleReference,
    IsotropicElastic,
    bulk_modulus,
    isochoric_energy,
    shear_modulus,
    small_strain_stress,
    volume_change,
)
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import element as element
from flexmbd.forms._shared import rigid_motion as rigid_motion
from flexmbd.forms._shared import thermal_stretch as thermal_stretch

CELLS = ("hexahedron",)

# L2 order of the displacement by element degree.
ORDER = {2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material of this form: `IsotropicElastic`, with nu up to 0.4999, say."""


def strain_energy(
    u: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """Energy per initial volume, J/m^3: the part of constant volume in full, the other reduced.

    The full rule integrates the stiffness at rest exactly on straight cells.
    """
    mu, kappa = shear_modulus(p), bulk_modulus(p)
    h = ufl.grad(u)
    isochoric, volumetric = isochoric_energy(h, mu), kappa / 2 * volume_change(h) ** 2
    n = u.ufl_function_space().ufl_element().embedded_superdegree
    # n + 1 points a direction, and n
    return [(isochoric, Quadrature(2 * n + 1)), (volumetric, Quadrature(2 * n - 1))]


def kinetic_energy(
    v: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """Kinetic energy per initial volume, J/m^3, of the velocity v (m/s); exact on straight cells."""
    n = v.ufl_function_space().ufl_element().embedded_superdegree
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * n + 2))]


def stress(u: ufl.core.expr.Expr, state: None, p: Parameters) -> ufl.core.expr.Expr:
    """Cauchy stress of the small-strain solid, Pa, 3 x 3; linear in u.

    The pressure is meaningful at the points of the reduced rule only. The displacement is that
    relative to the body frame; `state` is None, the solid has no history.
    """
    return small_strain_stress(u, p)


def reference() -> IncompressibleReference:
    """A static problem of a rubber."""
    return IncompressibleReference(Parameters(E=2.0e6, nu=0.4999, rho=1100.0))
