"""Elasto-plastic solid of small strain: J2 (von Mises) flow with isotropic and kinematic hardening.

Unknown: displacement u (m) of a three-dimensional body in its body frame, which carries the gross
rotation. Strong form in the initial configuration:

    rho u'' = Div sigma + b,   sigma = C : (eps - eps_p),   eps = sym Grad u
    f = sqrt(3/2) |s - X| - sigma_y(alpha) <= 0,   X = 2/3 H_k eps_p   (Prager)
    d eps_p = 3/2 d alpha (s - X) / (sqrt(3/2) |s - X|)                (associated flow)

with the deviator s of sigma and the accumulated plastic strain alpha. A step is integrated by the
implicit Euler method, whose equations are those of the radial return: one scalar equation for the
increment z of alpha, closed where sigma_y is linear, else `local_residual`. The consistent tangent is
the derivative of the stress at the step's end by the displacement. History: eps_p (xx, yy, zz, yz, xz,
xy, tensor components) and alpha.

Plastic flow keeps the volume, and fully integrated linear cells lock. The cure is the mean of div u
over a cell (`cell_mean`), which takes the place of div u in the pressure: with J2 flow the pressure is
elastic. Without it the form is the plain displacement method.

References: Simo & Hughes 1998, Computational Inelasticity, box 3.2 (return); Nagtegaal, Parks & Rice
1974, doi:10.1016/0045-7825(74)90032-2 (mean dilatation); Ambrosio & Nikravesh 1992, eq. 57-64.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms._hardening import Hardening as Hardening
from flexmbd.forms._hardening import LinearHardening as LinearHardening
from flexmbd.forms._hardening import TabulatedHardening as TabulatedHardening
from flexmbd.forms._hardening import VoceHardening as VoceHardening
from flexmbd.forms._hardening import check_yield
from flexmbd.forms._shared import Expr as Expr
from flexmbd.forms._shared import Terms as Terms
from flexmbd.forms._shared import bulk_modulus as bulk_modulus
from flexmbd.forms._shared import check_finite, take_numbers
from flexmbd.forms._shared import shear_modulus as shear_modulus
from flexmbd.forms._shared import thermal_strain as thermal_strain
from flexmbd.forms.solid_linear import Quadrature as Quadrature
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

# A stress below this part of the yield stress has no direction.
_NO_STRESS = 1e-10


@dataclass(frozen=True)
class IsotropicPlasticity:
    """An isotropic elasto-plastic material with isotropic hardening, of this form and others.

    Attributes:
        E: Young's modulus, Pa, E > 0.
        nu: Poisson's ratio, dimensionless, -1 < nu < 0.5.
        rho: density in the initial configuration, kg/m^3, rho > 0.
        yield_stress: at first yield in a uniaxial test, Pa, > 0.
        hardening: how it grows with the accumulated plastic strain; constant by default.

    Raises:
        ValueError: a value is not a finite number inside its range, or a hardening table does not
            begin at the yield stress.
    """

    E: float
    nu: float
    rho: float
    yield_stress: float
    hardening: Hardening = field(default_factory=LinearHardening)

    def __post_init__(self) -> None:
        take_numbers(self)
        solid_linear.Parameters(self.E, self.nu, self.rho)
        check_yield(self.yield_stress, self.hardening)


@dataclass(frozen=True)
class Parameters(IsotropicPlasticity):
    """The material of this form: `IsotropicPlasticity`, and kinematic hardening.

    Attributes:
        kinematic_modulus: Prager's plastic modulus H_k of a uniaxial test, Pa, at least 0.
        alpha: coefficient of thermal expansion, 1/K, finite; by keyword.

    Raises:
        ValueError: as there, or the modulus is not finite, or below zero, or alpha is not finite.
    """

    kinematic_modulus: float = 0.0
    alpha: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_finite(self, ("alpha",))
        if not 0.0 <= self.kinematic_modulus < float("inf"):
            raise ValueError(f"kinematic_modulus must be finite and at least 0 (Pa), got {self.kinematic_modulus}")


@dataclass(frozen=True)
class Reference:
    """The elastic problem of `solid_linear`, below first yield.

    Attributes:
        parameters: the material.
    """

    parameters: Any

    def displacement(self, x: Expr) -> Expr:
        """Exact displacement, m, at the point x; prescribed on the whole boundary."""
        return self._elastic().displacement(x)

    def body_force(self, x: Expr) -> Expr:
        """Body force, N/m^3, with which it is in equilibrium."""
        return self._elastic().body_force(x)

    @property
    def yielding(self) -> tuple[Any, ...]:
        """Materials that yield at a strain of a thousandth: with linear hardening, and with a curve."""
        p = self.parameters
        laws = LinearHardening(p.E / 50), VoceHardening(p.E / 2000, 50.0)
        return tuple(replace(p, yield_stress=p.E / 1000, hardening=law) for law in laws)

    def _elastic(self) -> solid_linear.Reference:
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def state(p: Parameters) -> Expr:
    """The history at rest, (7,): plastic strain (6 components) and accumulated plastic strain."""
    return ufl.as_vector([0.0] * 7)


def state_names(p: Parameters) -> dict[str, int]:
    """Parts of the history by name: plastic strain, and the accumulated one."""
    return {"plastic_strain_tensor": 6, "plastic_strain": 1}


def local_unknowns(p: Parameters) -> float | None:
    """The increment of the accumulated plastic strain to begin with; None where it is closed."""
    return None if isinstance(p.hardening, LinearHardening) else 0.0


def scaled_yield(p: Any, factor: float) -> Any:
    """The same material with its first yield stress `factor` times as high: of this form and others."""
    more = (factor - 1) * p.yield_stress
    law = p.hardening
    if isinstance(law, TabulatedHardening):
        law = replace(law, stress=tuple(stress + more for stress in law.stress))
    return replace(p, yield_stress=p.yield_stress + more, hardening=law)


def local_residual(z: Expr, u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None) -> Expr:
    """What the increment z of the accumulated plastic strain makes zero; dimensionless."""
    shifted, alpha = _trial(u, state, p)
    return consistency(z, von_mises(shifted, p), alpha, p, kinematic=p.kinematic_modulus)


def cell_mean(u: Expr, state: Expr, p: Parameters) -> Expr:
    """What is averaged over each cell: the volume strain."""
    return ufl.div(u)


def residual(
    u: Expr, v: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Terms:
    """Virtual work of the internal forces per initial volume, J/m^3: one term, linear in v.

    Args:
        u: displacement, m.
        v: virtual displacement, m.
        state: history at the step's begin, (7,).
        p: parameters.
        z: solution of `local_residual`, where there is one.
        mean: of `cell_mean` over the cell; without it the volume strain at the point.
    """
    deviator, _, _ = _return(u, state, p, z)
    strain = ufl.sym(ufl.grad(v))
    pressure = bulk_modulus(p) * (ufl.div(u) if mean is None else mean)
    return [(ufl.inner(deviator, strain) + pressure * ufl.div(v), rule(u))]


def update(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """The history at the step's end, (7,)."""
    _, flow, growth = _return(u, state, p, z)
    plastic = tensor(state) + growth * flow
    return ufl.as_vector([*components(plastic), state[6] + growth])


def stress(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """Cauchy stress, Pa, 3 x 3, at the step's end."""
    deviator, _, _ = _return(u, state, p, z)
    return deviator + bulk_modulus(p) * (ufl.div(u) if mean is None else mean) * ufl.Identity(3)


def energies(
    u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None
) -> dict[str, tuple[Expr, Quadrature]]:
    """Energies per initial volume, J/m^3, with the history `state` of the same instant.

    "elastic" is what unloading gives back, that of the kinematic hardening included; "plastic" the
    work that the yield stress has done.
    """
    strain = ufl.dev(ufl.sym(ufl.grad(u))) - tensor(state)
    volume = ufl.div(u) if mean is None else mean
    mu, plastic = shear_modulus(p), tensor(state)
    elastic = mu * ufl.inner(strain, strain) + bulk_modulus(p) / 2 * volume**2
    elastic += p.kinematic_modulus / 3 * ufl.inner(plastic, plastic)
    done = p.yield_stress * state[6] + p.hardening.work(state[6])
    return {"elastic": (elastic, rule(u)), "plastic": (done, rule(u))}


def reference() -> Reference:
    """A steel below first yield."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=1.0e12, hardening=LinearHardening(1.0e9)))


def rule(u: Expr) -> Quadrature:
    """The rule of every term: 8 points for the trilinear hexahedron, 4 for the quadratic tetrahedron."""
    space = u.ufl_function_space()
    n = space.ufl_element().embedded_superdegree
    return Quadrature(2 * (n - 1) if str(space.ufl_domain().ufl_cell()) == "tetrahedron" else 2 * n)


def tensor(values: Expr) -> Expr:
    """The symmetric tensor of the first six components xx, yy, zz, yz, xz, xy."""
    xx, yy, zz, yz, xz, xy = (values[k] for k in range(6))
    return ufl.as_matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def components(values: Expr) -> list[Expr]:
    """xx, yy, zz, yz, xz, xy of a symmetric tensor."""
    return [values[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]


def von_mises(deviator: Expr, p: Any) -> Expr:
    """sqrt(3/2) |deviator|, Pa; never below a vanishing part of the yield stress, where it has a slope."""
    return ufl.sqrt(ufl.max_value(1.5 * ufl.inner(deviator, deviator), (_NO_STRESS * p.yield_stress) ** 2))


def consistency(z: Expr, trial: Expr, alpha: Expr, p: Any, *, kinematic: Expr) -> Expr:
    """(3 mu + H_k) z + sigma_y(alpha + z) - trial over 3 mu where the trial stress yields, else z."""
    mu = shear_modulus(p)
    held = p.yield_stress + p.hardening.growth(alpha)
    over = (3 * mu + kinematic) * z + p.yield_stress + p.hardening.growth(alpha + z) - trial
    return ufl.conditional(ufl.gt(trial, held), over / (3 * mu), z)


def plastic_growth(
    trial: Expr, alpha: Expr, p: Any, *, z: Expr | None, kinematic: Expr
) -> Expr:
    """The increment of the accumulated plastic strain: closed for linear hardening, else z.

    Args:
        trial: von Mises value, Pa, of the elastic trial stress (less the back stress).
        alpha: accumulated plastic strain at the step's begin.
        p: parameters.
        z: solution of `consistency`, which follows the displacement.
        kinematic: Prager's modulus, Pa.
    """
    if z is not None:
        return z
    over = trial - p.yield_stress - p.hardening.growth(alpha)
    return ufl.max_value(over, 0.0) / (3 * shear_modulus(p) + p.hardening.growth(1.0) + kinematic)


def _trial(u: Expr, state: Expr, p: Parameters) -> tuple[Expr, Expr]:
    """Deviator of the trial stress less the back stress, Pa, and accumulated plastic strain."""
    mu, plastic = shear_modulus(p), tensor(state)
    elastic = ufl.dev(ufl.sym(ufl.grad(u))) - plastic
    return 2 * mu * elastic - 2 / 3 * p.kinematic_modulus * plastic, state[6]


def _return(
    u: Expr, state: Expr, p: Parameters, z: Expr | None
) -> tuple[Expr, Expr, Expr]:
    """Deviator of the stress at the step's end, direction 3/2 (s - X) / q, and growth of alpha."""
    shifted, alpha = _trial(u, state, p)
    trial = von_mises(shifted, p)
    growth = plastic_growth(trial, alpha, p, z=z, kinematic=p.kinematic_modulus)
    flow = 1.5 / trial * shifted
    mu = shear_modulus(p)
    elastic = ufl.dev(ufl.sym(ufl.grad(u))) - tensor(state)
    return 2 * mu * (elastic - growth * flow), flow, growth
