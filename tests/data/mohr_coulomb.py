"""Elasto-plastic soil of small strain: Mohr and Coulomb's yield surface with rounded edges and apex, perfectly plastic.

Unknown: displacement u (m). In the initial configuration, tension positive:

    sigma = C : (eps - eps_p),    f = h(sigma, phi) <= 0,    d eps_p = d lam dg/d sigma,    g = h(sigma, psi)
    h(sigma, alpha) = p sin(alpha) + sqrt(J2 K(theta)^2 + a^2 sin(alpha)^2) - c cos(alpha)

with the mean stress p, Lode's angle theta, sin(3 theta) = -(3 sqrt(3) / 2) J3 / J2^(3/2), the friction angle phi and
the dilatancy psi. K is Mohr and Coulomb's, cos(theta) - sin(alpha) sin(theta) / sqrt(3), up to the transition angle
theta_T, and beyond it the parabola in sin(3 theta) that has the same value, slope and curvature there; a rounds the
apex. A step is integrated by the implicit Euler method: seven equations at each point, for the plastic strain that it
adds and the multiplier lam. History: eps_p (xx, yy, zz, yz, xz, xy, tensor components), plastic work per volume.

References: Abbo, Lyamin, Sloan & Hambleton 2011, doi:10.1016/j.ijsolstr.2011.06.021 (edges); Abbo & Sloan 1995,
doi:10.1016/0045-7949(94)00339-5 (apex).
"""

from dataclasses import dataclass, replace
from typing import Any

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms.j2_plasticity import bulk_modulus, components, rule, shear_modulus, tensor
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion

CELLS = ("tetrahedron", "hexahedron")
ORDER = {1: 2, 2: 3}
REFERENCE = "INITIAL"


@dataclass(frozen=True)
class Parameters:
    """A soil.

    Attributes:
        E: Young's modulus, Pa.
        nu: Poisson's ratio.
        rho: density, kg/m^3.
        cohesion: Pa.
        friction: angle, rad, between 0 and 90 degrees.
        dilatancy: angle, rad, from above 0 to the friction angle, which makes the flow associated.
        apex: rounds the apex: over cohesion / tan(friction), the tension that the soil would stand.
        transition: Lode's angle, rad, from which on edges are rounded; below 30 degrees.
    """

    E: float
    nu: float
    rho: float
    cohesion: float
    friction: float
    dilatancy: float
    apex: float = 0.26
    transition: float = 0.4537856055185257  # 26 degrees

    def __post_init__(self) -> None:
        solid_linear.Parameters(self.E, self.nu, self.rho)
        if not 0.0 < self.cohesion < float("inf"):
            raise ValueError(f"cohesion must be positive and finite (Pa), got {self.cohesion}")
        if not 0.0 < self.dilatancy <= self.friction < 1.55:
            raise ValueError(
                "dilatancy must be positive and not above friction, which is below 90 degrees (rad), "
                f"got {self.dilatancy} and {self.friction}"
            )
        if not 0.0 < self.apex <= 1.0:
            raise ValueError(f"apex must be in (0, 1], got {self.apex}")
        if not 0.0 < self.transition < 0.52:
            raise ValueError(f"transition must be in (0, 30 degrees) (rad), got {self.transition}")


@dataclass(frozen=True)
class Reference:
    """The elastic problem of a solid, below first yield."""

    parameters: Parameters

    def displacement(self, x: Any) -> Any:
        return self._elastic().displacement(x)

    def body_force(self, x: Any) -> Any:
        return self._elastic().body_force(x)

    @property
    def yielding(self) -> tuple[Parameters, ...]:
        """A soil that yields at a strain of a thousandth."""
        return (replace(self.parameters, cohesion=self.parameters.E / 2000),)

    def _elastic(self) -> solid_linear.Reference:
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def state(p: Any) -> Any:
    return ufl.as_vector([0.0] * 7)


def state_names(p: Any) -> dict[str, int]:
    return {"plastic_strain_tensor": 6, "plastic_work": 1}


def local_unknowns(p: Any) -> Any:
    """What a step adds to the plastic strain, and the multiplier."""
    return ufl.as_vector([0.0] * 7)


def local_residual(z: Any, u: Any, state: Any, p: Any) -> Any:
    """Flow rule and yield condition where the trial stress yields, else z itself; without dimension."""
    sigma = ufl.variable(_stress(u, tensor(state) + tensor(z), p))
    flow = ufl.diff(_surface(sigma, p, p.dilatancy), sigma)
    lacks = [*components(tensor(z) - z[6] * flow), _surface(sigma, p, p.friction) / (2 * shear_modulus(p))]
    yields = ufl.gt(_surface(_stress(u, tensor(state), p), p, p.friction), 0.0)
    return ufl.as_vector([ufl.conditional(yields, lack, z[i]) for i, lack in enumerate(lacks)])


def residual(u: Any, v: Any, state: Any, p: Any, *, z: Any) -> list[Any]:
    return [(ufl.inner(stress(u, state, p, z=z), ufl.sym(ufl.grad(v))), rule(u))]


def update(u: Any, state: Any, p: Any, *, z: Any) -> Any:
    work = state[6] + ufl.inner(stress(u, state, p, z=z), tensor(z))
    return ufl.as_vector([*components(tensor(state) + tensor(z)), work])


def stress(u: Any, state: Any, p: Any, *, z: Any) -> Any:
    return _stress(u, tensor(state) + tensor(z), p)


def energies(u: Any, state: Any, p: Any) -> dict[str, Any]:
    strain = ufl.sym(ufl.grad(u)) - tensor(state)
    return {
        "elastic": (ufl.inner(_stress(u, tensor(state), p), strain) / 2, rule(u)),
        "plastic": (state[6], rule(u)),
    }


def scaled_yield(p: Any, factor: float) -> Any:
    return replace(p, cohesion=factor * p.cohesion)


def reference() -> Reference:
    """A rock below first yield."""
    return Reference(Parameters(6e9, 0.25, 2500.0, cohesion=1e12, friction=0.5, dilatancy=0.3))


def _stress(u: Any, plastic: Any, p: Any) -> Any:
    elastic = ufl.sym(ufl.grad(u)) - plastic
    return 2 * shear_modulus(p) * ufl.dev(elastic) + bulk_modulus(p) * ufl.tr(elastic) * ufl.Identity(3)


def _surface(sigma: Any, p: Any, angle: Any) -> Any:
    """h above, Pa: the yield function by the friction angle, the potential by the dilatancy."""
    s = ufl.dev(sigma)
    # an isotropic stress has no Lode angle
    j2 = ufl.max_value(ufl.inner(s, s) / 2, (1e-10 * p.cohesion) ** 2)
    sin3 = -1.5 * 3**0.5 * ufl.det(s) / j2**1.5
    # rounded as the cone of the friction angle is, at the height where that has its apex
    a = p.apex * p.cohesion / ufl.tan(angle)
    under = j2 * _deviatoric(sin3, p.transition, angle) ** 2 + (a * ufl.sin(angle)) ** 2
    return ufl.tr(sigma) / 3 * ufl.sin(angle) + ufl.sqrt(under) - p.cohesion * ufl.cos(angle)


def _deviatoric(sin3: Any, turn: Any, angle: Any) -> Any:
    """K over sin(3 theta)."""
    friction, bound = ufl.sin(angle) / 3**0.5, ufl.sin(3 * turn)
    theta = ufl.asin(ufl.max_value(ufl.min_value(sin3, bound), -bound)) / 3
    sharp = ufl.cos(theta) - friction * ufl.sin(theta)
    side = ufl.conditional(ufl.lt(sin3, 0.0), -1.0, 1.0)
    value = ufl.cos(turn) - friction * side * ufl.sin(turn)
    slope = -(side * ufl.sin(turn) + friction * ufl.cos(turn))
    s, c = side * bound, ufl.cos(3 * turn)
    second = (-value + 3 * s / c * slope) / (18 * c**2)
    first = slope / (3 * c) - 2 * second * s
    rounded = value + first * (sin3 - s) + second * (sin3**2 - s**2)
    return ufl.conditional(ufl.gt(abs(sin3), bound), rounded, sharp)
