"""Spatial beam with shear and rotary inertia, geometrically exact; at rest it is Timoshenko's beam.

Unknowns on a line in space, straight or curved: displacement u (m) of the axis, and rotation theta of
the sections: the vector 2 tan(phi/2) e of a rotation by phi about e, for small ones phi e (rad). With
Lambda(theta) the rotation, r the axis, ' the derivative along it and f, c force and moment per length:

    rho A d2u/dt2 = (Lambda n)' + f,   d(spin)/dt = (Lambda m)' + r' x Lambda n + c,
    gamma = Lambda^T r' - r_0',   kappa = axial(Lambda^T Lambda'),
    W = E A gamma_t^2 / 2 + G A (ky gamma_y^2 + kz gamma_z^2) / 2
      + G J kappa_t^2 / 2 + E (Iy kappa_y^2 + Iz kappa_z^2 - 2 Iyz kappa_y kappa_z) / 2,
    n = dW/dgamma,   m = dW/dkappa

per length of the initial axis, in the section's axes t, y, z: tangent from a cell's first node to its
second, the part of `orientation` normal to it, and t x y. The energy is that of finite rotations on
purpose: its third derivative at rest, from which the geometric stiffness follows, is not zero. Assumes
small strain, plane sections whose y and z are axes through the centroid, which is the centre of shear as
well, and free warping.

Lagrange elements of equal degree for u and theta. Stretch and shear are integrated by as many Gauss
points as the element has degree, which removes locking on straight and curved axes alike: that is
the mixed method of Arnold, and every element keeps its six rigid motions and no other. A large turn
of a bent beam is free of energy in the limit of fine elements alone, with the fourth power of their
length for quadratic ones, since components of theta are interpolated.

References: Timoshenko 1921, doi:10.1080/14786442108636264; Reissner 1981, On finite deformations of
space-curved beams, doi:10.1007/BF00946983; Arnold 1981, doi:10.1007/BF01396318 (integration).
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import ufl
from ufl.core.expr import Expr

from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import check_poisson, check_positive, degrees, number, take_numbers

SectionAxes = tuple[Expr, Expr, Expr]

CELLS = ("interval",)

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """An isotropic elastic material and a section that is the same along the beam.

    `rectangle`, `tube` and `i_section` give those of plain sections.

    Attributes:
        E: Young's modulus, Pa, E > 0.
        nu: Poisson's ratio, dimensionless, -1 < nu < 0.5; G = E / (2 (1 + nu)).
        rho: density in the initial configuration, kg/m^3, rho > 0.
        A: area, m^2, A > 0.
        Iy, Iz: second moments of area about y, integral of z^2, and about z, of y^2; m^4, positive.
        J: torsion constant, m^4, J > 0.
        ky, kz: shear factors for forces along y and z, dimensionless, positive.
        orientation: a vector, in the mesh's axes, that is nowhere along the axis; its part normal to
            the axis is y.
        Iyz: product of area, integral of y z, m^4, Iyz^2 < Iy Iz; zero where y and z are principal axes.

    Raises:
        ValueError: a value is not a finite number inside its range, or the orientation is zero.
    """

    E: float
    nu: float
    rho: float
    A: float
    Iy: float
    Iz: float
    J: float
    ky: float
    kz: float
    orientation: tuple[float, float, float]
    Iyz: float = 0.0

    def __post_init__(self) -> None:
        take_numbers(self)
        check_positive(self, ("E", "rho", "A", "Iy", "Iz", "J", "ky", "kz"))
        if not self.Iyz**2 < self.Iy * self.Iz:
            raise ValueError(
                f"Iyz^2 must be less than Iy Iz, as for every section: got Iyz = {self.Iyz}, Iy = {self.Iy}, "
                f"Iz = {self.Iz} m^4, with which bending would have no positive energy"
            )
        check_poisson(self.nu)
        try:
            parts = tuple(self.orientation)
        except TypeError:  # a single number, of an array too
            parts = ()
        vector = tuple(number("each part of orientation", part) for part in parts)
        if len(vector) != 3 or not 0.0 < sum(part * part for part in vector) < float("inf"):
            raise ValueError(f"orientation must be a vector of length above zero, got {self.orientation!r}")
        object.__setattr__(self, "orientation", vector)

    @classmethod
    def rectangle(
        cls,
        E: float,
        nu: float,
        rho: float,
        *,
        width: float,
        height: float,
        orientation: tuple[float, float, float],
    ) -> Parameters:
        """A rectangle of `width` (m) along y and `height` (m) along z.

        The torsion constant is Saint-Venant's series (Timoshenko & Goodier 1970, article 109), the
        shear factors are Cowper's (1966, doi:10.1115/1.3625046).
        """
        width, height, nu = number("width", width), number("height", height), number("nu", nu)
        if not (width > 0.0 and height > 0.0 and 0.0 < width * height * width * height < float("inf")):
            raise ValueError(f"width and height must be lengths above zero, got {width} m and {height} m")
        long, short = max(width, height), min(width, height)
        series = sum(float(ufl.tanh(n * ufl.pi * long / (2 * short))) / n**5 for n in range(1, 20, 2))
        shear = 10 * (1 + nu) / (12 + 11 * nu)
        torsion = long * short**3 * (1 / 3 - 64 / ufl.pi**5 * short / long * series)
        Iy, Iz = width * height**3 / 12, height * width**3 / 12
        return cls(E, nu, rho, width * height, Iy, Iz, torsion, shear, shear, orientation)

    @classmethod
    def tube(
        cls,
        E: float,
        nu: float,
        rho: float,
        *,
        outer_radius: float,
        inner_radius: float = 0.0,
        orientation: tuple[float, float, float],
    ) -> Parameters:
        """A round tube of these radii (m), solid with the inner one zero; shear factor by Cowper (1966)."""
        if not 0.0 <= inner_radius < outer_radius:
            raise ValueError(f"inner_radius must lie from 0 to below outer_radius, got {inner_radius}, {outer_radius}")
        area = ufl.pi * (outer_radius**2 - inner_radius**2)
        second = ufl.pi / 4 * (outer_radius**4 - inner_radius**4)
        m = (inner_radius / outer_radius) ** 2
        shear = 6 * (1 + nu) * (1 + m) ** 2 / ((7 + 6 * nu) * (1 + m) ** 2 + (20 + 12 * nu) * m)
        return cls(E, nu, rho, area, second, second, 2 * second, shear, shear, orientation)

    @classmethod
    def i_section(
        cls,
        E: float,
        nu: float,
        rho: float,
        *,
        width: float,
        height: float,
        flange: float,
        web: float,
        orientation: tuple[float, float, float],
    ) -> Parameters:
        """An I with flanges `width` (m) along y, `height` over all along z, of these thicknesses.

        For thin walls: the torsion constant is the sum of length times thickness^3 / 3; the shear factor
        along the web is Cowper's (1966), that along the flanges their share of the area times 5/6.
        """
        inside = height - 2 * flange
        if not (0.0 < web < width and 0.0 < flange and inside > 0.0):
            raise ValueError(f"an I of width {width}, height {height}, flange {flange} and web {web} has no web")
        area = 2 * width * flange + inside * web
        Iy = (width * height**3 - (width - web) * inside**3) / 12
        Iz = (2 * flange * width**3 + inside * web**3) / 12
        middle = height - flange
        torsion = (2 * width * flange**3 + middle * web**3) / 3
        n, m = width / middle, 2 * width * flange / (middle * web)
        below = 12 + 72 * m + 150 * m**2 + 90 * m**3 + nu * (11 + 66 * m + 135 * m**2 + 90 * m**3)
        below += 30 * n**2 * (m + m**2) + 5 * nu * n**2 * (8 * m + 9 * m**2)
        along_web = 10 * (1 + nu) * (1 + 3 * m) ** 2 / below
        along_flanges = 5 / 6 * 2 * width * flange / area
        return cls(E, nu, rho, area, Iy, Iz, torsion, along_flanges, along_web, orientation)


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit interval of the x axis whose exact solution is known.

    Attributes:
        parameters: the material and section.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement (m) and rotation (rad) at the point x, (6,); both prescribed at the ends."""
        return ufl.as_vector(self._fields(x[0]))

    def body_force(self, x: Expr) -> Expr:
        """Force, N/m, and moment, N, per length at the point x, (6,), in equilibrium at small strain."""
        s = ufl.variable(x[0])

        def d(f: Expr) -> Expr:
            return ufl.diff(f, s)

        u, v, w, twist, about_y, about_z = self._fields(s)
        strains = d(u), d(v) - about_z, d(w) + about_y, d(twist), d(about_y), d(about_z)
        n, qy, qz = ufl.elem_mult(_stretching(self.parameters), ufl.as_vector(strains[:3]))
        mt, my, mz = _bending(self.parameters) * ufl.as_vector(strains[3:])
        return -ufl.as_vector([d(n), d(qy), d(qz), d(mt), d(my) - qz, d(mz) + qy])

    def _fields(self, s: Expr) -> list[Expr]:
        """The sections turn with the axis but for a shear of the size that thin beams have."""
        k = ufl.pi
        return [
            1e-3 * ufl.sin(k * s / 2),
            1e-2 * ufl.sin(k * s + 0.4),
            1e-2 * ufl.cos(k * s - 0.3),
            1e-2 * ufl.sin(k * s / 2 + 1.0),
            1e-2 * k * ufl.sin(k * s - 0.3) + 1e-4 * ufl.sin(k * s + 0.8),
            1e-2 * k * ufl.cos(k * s + 0.4) + 1e-4 * ufl.cos(k * s + 0.1),
        ]


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Continuous Lagrange element on `cell` for displacement and rotation in `gdim` dimensions."""
    return basix.ufl.element("Lagrange", cell, degree, shape=(2 * gdim,))


def strain_energy(u: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Energy per initial length, J/m, of stretch and shear, and of twist and bending.

    The first by n Gauss points, n the degree of the element: exactly integrated it would lock. The
    strains are marked as variables: their second-order parts make the geometric stiffness.
    """
    axes = _axes(u, p)
    move, turn = _parts(u)
    d_move, d_turn = _along(move, axes[0]), _along(turn, axes[0])
    # Lambda^T v = v + back(v); from u' rather than r' - r_0': no cancellation at small strain
    factor = 1 / (1 + ufl.dot(turn, turn) / 4)

    def back(v: Expr) -> Expr:
        once = ufl.cross(turn, v)
        return factor * (ufl.cross(turn, once) / 2 - once)

    gamma = ufl.variable(_components(d_move + back(axes[0] + d_move), axes))
    kappa = ufl.variable(_components(factor * (d_turn - ufl.cross(turn, d_turn) / 2), axes))
    n, g = degrees(u)
    return [
        (ufl.inner(ufl.elem_mult(_stretching(p), gamma), gamma) / 2, Quadrature(2 * n - 2)),
        (ufl.inner(_bending(p) * kappa, kappa) / 2, Quadrature(2 * n - 2 + 2 * (g - 1))),
    ]


def kinetic_energy(v: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Kinetic energy per initial length, J/m, of the rates of u (m/s) and theta (rad/s)."""
    move, turn = _parts(v)
    spin = _components(turn, _axes(v, p))
    bending = p.Iy * spin[1] ** 2 + p.Iz * spin[2] ** 2 - 2 * p.Iyz * spin[1] * spin[2]
    rotary = (p.Iy + p.Iz) * spin[0] ** 2 + bending
    n, g = degrees(v)
    rule = Quadrature(2 * n + 2 * (g - 1))
    return [(p.rho * p.A / 2 * ufl.inner(move, move), rule), (p.rho / 2 * rotary, rule)]


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """Displacement, m, and rotation, rad, at x of an infinitesimal rigid motion, (6,)."""
    return ufl.as_vector([*(translation + ufl.cross(rotation, x)), *rotation])


def motion(u: Expr, xi: Expr, p: Parameters) -> Expr:
    """Displacement, m, of the material point at xi = (y, z), m, in the section; linear in u."""
    _, y, z = _axes(u, p)
    move, turn = _parts(u)
    return move + ufl.cross(turn, xi[0] * y + xi[1] * z)


def section_inertia(p: Parameters) -> Expr:
    """Integral of rho {1, y, z} {1, y, z} dA: kg/m, kg, kg m."""
    return p.rho * ufl.as_matrix(((p.A, 0, 0), (0, p.Iz, p.Iyz), (0, p.Iyz, p.Iy)))


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Resultants in the section's axes, (6,): forces along t, y, z (N), moments about them (N m).

    Of small strain and rotations; linear in u, so modes may be superposed. `state` is None.
    """
    axes = _axes(u, p)
    move, turn = _parts(u)
    gamma = _along(move, axes[0]) - ufl.cross(turn, axes[0])
    force = ufl.elem_mult(_stretching(p), _components(gamma, axes))
    moment = _bending(p) * _components(_along(turn, axes[0]), axes)
    return ufl.as_vector([*force, *moment])


def reference() -> Reference:
    """A static problem with stretch, twist, and bending about both axes, for the order tests."""
    p = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.05, height=0.03, orientation=(0.0, 1.0, 0.0))
    return Reference(p)


def _axes(u: Expr, p: Parameters) -> SectionAxes:
    """Unit vectors t, y, z of the section, in the mesh's axes."""
    jacobian = ufl.Jacobian(ufl.domain.extract_unique_domain(u))
    t = _unit(ufl.as_vector([jacobian[i, 0] for i in range(3)]))
    towards = ufl.as_vector(p.orientation)
    y = _unit(towards - ufl.dot(towards, t) * t)
    return t, y, ufl.cross(t, y)


def _unit(v: Expr) -> Expr:
    return v / ufl.sqrt(ufl.dot(v, v))


def _parts(u: Expr) -> tuple[Expr, Expr]:
    """Displacement and rotation."""
    return ufl.as_vector([u[i] for i in range(3)]), ufl.as_vector([u[i] for i in range(3, 6)])


def _along(f: Expr, t: Expr) -> Expr:
    """Derivative along the axis."""
    return ufl.dot(ufl.grad(f), t)


def _components(v: Expr, axes: SectionAxes) -> Expr:
    return ufl.as_vector([ufl.dot(v, axis) for axis in axes])


def _stretching(p: Parameters) -> Expr:
    """Stiffness, N, of stretch and of shear along y and z."""
    shear = p.E / (2 * (1 + p.nu)) * p.A
    return ufl.as_vector((p.E * p.A, shear * p.ky, shear * p.kz))


def _bending(p: Parameters) -> Expr:
    """Stiffness, N m^2, of twist and of bending about y and z, (3, 3)."""
    twist = p.E / (2 * (1 + p.nu)) * p.J
    return ufl.as_matrix(((twist, 0, 0), (0, p.E * p.Iy, -p.E * p.Iyz), (0, -p.E * p.Iyz, p.E * p.Iz)))
