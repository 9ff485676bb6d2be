"""Elastic thin wall of solid-shell bricks, St Venant-Kirchhoff: displacements at eight nodes, no rotations.

Unknown: displacement u (m) at the nodes of a brick whose third edges go through the thickness of the
wall, and fields of the cell, which are condensed there. Strong form and energy are those of
`solid_linear`; the strain is the assumed one of `_thin_wall`, so that one brick through the
thickness bends, also where the wall is curved, and does not lock where it is thin. What is
three-dimensional stays: stress across the wall, faces that touch, any support.

Third edges of the mesh's cells must lie across the wall, as those of `meshes.wall` do. Assumes an
isotropic, homogeneous material and small strain; large rotations are exact.

References: those of `_thin_wall`; Klinkel, Gruttmann & Wagner 2006, doi:10.1016/j.cma.2005.04.013.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl

from flexmbd.forms import _thin_wall, solid_linear
from flexmbd.forms._shared import Expr, IsotropicElastic, Terms
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import thermal_stretch as thermal_stretch
from flexmbd.forms._thin_wall import element as element
from flexmbd.forms._thin_wall import rigid_motion as rigid_motion
from flexmbd.forms._wall_law import at_gradient
from flexmbd.forms.solid_linear import Reference as _Reference

CELLS = ("hexahedron",)

# L2 order of the displacement by element degree.
ORDER = {1: 2}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

# Third edges of cells lie across layers.
LAYERED = True


@dataclass(frozen=True)
class Parameters(IsotropicElastic):
    """The material of this form: `IsotropicElastic`."""


@dataclass(frozen=True)
class Reference(_Reference):
    """The problem of `solid_linear`.

    Attributes:
        parameters: the material.
    """

    parameters: Parameters  # type: ignore[assignment]


def strain_energy(u: Expr, p: Parameters) -> Terms:
    """St Venant-Kirchhoff energy of the assumed strain per initial volume, J/m^3; of 2 x 2 x 2 points."""
    strain, ties, *_ = _thin_wall.assumed_strain(u, p.E)
    return [(ufl.inner(_stress(u, strain, p), strain) / 2, Quadrature(3)), *ties]


def kinetic_energy(v: Expr, p: Parameters) -> Terms:
    """Kinetic energy per initial volume, J/m^3, of the velocity v (m/s); exact on straight cells."""
    return [(p.rho / 2 * ufl.inner(moved, moved), Quadrature(4)) for moved in (_thin_wall.displacement(v),)]


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Cauchy stress F S F^T / det F, Pa, 3 x 3, of the assumed strain, in the axes of the body's frame."""
    strain = _thin_wall.assumed_strain(u, p.E).strain
    f = ufl.Identity(3) + ufl.grad(_thin_wall.displacement(u))
    return f * _stress(u, strain, p) * f.T / ufl.det(f)


def reference() -> Reference:
    """A static problem of smooth, three-dimensional displacement for the order tests."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0))


def _stress(u: Expr, strain: Expr, p: Any) -> Expr:
    """That of the linear solid where the gradient of its displacement is the assumed strain, Pa."""
    return at_gradient(lambda c: [solid_linear.stress(c, None, p)], u, strain)[0]
