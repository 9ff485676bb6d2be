"""What several forms have in common: rules, numbers, the isotropic elastic material, solids' elements and rigid motion.

Not a formulation, as its name begins with an underscore.  Forms alone import it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

import basix.ufl
import ufl
from ufl.core.expr import Expr as Expr


@dataclass(frozen=True)
class Quadrature:
    """The quadrature rule of one term: polynomial degree integrated exactly, and basix scheme."""

    degree: int
    scheme: str = "default"


#: Integrands, each with its own rule.
Terms: TypeAlias = list[tuple[Expr, Quadrature]]


def number(name: str, value: object) -> float:
    """The value as a float.

    Raises:
        ValueError: it is not a number.
    """
    # float() would take a text, and trips over an array
    if not hasattr(value, "__float__") or hasattr(value, "__len__") or isinstance(value, bool):
        raise ValueError(f"{name} must be a number, got {value!r}")
    try:
        return float(value)
    except (TypeError, OverflowError) as error:  # of numpy's scalars all have __float__, dates as well
        raise ValueError(f"{name} must be a number, got {value!r:.100}") from error


def take_numbers(values: object) -> None:
    """Turn the fields of a frozen dataclass that must be numbers into floats; called by its `__post_init__`.

    Raises:
        ValueError: one is not a number.
    """
    for item in fields(values):  # type: ignore[arg-type]
        if item.type in ("float", float):
            object.__setattr__(values, item.name, number(item.name, getattr(values, item.name)))


def check_positive(values: object, names: tuple[str, ...]) -> None:
    """Refuse numbers of a dataclass that are not positive and finite.

    Raises:
        ValueError: one is not.
    """
    for name in names:
        value = getattr(values, name)
        if not 0.0 < value < float("inf"):  # written so that NaN fails
            raise ValueError(f"{name} must be positive and finite, got {value}")


def check_finite(values: object, names: tuple[str, ...]) -> None:
    """Refuse numbers of a dataclass that are not finite.

    Raises:
        ValueError: one is not.
    """
    for name in names:
        if not abs(getattr(values, name)) < float("inf"):
            raise ValueError(f"{name} must be finite, got {getattr(values, name)}")


def check_poisson(nu: float) -> None:
    """Refuse a Poisson's ratio at which an isotropic material is not stable, or is incompressible.

    Raises:
        ValueError: it does not lie between -1 and 0.5.
    """
    if not -1.0 < nu < 0.5:
        raise ValueError(f"Poisson's ratio nu must lie between -1 and 0.5, both excluded, got {nu}")


@dataclass(frozen=True)
class IsotropicElastic:
    """An isotropic elastic material.

    Attributes:
        E: Young's modulus (at small strain), Pa, E > 0.
        nu: Poisson's ratio (at small strain), dimensionless, -1 < nu < 0.5.
        rho: density in the initial configuration, kg/m^3, rho > 0.
        alpha: coefficient of thermal expansion, 1/K, finite; by keyword.

    Raises:
        ValueError: a value is not a finite number inside its range.
    """

    E: float
    nu: float
    rho: float
    alpha: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        take_numbers(self)
        check_finite(self, ("alpha",))
        # written so that NaN fails each test
        if not 0.0 < self.E < float("inf"):
            raise ValueError(f"Young's modulus E must be positive and finite (Pa), got {self.E}")
        self._check_nu()
        if not 0.0 < self.rho < float("inf"):
            raise ValueError(f"density rho must be positive and finite (kg/m^3), got {self.rho}")

    def _check_nu(self) -> None:
        check_poisson(self.nu)


def shear_modulus(p: Any) -> Expr:
    """Shear modulus, Pa, of a material with E and nu."""
    return p.E / (2 * (1 + p.nu))


def bulk_modulus(p: Any) -> Expr:
    """Bulk modulus, Pa, of a material with E and nu."""
    return p.E / (3 * (1 - 2 * p.nu))


def thermal_stretch(p: Any, dT: Expr) -> Expr:
    """Stretch (3, 3) of an isotropic material with alpha, free to expand, by a rise of temperature dT, K."""
    return (1 + p.alpha * dT) * ufl.Identity(3)


def thermal_strain(p: Any, dT: Expr) -> Expr:
    """Small strain (3, 3) of an isotropic material with alpha, free to expand, by a rise of temperature dT, K."""
    return p.alpha * dT * ufl.Identity(3)


def small_strain_stress(u: Expr, p: Any) -> Expr:
    """Stress, Pa, 3 x 3, of the isotropic small-strain solid at the displacement u; nu below 1/2."""
    strain = ufl.sym(ufl.grad(u))
    return 2 * shear_modulus(p) * ufl.dev(strain) + bulk_modulus(p) * ufl.tr(strain) * ufl.Identity(3)


@dataclass(frozen=True)
class IncompressibleReference:
    """A static problem on the unit cube whose exact displacement is known, and in which elements that lock do lock.

    The volume strain is of the order of 1 - 2 nu, so that pressure and shear stress are of one size.

    Attributes:
        parameters: the material.
    """

    parameters: IsotropicElastic

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        s = [ufl.sin(ufl.pi * x[i] / 2) for i in range(3)]
        c = [ufl.cos(ufl.pi * x[i] / 2) for i in range(3)]
        isochoric = ufl.as_vector((s[0] * c[1] * c[2], c[0] * s[1] * c[2], -2 * c[0] * c[1] * s[2]))
        rest = ufl.as_vector((s[0] * c[1] * s[2], c[0] * c[1] * s[2], s[0] * s[1] * c[2]))
        return 1e-3 * (isochoric + (1 - 2 * self.parameters.nu) * rest)

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, with which it is in equilibrium at small strain."""
        return -ufl.div(small_strain_stress(self.displacement(x), self.parameters))


def element(cell: str, gdim: int, degree: int) -> basix.ufl._ElementBase:
    """Continuous vector Lagrange element on `cell` for the displacement in `gdim` dimensions."""
    return basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))


def rigid_motion(x: Expr, translation: Expr, rotation: Expr) -> Expr:
    """Displacement, m, at x of an infinitesimal rigid motion: translation + rotation x x."""
    return translation + ufl.cross(rotation, x)


def degrees(u: Expr) -> tuple[int, int]:
    """Polynomial degrees of the field u and of the geometry."""
    space = u.ufl_function_space()
    geometry = space.ufl_domain().ufl_coordinate_element()
    return space.ufl_element().embedded_superdegree, geometry.embedded_superdegree


def is_tetrahedron(u: Expr) -> bool:
    """Whether the cells of the field's mesh are tetrahedra."""
    return str(u.ufl_function_space().ufl_domain().ufl_cell()) == "tetrahedron"


def volume_change(h: Expr) -> Expr:
    """det(1 + h) - 1 of a displacement's gradient h (3, 3), without the round-off of numbers near one."""
    return ufl.tr(h) + _second_order(h)


def isochoric_energy(h: Expr, mu: Expr) -> Expr:
    """mu/2 (J^(-2/3) tr(F^T F) - 3), Pa, of F = 1 + h and J = det F; its derivatives are exact at small strain, too.

    With a = J^(1/3) and c = a - 1 what is of first order cancels by hand: tr(F^T F) - 3 a^2 is of second order in h.
    """
    change = volume_change(h)
    a = (1 + change) ** (1 / 3)
    c = change / (a**2 + a + 1)
    excess = ufl.inner(h, h) - 2 * _second_order(h) + c**2 * (2 * a + 1)
    return mu / 2 * excess / a**2


def _second_order(h: Expr) -> Expr:
    """What det(1 + h) has beyond its first order: the second and the third invariant."""
    return (ufl.tr(h) ** 2 - ufl.inner(h, h.T)) / 2 + ufl.det(h)
