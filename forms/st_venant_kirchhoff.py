"""Elastic solid of large displacement and moderate strain, St Venant-Kirchhoff.

Unknown: displacement u (m) of a three-dimensional body. Strong form in the initial configuration:

    rho u'' = Div(F S) + b,   F = I + Grad u,   S = lambda tr(E) I + 2 mu E,   E = (F^T F - I) / 2

The energy, mass and rules are those of `solid_linear`, which is this solid linearised at rest; the
stress is that of the deformed body, so that it is right under finite rotation and strain, and not
linear in u. Assumes an isotropic, homogeneous material; rotations of any size, and strains of some
per cent: under strong compression the material softens and then gives way. Beyond take `neo_hookean`.

Reference: Bonet & Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, chapter 6,
doi:10.1017/CBO9780511755446.
"""

from __future__ import annotations

import ufl

from flexmbd.forms.solid_linear import Parameters as Parameters
from flexmbd.forms.solid_linear import Quadrature as Quadrature
from flexmbd.forms.solid_linear import Reference as Reference
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import reference as reference
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion
from flexmbd.forms.solid_linear import strain_energy as strain_energy
from flexmbd.forms.solid_linear import thermal_stretch as thermal_stretch

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


def stress(u: ufl.core.expr.Expr, state: None, p: Parameters) -> ufl.core.expr.Expr:
    """Cauchy stress F S F^T / det F, Pa, 3 x 3, of the deformed body in the axes of its frame."""
    h = ufl.grad(u)
    f, strain = ufl.Identity(3) + h, (h + h.T + h.T * h) / 2
    mu = p.E / (2 * (1 + p.nu))
    lam = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu))
    second = lam * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    return f * second * f.T / ufl.det(f)
