"""Elastic solid of large strain, compressible neo-Hookean.

Unknown: displacement u (m) of a three-dimensional body. Strong form in the initial configuration:

    rho u'' = Div P + b,   P = mu (F - F^-T) + lambda ln J F^-T,   F = I + Grad u,   J = det F

with the energy W = mu/2 (tr F^T F - 3 - 2 ln J) + lambda/2 (ln J)^2 per initial volume, which grows
without bound as a cell is pressed flat. At small strain it is the solid of Lame's constants. Assumes
an isotropic, homogeneous material that is not nearly incompressible; for one that is, take
`solid_nearly_incompressible` or `solid_mixed`.

Reference: Bonet & Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4.3,
doi:10.1017/CBO9780511755446.
"""

from __future__ import annotations

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms._shared import Expr, Terms
from flexmbd.forms.solid_linear import Parameters as Parameters
from flexmbd.forms.solid_linear import Quadrature as Quadrature
from flexmbd.forms.solid_linear import Reference as Reference
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import reference as reference
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion
from flexmbd.forms.solid_linear import thermal_stretch as thermal_stretch

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


def strain_energy(u: Expr, p: Parameters) -> Terms:
    """Energy per initial volume, J/m^3, by the rule of the linear solid."""
    h = ufl.grad(u)
    mu, lam = _lame(p)
    log_j = ufl.ln(ufl.det(ufl.Identity(3) + h))
    # from H and not F^T F - I: no cancellation at small strain
    energy = mu * (ufl.tr(h) + ufl.inner(h, h) / 2 - log_j) + lam / 2 * log_j**2
    ((_, rule),) = solid_linear.strain_energy(u, p)
    return [(energy, rule)]


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Cauchy stress, Pa, 3 x 3, of the deformed body in the axes of its frame; not linear in u."""
    h = ufl.grad(u)
    mu, lam = _lame(p)
    j = ufl.det(ufl.Identity(3) + h)
    return (mu * (h + h.T + h * h.T) + lam * ufl.ln(j) * ufl.Identity(3)) / j


def _lame(p: Parameters) -> tuple[Expr, Expr]:
    return p.E / (2 * (1 + p.nu)), p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu))
