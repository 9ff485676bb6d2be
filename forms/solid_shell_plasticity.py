"""Elasto-plastic thin wall of solid-shell bricks: logarithmic elasticity, J2 flow; strains, rotations of any size.

Unknown: as of `solid_shell`, displacement u (m) at the nodes of a brick whose third edges go through the thickness,
and fields of the cell, which are condensed there. The law is that of `hencky_plasticity`, in the assumed strain
(`_wall_law`). Points: 2 x 2 in the plane of the cell, 5 through the thickness, at z/t = -1/2, -1/4, 0, 1/4, 1/2 with
Simpson's weights: yield is seen on the surface, and the moment of a wall that flows through its whole thickness is
exact; in between an elastic-perfectly plastic wall's is off by up to 9 %. Another number of points, or another law:
`wall_form`. History: that of the law, in axes that turn with the wall, and the wall's stretch.

Third edges of the mesh's cells must lie across the wall, as those of `meshes.wall` do. A step's strain increment is
that of the law.

References: those of `solid_shell` and `hencky_plasticity`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from flexmbd.forms import hencky_plasticity
from flexmbd.forms._shared import Expr, Terms, check_finite
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import thermal_stretch as thermal_stretch
from flexmbd.forms._thin_wall import element as element
from flexmbd.forms._thin_wall import rigid_motion as rigid_motion
from flexmbd.forms._wall_law import WallLaw
from flexmbd.forms.hencky_plasticity import local_unknowns as local_unknowns
from flexmbd.forms.hencky_plasticity import scaled_yield as scaled_yield

CELLS = ("hexahedron",)

# L2 order of the displacement by element degree.
ORDER = {1: 2}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

# Third edges of cells lie across layers.
LAYERED = True


@dataclass(frozen=True)
class Parameters(hencky_plasticity.Parameters):
    """The material of `hencky_plasticity`, which expands.

    Attributes:
        alpha: coefficient of thermal expansion, 1/K, finite; by keyword.

    Raises:
        ValueError: as there, or alpha is not finite.
    """

    alpha: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_finite(self, ("alpha",))


@dataclass(frozen=True)
class Reference(hencky_plasticity.Reference):
    """The elastic problem of `hencky_plasticity`."""


_WALL = WallLaw(hencky_plasticity, layers=5, modulus=lambda p: p.E)


def reference() -> Reference:
    """The steel of `hencky_plasticity`, below first yield."""
    given = hencky_plasticity.reference().parameters
    return Reference(Parameters(given.E, given.nu, given.rho, given.yield_stress, given.hardening))


def state(p: Parameters) -> Expr:
    """The history at rest, (15,)."""
    return _WALL.state(p)


def state_names(p: Parameters) -> dict[str, int]:
    """Parts of the history by name: those of `hencky_plasticity`, and the wall's stretch less the unit tensor."""
    return _WALL.state_names(p)


def local_residual(z: Expr, u: Expr, state: Expr, p: Parameters) -> Expr:
    """What the increment z of the accumulated plastic strain makes zero; dimensionless."""
    return _WALL.local_residual(z, u, state, p)


def residual(u: Expr, v: Expr, state: Expr, p: Parameters, *, z: Expr | None = None) -> Terms:
    """Virtual work per initial volume, J/m^3, of the law's stress, and of what ties the assumed strain."""
    return _WALL.residual(u, v, state, p, z=z)


def update(u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None) -> Expr:
    """The history at the step's end, (15,)."""
    return _WALL.update(u, state, p, z=z)


def stress(u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None) -> Expr:
    """Cauchy stress, Pa, 3 x 3, at the step's end, in the axes of the body."""
    return _WALL.stress(u, state, p, z=z)


def energies(u: Expr, state: Expr, p: Parameters) -> dict[str, tuple[Expr, Quadrature]]:
    """Energies per initial volume, J/m^3, with the history of the same instant: "elastic" and "plastic"."""
    return _WALL.energies(u, state, p)


def kinetic_energy(v: Expr, p: Parameters) -> Terms:
    """Kinetic energy per initial volume, J/m^3, of the velocity v (m/s); exact on straight cells."""
    return _WALL.kinetic_energy(v, p)
