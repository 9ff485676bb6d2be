"""Piezoelectric solid, poled along an axis of any direction: displacement and electric potential, the e-form.

Unknowns: displacement u (m) of a three-dimensional body, and psi = phi / potential_scale, where phi (V) is the electric
potential; with the scale of some 1e9 V all entries of the stiffness are of one size. Strong form, in the initial
configuration and quasi-static in the field:

    rho u'' = Div(F S) + b,   Div D = 0,   E_m = (F^T F - I) / 2,   E = -Grad phi,
    S = C : E_m - e^T E,      D = e : E_m + kappa E,

by the electric enthalpy H = E_m : C : E_m / 2 - E . e : E_m - E . kappa E / 2 per initial volume, of which the body is
the stationary value: least in u, largest in phi. The material is symmetric about the poled axis 3 (class 6mm):

    S_11 = c11 E_11 + c12 E_22 + c13 E_33 - e31 E_3,    D_1 = 2 e15 E_13 + kappa11 E_1,
    S_33 = c13 (E_11 + E_22) + c33 E_33 - e33 E_3,      D_3 = e31 (E_11 + E_22) + e33 E_33 + kappa33 E_3,
    S_13 = 2 c44 E_13 - e15 E_1,   S_12 = (c11 - c12) E_12.

Metal and glue are the same solid without e: `elastic` makes such parameters. Electrodes are conditions of the model
(`flexmbd.continuum.Electrode`). A rise of temperature strains by alpha11 across the axis and alpha33 along it, and so
brings charge where expansion is held; the primary pyroelectric effect, D at constant strain, is left out. Assumes small
strain and weak fields; large rotations are exact.

Reference: IEEE Standard on Piezoelectricity 176-1987, section 2; Allik & Hughes 1970,
doi:10.1002/nme.1620020202 (the element).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import basix.ufl
import ufl

from flexmbd.forms._shared import Expr, Terms, check_finite, check_poisson, check_positive, is_tetrahedron, take_numbers
from flexmbd.forms._shared import Quadrature as Quadrature

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """A piezoelectric material, symmetric about its poled axis.

    Attributes:
        c11, c12, c13, c33, c44: stiffnesses at constant electric field, Pa; positive definite.
        e31, e33, e15: piezoelectric constants, C/m^2, of any sign.
        kappa11, kappa33: permittivities at constant strain across and along the axis, F/m, positive.
        rho: density in the initial configuration, kg/m^3, positive.
        axis: the poled axis in the mesh's axes; any length, kept as a unit vector.
        potential_scale: V per unit of the unknown psi, positive; the same in all cells of a body.
        alpha11, alpha33: coefficients of thermal expansion across and along the axis, 1/K, finite; by keyword.

    Raises:
        ValueError: a value is out of its range, or the stiffness is not positive definite.
    """

    c11: float
    c12: float
    c13: float
    c33: float
    c44: float
    e31: float
    e33: float
    e15: float
    kappa11: float
    kappa33: float
    rho: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    potential_scale: float = 1e9
    alpha11: float = dataclasses.field(default=0.0, kw_only=True)
    alpha33: float = dataclasses.field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        take_numbers(self)
        check_positive(self, ("c11", "c33", "c44", "kappa11", "kappa33", "rho", "potential_scale"))
        check_finite(self, ("c12", "c13", "e31", "e33", "e15", "alpha11", "alpha33"))
        if not (abs(self.c12) < self.c11 and 2 * self.c13**2 < (self.c11 + self.c12) * self.c33):
            raise ValueError(
                "the stiffness must be positive definite, which needs |c12| < c11 and 2 c13^2 < (c11 + c12) c33"
            )
        object.__setattr__(self, "axis", _unit(self.axis))


def elastic(
    *,
    E: float,  # noqa: N803
    nu: float,
    rho: float,
    kappa: float = 8.8541878128e-12,
    potential_scale: float = 1e9,
    alpha: float = 0.0,
) -> Parameters:
    """An isotropic solid without piezoelectricity beside piezoelectric ones in a body.

    Args:
        E: Young's modulus, Pa.
        nu: Poisson's ratio, between -1 and 0.5.
        rho: density, kg/m^3.
        kappa: permittivity, F/m, by default that of empty space. A metal is an `Electrode` on its cells.
        potential_scale: that of the other cells.
        alpha: coefficient of thermal expansion, 1/K, finite.

    Raises:
        ValueError: a value is out of its range.
    """
    check_poisson(nu)
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    return Parameters(
        c11=lam + 2 * mu, c12=lam, c13=lam, c33=lam + 2 * mu, c44=mu, e31=0.0, e33=0.0, e15=0.0, kappa11=kappa,
        kappa33=kappa, rho=rho, potential_scale=potential_scale, alpha11=alpha, alpha33=alpha,
    )  # fmt: skip


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube whose exact solution is known.

    Attributes:
        parameters: the material, poled along z.
    """

    parameters: Parameters

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement (m) and potential (in its scale); D . n is zero on the whole boundary."""
        s = [ufl.cos(ufl.pi * x[i]) for i in range(3)]
        w = s[0] * s[1] * s[2]
        return 1e-3 * ufl.as_vector((0 * w, 0 * w, w, w / 2))

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, and the source of D in the unknown's unit."""
        p, whole = self.parameters, self.displacement(x)
        stress, d = _laws(ufl.sym(ufl.grad(ufl.as_vector([whole[i] for i in range(3)]))), _field(whole[3], p), p)
        force = -ufl.div(stress)
        return ufl.as_vector([*(force[i] for i in range(3)), -p.potential_scale * ufl.div(d)])


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Lagrange elements of one degree for the displacement and the potential."""
    displacement = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return basix.ufl.mixed_element([displacement, basix.ufl.element("Lagrange", cell, degree)])


def strain_energy(u: Expr, p: Parameters) -> Terms:
    """The electric enthalpy per initial volume, J/m^3, of the unknown u = (displacement, psi).

    The rule integrates the stiffness at rest exactly on straight cells.
    """
    displacement, psi = ufl.split(u)
    h = ufl.grad(displacement)
    strain, field = (h + h.T + h.T * h) / 2, _field(psi, p)
    stress, d = _laws(strain, field, p)
    n = _degree(u)
    enthalpy = (ufl.inner(stress, strain) - ufl.dot(d, field)) / 2
    return [(enthalpy, Quadrature(2 * n - 2 if is_tetrahedron(u) else 2 * n))]


def kinetic_energy(v: Expr, p: Parameters) -> Terms:
    """Kinetic energy per initial volume, J/m^3, of the rate v of the unknown; on straight cells exact."""
    velocity, _ = ufl.split(v)
    n = _degree(v)
    return [(p.rho / 2 * ufl.inner(velocity, velocity), Quadrature(2 * n if is_tetrahedron(v) else 2 * n + 2))]


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """The unknown at x of an infinitesimal rigid motion: translation + rotation x x, no potential."""
    displacement = translation + ufl.cross(rotation, x)
    return ufl.as_vector([*(displacement[i] for i in range(3)), 0.0])


def gauge(p: Parameters) -> dict[str, tuple[float, ...]]:
    """A potential of 1 V everywhere, which costs no energy."""
    return {"potential": (0.0, 0.0, 0.0, 1.0 / p.potential_scale)}


def thermal_stretch(p: Parameters, dT: Expr) -> Expr:
    """Stretch (3, 3), in the mesh's axes, of the material free to expand, by a rise of temperature dT, K."""
    a = ufl.as_vector([p.axis[i] for i in range(3)])
    along = ufl.outer(a, a)
    return ufl.Identity(3) + dT * (p.alpha11 * (ufl.Identity(3) - along) + p.alpha33 * along)


def stress(u: Expr, state: None, p: Parameters) -> Expr:
    """Stress of the small-strain solid, Pa, 3 x 3, in the mesh's axes; linear in u.

    The displacement is that relative to the body frame; `state` is None, the solid has no history.
    """
    displacement, psi = ufl.split(u)
    return _laws(ufl.sym(ufl.grad(displacement)), _field(psi, p), p)[0]


def reference() -> Reference:
    """A static problem of the ceramic PZT-5A, poled along z."""
    return Reference(
        Parameters(
            c11=1.21e11, c12=7.54e10, c13=7.52e10, c33=1.11e11, c44=2.11e10, e31=-5.4, e33=15.8, e15=12.3,
            kappa11=8.11e-9, kappa33=7.35e-9, rho=7750.0,
        )
    )  # fmt: skip


def _field(psi: Expr, p: Parameters) -> Expr:
    """Electric field, V/m."""
    return -p.potential_scale * ufl.grad(psi)


def _laws(strain: Expr, field: Expr, p: Parameters) -> tuple[Expr, Expr]:
    """Stress, Pa, (3, 3), and electric displacement, C/m^2, (3,), in the mesh's axes; of a strain and a field."""
    a = ufl.as_vector([p.axis[i] for i in range(3)])
    one, along = ufl.Identity(3), ufl.outer(a, a)
    # invariants about the axis: what the law is written in needs no frame across it
    pulled = strain * a
    s33 = ufl.dot(a, pulled)
    across = ufl.tr(strain) - s33
    shear = pulled - s33 * a
    e3 = ufl.dot(field, a)
    e_across = field - e3 * a
    plane = one - along
    in_plane = plane * strain * plane
    stress = (
        (p.c11 - p.c12) * in_plane
        + (p.c12 * across + p.c13 * s33 - p.e31 * e3) * plane
        + (p.c13 * across + p.c33 * s33 - p.e33 * e3) * along
        + _symmetric(2 * p.c44 * shear - p.e15 * e_across, a)
    )
    d = 2 * p.e15 * shear + p.kappa11 * e_across + (p.e31 * across + p.e33 * s33 + p.kappa33 * e3) * a
    return stress, d


def _symmetric(first: Expr, second: Expr) -> Expr:
    return ufl.outer(first, second) + ufl.outer(second, first)


def _unit(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in axis)
    except (TypeError, ValueError):
        raise ValueError(f"axis must be three numbers, got {axis!r}") from None
    length = (x * x + y * y + z * z) ** 0.5
    if not 0.0 < length < float("inf"):
        raise ValueError(f"axis must be a direction, got {axis!r}")
    return x / length, y / length, z / length


def _degree(u: Expr) -> int:
    """Polynomial degree of the displacement."""
    degree: int = u.ufl_function_space().ufl_element().embedded_superdegree
    return degree
