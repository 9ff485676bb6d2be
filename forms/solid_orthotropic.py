"""Orthotropic elastic solid, St Venant-Kirchhoff, with material axes of any direction.

Unknown: displacement u (m) of a three-dimensional body. Strong form in the initial configuration:

    rho u'' = Div(F S) + b,   F = I + Grad u,   S = C : E,   E = (F^T F - I) / 2

with the energy W = E : C : E / 2 per initial volume. In the material axes a_1, a_2, a_3 the normal
components of E and S are related by the compliance

    [ 1/E1      -nu12/E1  -nu13/E1 ]
    [ -nu12/E1  1/E2      -nu23/E2 ],     S_ij = 2 G_ij E_ij  for i != j.
    [ -nu13/E1  -nu23/E2  1/E3     ]

The third derivative of the energy, from which the geometric stiffness follows, is not zero. Assumes a
homogeneous material and small strain; large rotations are exact.

Reference: Lekhnitskii 1981, Theory of Elasticity of an Anisotropic Body, chapter 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import ufl

from flexmbd.forms._shared import Quadrature as Quadrature
from flexmbd.forms._shared import check_finite, check_positive, degrees, is_tetrahedron, take_numbers
from flexmbd.forms._shared import element as element
from flexmbd.forms._shared import rigid_motion as rigid_motion

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """An orthotropic elastic material.

    Attributes:
        E1, E2, E3: Young's moduli along the material axes, Pa, positive.
        nu12, nu13, nu23: Poisson's ratios; under tension along i the strain along j is -nu_ij times
            that along i. The compliance must be positive definite.
        G12, G13, G23: shear moduli, Pa, positive.
        rho: density in the initial configuration, kg/m^3, positive.
        axis_1: the first material axis, in the mesh's axes; any length, kept as a unit vector.
        axis_2: the second; of it only what is at right angles to the first is taken. The third
            makes them right-handed.
        alpha_1, alpha_2, alpha_3: coefficients of thermal expansion along the material axes, 1/K, finite; by keyword.

    Raises:
        ValueError: a value is out of its range, the compliance is not positive definite, or the axes
            do not span a plane.
    """

    E1: float
    E2: float
    E3: float
    nu12: float
    nu13: float
    nu23: float
    G12: float
    G13: float
    G23: float
    rho: float
    axis_1: tuple[float, float, float] = (1.0, 0.0, 0.0)
    axis_2: tuple[float, float, float] = (0.0, 1.0, 0.0)
    alpha_1: float = field(default=0.0, kw_only=True)
    alpha_2: float = field(default=0.0, kw_only=True)
    alpha_3: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        take_numbers(self)
        axes = (_vector(name, getattr(self, name)) for name in ("axis_1", "axis_2"))
        check_positive(self, ("E1", "E2", "E3", "G12", "G13", "G23", "rho"))
        check_finite(self, ("alpha_1", "alpha_2", "alpha_3"))
        self._check_definite()
        first, second = _right_angled(*axes)
        object.__setattr__(self, "axis_1", first)
        object.__setattr__(self, "axis_2", second)

    def _check_definite(self) -> None:
        """Principal minors of the compliance, each divided by its diagonal entries."""
        n12 = self.nu12**2 * self.E2 / self.E1
        n13 = self.nu13**2 * self.E3 / self.E1
        n23 = self.nu23**2 * self.E3 / self.E2
        mixed = 2 * self.nu12 * self.nu23 * self.nu13 * self.E3 / self.E1
        minors = {
            "nu12^2 E2/E1 < 1": 1 - n12,
            "nu13^2 E3/E1 < 1": 1 - n13,
            "nu23^2 E3/E2 < 1": 1 - n23,
            "nu12^2 E2/E1 + nu13^2 E3/E1 + nu23^2 E3/E2 + 2 nu12 nu13 nu23 E3/E1 < 1": (
                1 - n12 - n13 - n23 - mixed
            ),
        }
        for rule, minor in minors.items():
            if not minor > 0:
                raise ValueError(f"the compliance must be positive definite, which needs {rule}")


@dataclass(frozen=True)
class Reference:
    """A static problem on the unit cube whose exact displacement is known.

    Attributes:
        parameters: the material.
    """

    parameters: Parameters

    def displacement(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        s = [ufl.sin(ufl.pi * x[i] / 2) for i in range(3)]
        c = [ufl.cos(ufl.pi * x[i] / 2) for i in range(3)]
        return 1e-3 * ufl.as_vector((s[0] * c[1] * s[2], c[0] * c[1] * s[2], s[0] * s[1] * c[2]))

    def body_force(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Body force, N/m^3, with which it is in equilibrium at small strain."""
        return -ufl.div(_stress(ufl.sym(ufl.grad(self.displacement(x))), self.parameters))


def strain_energy(
    u: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """St Venant-Kirchhoff energy per initial volume, J/m^3.

    The rule integrates the stiffness at rest exactly on straight cells, and a constant stress
    exactly on curved ones (so the patch test holds there too).
    """
    h = ufl.grad(u)
    # from H rather than F^T F - I: no cancellation at small strain
    strain = (h + h.T + h.T * h) / 2
    n, g = degrees(u)
    if is_tetrahedron(u):
        degree = (n - 1) + max(n - 1, 2 * (g - 1))
    else:
        degree = n + max(n, 2 * g - 1)
    return [(ufl.inner(_stress(strain, p), strain) / 2, Quadrature(degree))]


def kinetic_energy(
    v: ufl.core.expr.Expr, p: Parameters
) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
    """Kinetic energy per initial volume, J/m^3, of the velocity v (m/s); exact on curved cells."""
    n, g = degrees(v)
    jacobian = 3 * (g - 1) if is_tetrahedron(v) else 3 * g - 1
    return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * n + jacobian))]


def stress(u: ufl.core.expr.Expr, state: None, p: Parameters) -> ufl.core.expr.Expr:
    """Cauchy stress of the small-strain solid, Pa, 3 x 3, in the mesh's axes; linear in u.

    The displacement is that relative to the body frame; `state` is None, the solid has no history.
    """
    return _stress(ufl.sym(ufl.grad(u)), p)


def thermal_stretch(p: Parameters, dT: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Stretch (3, 3), in the mesh's axes, of the material free to expand, by a rise of temperature dT, K."""
    strains = zip((p.alpha_1, p.alpha_2, p.alpha_3), _axes(p), strict=True)
    return ufl.Identity(3) + sum(alpha * dT * ufl.outer(a, a) for alpha, a in strains)


def reference() -> Reference:
    """A static problem of smooth displacement; carbon fibre in epoxy, in no axes of the cube."""
    return Reference(
        Parameters(
            E1=1.35e11,
            E2=1.0e10,
            E3=8.0e9,
            nu12=0.3,
            nu13=0.25,
            nu23=0.4,
            G12=5.0e9,
            G13=4.5e9,
            G23=3.5e9,
            rho=1600.0,
            axis_1=(2.0, 1.0, 0.5),
            axis_2=(0.0, 1.0, 0.3),
        )
    )


def _stress(strain: ufl.core.expr.Expr, p: Parameters) -> ufl.core.expr.Expr:
    """C : strain, Pa, 3 x 3, in the mesh's axes."""
    axes = _axes(p)
    compliance = ufl.as_matrix(
        [
            [1 / p.E1, -p.nu12 / p.E1, -p.nu13 / p.E1],
            [-p.nu12 / p.E1, 1 / p.E2, -p.nu23 / p.E2],
            [-p.nu13 / p.E1, -p.nu23 / p.E2, 1 / p.E3],
        ]
    )
    normal = ufl.inv(compliance) * ufl.as_vector([ufl.dot(a, strain * a) for a in axes])
    total = sum(normal[i] * ufl.outer(a, a) for i, a in enumerate(axes))
    for i, j, shear in ((0, 1, p.G12), (0, 2, p.G13), (1, 2, p.G23)):
        plane = ufl.outer(axes[i], axes[j])
        total += 2 * shear * ufl.dot(axes[i], strain * axes[j]) * (plane + plane.T)
    return total


def _axes(p: Parameters) -> tuple[ufl.core.expr.Expr, ...]:
    """The three material axes, unit vectors in the mesh's axes."""
    first, second = (ufl.as_vector([axis[i] for i in range(3)]) for axis in (p.axis_1, p.axis_2))
    return first, second, ufl.cross(first, second)


def _vector(name: str, value: tuple[float, float, float]) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be three numbers, got {value!r}") from None
    return x, y, z


def _right_angled(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Unit vectors: along the first, and along what of the second is at right angles to it."""
    lengths = [sum(a * a for a in axis) ** 0.5 for axis in (first, second)]
    if all(0.0 < length < float("inf") for length in lengths):
        x, y, z = (a / lengths[0] for a in first)
        along = sum(a * b for a, b in zip((x, y, z), second, strict=True))
        across = [b - along * a for a, b in zip((x, y, z), second, strict=True)]
        rest = sum(b * b for b in across) ** 0.5
        if rest > 1e-6 * lengths[1]:
            return (x, y, z), (across[0] / rest, across[1] / rest, across[2] / rest)
    raise ValueError(f"axis_1 and axis_2 must span a plane, got {first} and {second}")
