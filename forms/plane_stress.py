"""Plane elements as a body in space: plane stress or plane strain in a flat mesh of triangles or quadrilaterals.

The mesh lies in a plane, anywhere in space; n is its normal, P = 1 - n n, H = grad u. Unknowns at each node:
displacement u (m) and rotation theta (rad). In the plane, per area,

    W = t s:e / 2,   e = P (H + H^T + H^T H) P / 2,   s = E / (1 - nu^2) ((1 - nu) e + nu (tr e) P),

or in plane strain s = E / (1 + nu) (e + nu / (1 - 2 nu) (tr e) P): a slice of a prism that cannot strain along n. Out
of the plane the body has the stiffness of a Reissner plate, of bending k = P sym(grad f) P and shear g = P H^T n + f
with the normal fibre's tilt f = theta x n, times `out_of_plane`,

    W = out_of_plane (t^3 / 12 s(k):k / 2 + 5/6 G t |g|^2 / 2) + G t (theta . n - spin)^2 / 200:

a number far above one holds it flat, so that its modes are those in the plane. The last part ties the rotation about
n to the displacement's (Hughes & Brezzi 1989, doi:10.1016/0045-7825(89)90124-2) and stiffens nothing as cells get
small. With out_of_plane = 1 thin plates of these cells bend too little (shear locking): for bending take `plate_mitc`.

Cells are of degree 2: linear ones lock out of the plane, and are too stiff against bending in it. References:
Timoshenko & Goodier 1970, articles 15 to 17; Zienkiewicz, Taylor & Fox 2014, section 8.6.1 (plane elements in a
machine).
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl
from ufl.core.expr import Expr

from flexmbd.forms import plate_mitc
from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import check_positive, degrees
from flexmbd.forms.plate_mitc import element as element
from flexmbd.forms.plate_mitc import motion as motion
from flexmbd.forms.plate_mitc import rigid_motion as rigid_motion
from flexmbd.forms.plate_mitc import section_inertia as section_inertia
from flexmbd.forms.plate_mitc import thermal_stretch as thermal_stretch

CELLS = ("triangle", "quadrilateral")

# L2 order of the displacement by element degree.
ORDER = {2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

_SHEAR = 5 / 6
_DRILLING = 0.01


@dataclass(frozen=True)
class Parameters(plate_mitc.Parameters):
    """An isotropic elastic material, and the thickness, the same everywhere.

    Attributes:
        out_of_plane: stiffness against bending out of the plane over that of a plate of thickness t, positive.
        plane_strain: whether nothing strains along the normal; else no stress is there.

    Raises:
        ValueError: a value is not a finite number inside its range.
    """

    out_of_plane: float = 1.0
    plane_strain: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, ("out_of_plane",))
        if not isinstance(self.plane_strain, bool):
            raise ValueError(f"plane_strain must be True or False, got {self.plane_strain!r}")


@dataclass(frozen=True)
class Reference:
    """A static problem in the unit square of the plane z = 0.

    Attributes:
        parameters: the material and the thickness.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement (m) in the plane, and the rotation (rad) about its normal, (6,); on the whole boundary."""
        u = self._plane(x)
        return ufl.as_vector([*u, 0 * x[0], 0 * x[0], 0 * x[0], (u[1].dx(0) - u[0].dx(1)) / 2])

    def body_force(self, x: Expr) -> Expr:
        """Force per area, Pa, (3,), in equilibrium at small strain."""
        u = self._plane(x)
        strain = ufl.sym(ufl.as_matrix([[part.dx(i) for i in (0, 1)] for part in u]))
        stress = self.parameters.t * _stress(strain, self.parameters)
        return -ufl.as_vector([*(stress[i, 0].dx(0) + stress[i, 1].dx(1) for i in (0, 1)), 0 * x[0]])

    def _plane(self, x: Expr) -> list[Expr]:
        return [1e-4 * ufl.sin(2 * x[0] + x[1]), 1e-4 * ufl.cos(x[0] - 2 * x[1])]


def strain_energy(u: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Energy per area, J/m^2, in the plane, of bending and of shear out of it, and of drilling.

    The strain in the plane is marked as a variable: its second-order part makes the geometric stiffness.
    """
    n = plate_mitc._normal(u)
    move, turn = plate_mitc._parts(u)
    linear, bend, drill = plate_mitc._strains(u)
    h = ufl.grad(move) * plate_mitc._flat(u)
    plane = ufl.variable(linear + _along(u, p) + h.T * h / 2)
    shear = plate_mitc._flat(u) * (ufl.dot(n, ufl.grad(move)) + ufl.cross(turn, n))
    g = plate_mitc._shear_modulus(p)
    rule = _rule(u)
    return [
        (p.t / 2 * ufl.inner(plane, _stress(plane, p)), rule),
        (p.out_of_plane * p.t**3 / 24 * ufl.inner(bend, _stress(bend, p)), rule),
        (p.out_of_plane * _SHEAR * g * p.t / 2 * ufl.inner(shear, shear), rule),
        (_DRILLING * g * p.t / 2 * drill**2, rule),
    ]


def kinetic_energy(v: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Kinetic energy per area, J/m^2, of the rates of u (m/s) and theta (rad/s)."""
    return [(density, _rule(v)) for density, _ in plate_mitc.kinetic_energy(v, p)]


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Stress, Pa, (3, 3), of the energy's strain: in the plane, and in plane strain along the normal.

    `state` is None.
    """
    linear, _, _ = plate_mitc._strains(u)
    h = ufl.grad(plate_mitc._parts(u)[0]) * plate_mitc._flat(u)
    whole = _stress(linear + h.T * h / 2 + _along(u, p), p)
    return whole if p.plane_strain else plate_mitc._flat(u) * whole * plate_mitc._flat(u)


def reference() -> Reference:
    """A static problem in the plane, for the order tests."""
    return Reference(Parameters(E=7.0e10, nu=0.3, rho=2700.0, t=0.05))


def _along(u: Expr, p: Parameters) -> Expr:
    """Elastic strain along the normal, (3, 3), in plane strain: of what would expand and is held; cold it is zero."""
    n = plate_mitc._normal(u)
    along = ufl.outer(n, n)
    slope = ufl.dot(n, ufl.dot(ufl.grad(plate_mitc._parts(u)[0]), n))
    return slope * along if p.plane_strain else 0 * along


def _stress(strain: Expr, p: Parameters) -> Expr:
    """Stress, Pa, of a strain in the plane; in two dimensions, or in three."""
    if not p.plane_strain:
        return plate_mitc._plane_stress(strain, p)
    size = strain.ufl_shape[0]
    return p.E / (1 + p.nu) * (strain + p.nu / (1 - 2 * p.nu) * ufl.tr(strain) * ufl.Identity(size))


def _rule(u: Expr) -> Quadrature:
    n, geometry = degrees(u)
    return Quadrature(2 * n + 2 * (geometry - 1))
