"""Flat shell of Reissner and Mindlin: linear triangles and quadrilaterals that do not lock as they get thin.

Unknowns at each node of a surface in space that is flat in each cell: displacement u (m) and rotation
theta (rad). With n the normal, P = 1 - n n, and the normal fibre's tilt f = theta x n,

    membrane e = P (H + H^T + H^T H) P / 2,  H = grad u,
    bending k = P sym(grad f) P,  shear g = P H^T n + f,
    W = t C(e)/2 + t^3/12 C(k)/2 + s G t |g|^2 / 2 + d G t (theta . n - spin)^2 / 2    per area,
    C(e) = E/(1 - nu^2) ((1 - nu) e:e + nu (tr e)^2),   G = E / (2 (1 + nu)),

spin the rotation of the surface in its plane. Where cells meet at an angle this shell bends over the
edge. Warped quadrilaterals are not meant.

No locking: along each edge the shear takes the value it has in the edge's middle, and is in the cell
the field of lowest order that has these values (the edge element of Nedelec; MITC4 of Bathe and
Dvorkin, MITC3). Its stiffness is scaled, s = 5/6 t^2 / (t^2 + h^2/10), h^2 the mean square of the
edges, which makes both stable for any thickness and changes the solution no more than the order of
the element (Lyly, Stenberg, Vihinen). Drilling: theta . n follows the spin of the displacement by a
penalty, d = 1/100 (Hughes and Brezzi), which keeps six dofs at each node without stiffening the
membrane. Drilling has no inertia. The membrane is that of constant-strain triangles and bilinear
quadrilaterals. Rotations are moderate: the strain is that of Green and Lagrange in the membrane, from
which the geometric stiffness follows, and linear in bending and shear.

References: Bathe & Dvorkin 1985, doi:10.1002/nme.1620210213; Lyly, Stenberg & Vihinen 1993,
doi:10.1016/0045-7825(93)90214-I; Hughes & Brezzi 1989, doi:10.1016/0045-7825(89)90124-2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import basix.ufl
import ufl
from ufl.core.expr import Expr

from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import check_finite, check_poisson, check_positive, take_numbers
from flexmbd.forms._shared import thermal_stretch as thermal_stretch

CELLS = ("triangle", "quadrilateral")

# L2 order of the displacement by element degree.
ORDER = {1: 2}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

# Shear factor of a rectangular section (Reissner).
_SHEAR = 5 / 6
# Softening of shear, by (h / t)^2, and stiffness of drilling over that of in-plane shear.
_STABLE = 0.1
_DRILLING = 0.01


@dataclass(frozen=True)
class Parameters:
    """An isotropic elastic material, and the thickness, the same everywhere.

    Attributes:
        E: Young's modulus, Pa, E > 0.
        nu: Poisson's ratio, dimensionless, -1 < nu < 0.5.
        rho: density, kg/m^3, rho > 0.
        t: thickness, m, t > 0.
        alpha: coefficient of thermal expansion, 1/K, finite; by keyword.

    Raises:
        ValueError: a value is not a finite number inside its range.
    """

    E: float
    nu: float
    rho: float
    t: float
    alpha: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        take_numbers(self)
        check_finite(self, ("alpha",))
        check_positive(self, ("E", "rho", "t"))
        check_poisson(self.nu)


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit square, z = 0, whose exact solution is known.

    Attributes:
        parameters: the material and the thickness.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement (m) and rotation (rad) at the point x, (6,); prescribed on the boundary."""
        u, slope = self._plane(x), self._slope(x)
        # a normal fibre tilts by theta x n = (theta_y, -theta_x), which is -slope
        return ufl.as_vector([*u, self._deflection(x), slope[1], -slope[0], (u[1].dx(0) - u[0].dx(1)) / 2])

    def body_force(self, x: Expr) -> Expr:
        """Force, Pa, and moment, N/m, per area at the point x, (6,), in equilibrium."""
        p, w, slope = self.parameters, self._deflection(x), self._slope(x)
        shear = [_SHEAR * _shear_modulus(p) * p.t * (w.dx(i) - slope[i]) for i in (0, 1)]
        stretching = _divergence(self._stress([p.t * part for part in self._plane(x)]))
        bending = _divergence(self._stress([-(p.t**3) / 12 * part for part in slope]))
        # on the tilt (theta_y, -theta_x)
        couple = [shear[i] - bending[i] for i in (0, 1)]
        lift = -(shear[0].dx(0) + shear[1].dx(1))
        return ufl.as_vector([-stretching[0], -stretching[1], lift, -couple[1], couple[0], 0 * w])

    def _stress(self, u: list[Expr]) -> Expr:
        """Plane stress of displacements in the plane."""
        return _plane_stress(ufl.sym(ufl.as_matrix([[part.dx(i) for i in (0, 1)] for part in u])), self.parameters)

    def _plane(self, x: Expr) -> list[Expr]:
        return [1e-4 * ufl.sin(2 * x[0] + x[1]), 1e-4 * ufl.cos(x[0] - 2 * x[1])]

    def _deflection(self, x: Expr) -> Expr:
        return 1e-3 * ufl.sin(2 * x[0] + 0.4) * ufl.cos(2 * x[1] - 0.3)

    def _slope(self, x: Expr) -> list[Expr]:
        """That of the surface but for a shear of the size that thin plates have."""
        w = self._deflection(x)
        return [w.dx(0) + 1e-6 * ufl.sin(x[1]), w.dx(1) + 1e-6 * ufl.cos(x[0] + 0.2)]


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Continuous Lagrange element on `cell` for displacement and rotation in `gdim` dimensions."""
    return basix.ufl.element("Lagrange", cell, degree, shape=(2 * gdim,))


def strain_energy(u: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Energy per area, J/m^2, of stretching and bending, of shear, and of drilling.

    The membrane's strain is marked as a variable: its second-order part makes the geometric stiffness.
    """
    linear, bend, drill = _strains(u)
    h = ufl.grad(_parts(u)[0]) * _flat(u)
    membrane = ufl.variable(linear + h.T * h / 2)
    shear, edge = _shear(u)
    g = _shear_modulus(p)
    plane = p.t / 2 * ufl.inner(membrane, _plane_stress(membrane, p))
    plane += p.t**3 / 24 * ufl.inner(bend, _plane_stress(bend, p))
    transverse = _SHEAR * p.t**2 / (p.t**2 + _STABLE * edge) * g * p.t / 2 * ufl.inner(shear, shear)
    rule = Quadrature(2)
    return [(plane, rule), (transverse, rule), (_DRILLING * g * p.t / 2 * drill**2, rule)]


def kinetic_energy(v: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Kinetic energy per area, J/m^2, of the rates of u (m/s) and theta (rad/s)."""
    move, turn = _parts(v)
    tilt = ufl.cross(turn, _normal(v))
    rule = Quadrature(2)
    return [
        (p.rho * p.t / 2 * ufl.inner(move, move), rule),
        (p.rho * p.t**3 / 24 * ufl.inner(tilt, tilt), rule),
    ]


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """Displacement, m, and rotation, rad, at x of an infinitesimal rigid motion, (6,)."""
    return ufl.as_vector([*(translation + ufl.cross(rotation, x)), *rotation])


def motion(u: Expr, xi: Expr, p: Parameters) -> Expr:
    """Displacement, m, of the material point at the height xi = (z,), m, over the surface; linear in u."""
    move, turn = _parts(u)
    return move + xi[0] * ufl.cross(turn, _normal(u))


def section_inertia(p: Parameters) -> Expr:
    """Integral of rho {1, z} {1, z} dz: kg/m^2, kg/m, kg."""
    return p.rho * ufl.as_matrix(((p.t, 0), (0, p.t**3 / 12)))


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Stress, Pa, (3, 3), of stretching and bending at the face that the normal points to, z = t/2.

    Of the energy's strain, to second order in the membrane. `state` is None.
    """
    linear, bend, _ = _strains(u)
    h = ufl.grad(_parts(u)[0]) * _flat(u)
    n, faced = _normal(u), _plane_stress(linear + h.T * h / 2 + p.t / 2 * bend, p)
    return faced - ufl.dot(n, ufl.dot(faced, n)) * ufl.outer(n, n)


def reference() -> Reference:
    """A static problem of a thin plate, stretched and bent, for the order tests."""
    return Reference(Parameters(E=7.0e10, nu=0.3, rho=2700.0, t=0.01))


def _strains(u: Expr) -> tuple[Expr, Expr, Expr]:
    """Linear membrane strain (3, 3), bending strain (3, 3), 1/m, and drilling, rad."""
    n = _normal(u)
    move, turn = _parts(u)
    spinning = _cross_matrix(n)
    flat = _flat(u)
    slope = flat * ufl.grad(move) * flat
    # the gradient of the rotation, then turned: cells are flat
    tilting = -flat * spinning * ufl.grad(turn) * flat
    return ufl.sym(slope), ufl.sym(tilting), ufl.dot(turn, n) - ufl.inner(ufl.skew(slope), spinning) / 2


def _shear(u: Expr) -> tuple[Expr, Expr]:
    """Transverse shear (3,) from its values in the middles of edges, and the mean square of the edges, m^2."""
    domain = ufl.domain.extract_unique_domain(u)
    vertices = ufl.geometry.CellVertices(domain)
    corners = [ufl.as_vector([vertices[i, j] for j in range(3)]) for i in range(vertices.ufl_shape[0])]
    n, jacobian = _normal(u), ufl.Jacobian(domain)
    tangents = [ufl.as_vector([jacobian[i, k] for i in range(3)]) for k in (0, 1)]
    move, turn = _parts(u)
    arm = ufl.SpatialCoordinate(domain) - corners[0]
    cells = _triangle_shear if len(corners) == 3 else _quadrilateral_shear
    rotary, square = cells(turn, arm, corners, tangents, n)
    covariant = [ufl.dot(n, ufl.dot(ufl.grad(move), g)) + part for g, part in zip(tangents, rotary, strict=True)]
    return ufl.dot(ufl.as_vector(covariant), ufl.JacobianInverse(domain)), square


def _triangle_shear(
    turn: Expr, arm: Expr, corners: list[Expr], tangents: list[Expr], n: Expr
) -> tuple[list[Expr], Expr]:
    """What rotations add to the covariant shear: (a + c y, b - c x) in the reference cell, and the edges."""
    first, second = (ufl.dot(ufl.grad(turn), g) for g in tangents)
    x, y = _coordinates(arm, tangents, tangents, n)

    def edge(a: float, b: float, side: Expr) -> Expr:
        return ufl.dot(turn + (a - x) * first + (b - y) * second, ufl.cross(n, side))

    sides = corners[1] - corners[0], corners[2] - corners[0], corners[2] - corners[1]
    along_x, along_y, slanted = edge(0.5, 0, sides[0]), edge(0, 0.5, sides[1]), edge(0.5, 0.5, sides[2])
    c = along_y - along_x - slanted
    return [along_x + c * y, along_y - c * x], sum(ufl.dot(side, side) for side in sides) / 3


def _quadrilateral_shear(
    turn: Expr, arm: Expr, corners: list[Expr], tangents: list[Expr], n: Expr
) -> tuple[list[Expr], Expr]:
    """What rotations add to the covariant shear, each part linear between opposite edges, and the edges."""
    low, high = corners[1] - corners[0], corners[3] - corners[2]
    left, right = corners[2] - corners[0], corners[3] - corners[1]
    x, y = _coordinates(arm, [low, left], tangents, n)
    first, second = (ufl.dot(ufl.grad(turn), g) for g in tangents)
    # second derivative by both reference coordinates: the tangents change along each other as well
    i, j, k = ufl.indices(3)
    bends = ufl.grad(ufl.grad(turn))
    twist = ufl.as_vector(bends[i, j, k] * tangents[0][j] * tangents[1][k], i)
    twist += ufl.dot(ufl.grad(turn), high - low)

    def edge(a: float, b: float, side: Expr) -> Expr:
        at = turn + (a - x) * first + (b - y) * second + (a - x) * (b - y) * twist
        return ufl.dot(at, ufl.cross(n, side))

    along_x = (1 - y) * edge(0.5, 0, low) + y * edge(0.5, 1, high)
    along_y = (1 - x) * edge(0, 0.5, left) + x * edge(1, 0.5, right)
    return [along_x, along_y], sum(ufl.dot(side, side) for side in (low, high, left, right)) / 4


def _coordinates(arm: Expr, sides: list[Expr], tangents: list[Expr], n: Expr) -> tuple[Expr, Expr]:
    """Reference coordinates of a place `arm` away from the first corner, whose two edges are `sides`."""

    def area(a: Expr, b: Expr) -> Expr:
        return ufl.dot(ufl.cross(a, b), n)

    # on a quadrilateral arm = x side_0 + y tangent_1 = y side_1 + x tangent_0
    x = area(arm, tangents[1]) / area(sides[0], tangents[1])
    y = area(tangents[0], arm) / area(tangents[0], sides[1])
    return x, y


def _parts(u: Expr) -> tuple[Expr, Expr]:
    """Displacement and rotation."""
    return ufl.as_vector([u[i] for i in range(3)]), ufl.as_vector([u[i] for i in range(3, 6)])


def _normal(u: Expr) -> Expr:
    return ufl.CellNormal(ufl.domain.extract_unique_domain(u))


def _flat(u: Expr) -> Expr:
    """Projection onto the surface."""
    n = _normal(u)
    return ufl.Identity(3) - ufl.outer(n, n)


def _cross_matrix(n: Expr) -> Expr:
    return ufl.as_matrix(((0, -n[2], n[1]), (n[2], 0, -n[0]), (-n[1], n[0], 0)))


def _shear_modulus(p: Parameters) -> Expr:
    return p.E / (2 * (1 + p.nu))


def _plane_stress(strain: Expr, p: Parameters) -> Expr:
    """Stress, Pa, of a strain in the surface; in two dimensions, or in three."""
    size = strain.ufl_shape[0]
    return p.E / (1 - p.nu**2) * ((1 - p.nu) * strain + p.nu * ufl.tr(strain) * ufl.Identity(size))


def _divergence(stress: Expr) -> list[Expr]:
    """Of a (2, 2) stress in the plane z = 0."""
    return [stress[i, 0].dx(0) + stress[i, 1].dx(1) for i in (0, 1)]
