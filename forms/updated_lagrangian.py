"""Elasto-plastic solid of finite strain: the updated Lagrangian form, with Truesdell's stress rate.

Unknown: displacement u (m) from the updated configuration t', which the mesh is, to the present one. Both
lie in the axes of the body frame, so that t' is the corotated ghost of the last known configuration. The
Green-Lagrange strain of the present configuration referred to t' is its own increment

    eps = e + eta,   e = sym grad u,   eta = 1/2 (grad u)^T grad u          (eq. 12-15)

and the second Piola-Kirchhoff stress referred to t' grows by S = tau' + C : eps (eq. 9-11, 17). The
virtual work over the volume of t' is the integral of S : delta eps = S : (delta e + delta eta) (eq. 18);
its derivative at u = 0 is K_L + K_NL, its value there F (eq. 39-41).

Pushed forward to the present configuration, S gives the rate of Truesdell:

    tau. = w tau - tau w + C : d + B(tau, d),   B(tau, d) = d tau + tau d - (tr d) tau

with the stretching d and the spin w. Equation 17 is for small steps: taken over a finite one it puts the strain
of the whole step, plastic flow as well, into S, whose push-forward makes a pressure of (K + 2/3 mu) |d|^2 out of
a shear d. Here a step integrates the rate itself, to second order, along the path on which the principal axes of
the stretch stay in place in the ghost: there d is constant and is the logarithm of the increment,

    d = 1/2 ln(1 + 2 eps),   trial tau = r (tau' + C : d + B(tau_m, d_e)) r^T,
    tau_m = tau' + 1/2 (C : d_e + B(tau', d_e)),   r = f (1 + 2 eps)^(-1/2),   f = 1 + grad u

by the midpoint rule, with the rotation r of the increment. In B stands the elastic part d_e of d, by eq. 58 with
a return of tau' + C : d at constant yield stress: flow, which keeps the volume, makes no pressure, and what B does
is the sole difference from C : d in the axes that turn. Of flow, two objective rates differ by the ratio of
stress and modulus; of elastic strains the rate is Truesdell's as it stands. A rigid rotation turns the stress and does
nothing else. Yield is checked on the Cauchy stress after the push-forward, and the stress returned radially
(eq. 57-62):

    f(tau, alpha) = sqrt(3/2) |dev tau| - sigma_y(alpha) <= 0

so that what acts in the virtual work is the returned tau, pulled back. History: tau (xx, yy, zz, yz, xz,
xy, in body axes), and the accumulated plastic strain alpha.

Truesdell's rate adds to the stress of a shear: with G = 1, sigma_11 = gamma^2 without bound. In metals
the elastic strain is small and no rate shows; for large elastic strain take `hencky_plasticity`.

Plastic flow keeps the volume, and fully integrated linear cells lock. The cure is the mean of det f over
a cell (`cell_mean`), by which f is scaled to (mean / det f)^(1/3) f in the stress (F-bar, de Souza Neto
et al. 1996, doi:10.1016/0020-7683(95)00259-6).

Equations of Ambrosio & Nikravesh 1992, Nonlinear Dynamics 3, "Elasto-plastic deformations in multibody
dynamics"; eq. 64 without its leading minus.
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms import j2_plasticity
from flexmbd.forms.hencky_plasticity import square_root
from flexmbd.forms.j2_plasticity import (
    Expr,
    Quadrature,
    Terms,
    bulk_modulus,
    components,
    rule,
    shear_modulus,
    tensor,
)
from flexmbd.forms.j2_plasticity import local_unknowns as local_unknowns
from flexmbd.forms.j2_plasticity import scaled_yield as scaled_yield
from flexmbd.forms.solid_linear import element as element
from flexmbd.forms.solid_linear import kinetic_energy as kinetic_energy
from flexmbd.forms.solid_linear import rigid_motion as rigid_motion

CELLS = ("tetrahedron", "hexahedron")

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the updated configuration.
REFERENCE = "UPDATED"

@dataclass(frozen=True)
class Parameters(j2_plasticity.IsotropicPlasticity):
    """The material: yields at first at that Cauchy stress."""


@dataclass(frozen=True)
class Reference(j2_plasticity.Reference):
    """The elastic problem of `solid_linear`, below first yield."""


def state(p: Parameters) -> Expr:
    """The history at rest, (7,): Cauchy stress (6 components, Pa) and accumulated plastic strain."""
    return ufl.as_vector([0.0] * 7)


def state_names(p: Parameters) -> dict[str, int]:
    """Parts of the history by name: Cauchy stress, and accumulated plastic strain."""
    return {"cauchy_stress": 6, "plastic_strain": 1}


def linear_strain(u: Expr) -> Expr:
    """e, the part of the strain increment that is linear in u (eq. 14)."""
    return ufl.sym(ufl.grad(u))


def nonlinear_strain(u: Expr) -> Expr:
    """eta, the part of the strain increment that is quadratic in u (eq. 15)."""
    h = ufl.grad(u)
    return h.T * h / 2


def elasticity(strain: Expr, p: Parameters) -> Expr:
    """C : strain of the isotropic elastic solid, Pa."""
    return bulk_modulus(p) * ufl.tr(strain) * ufl.Identity(3) + 2 * shear_modulus(p) * ufl.dev(strain)


def continuum_tangent(strain: Expr, stress: Expr, p: Parameters) -> Expr:
    """The elasto-plastic tensor of eq. 64 on a strain rate: C : strain less what flows at that stress, Pa.

    The stress yields, and the hardening is linear. This is the tangent of the rate equations; that of a
    finite step is the derivative of the returned stress.
    """
    normal = 1.5 / j2_plasticity.von_mises(ufl.dev(stress), p) * ufl.dev(stress)
    driven = elasticity(normal, p)
    flow = ufl.inner(driven, strain) / (p.hardening.growth(1.0) + ufl.inner(normal, driven))
    return elasticity(strain, p) - flow * driven


def cell_mean(u: Expr, state: Expr, p: Parameters) -> Expr:
    """What is averaged over each cell: present volume over updated volume."""
    return ufl.det(_stretch(u))


def local_residual(z: Expr, u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None) -> Expr:
    """What the increment z of the accumulated plastic strain makes zero; dimensionless."""
    size = j2_plasticity.von_mises(ufl.dev(_trial(u, state, p, mean)), p)
    return j2_plasticity.consistency(z, size, state[6], p, kinematic=0.0)


def residual(
    u: Expr, v: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Terms:
    """Virtual work of the internal forces per updated volume, J/m^3: one term, linear in v.

    Args:
        u: displacement from the updated configuration, m.
        v: virtual displacement, m.
        state: history at the step's begin, (7,).
        p: parameters.
        z: solution of `local_residual`, where there is one.
        mean: of `cell_mean` over the cell; without it det f at the point.
    """
    f = _stretch(u)
    cauchy, _ = _returned(u, state, p, z, mean)
    nominal = ufl.det(f) * cauchy * ufl.inv(f).T
    return [(ufl.inner(nominal, ufl.grad(v)), rule(u))]


def update(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """The history at the step's end, (7,)."""
    cauchy, growth = _returned(u, state, p, z, mean)
    return ufl.as_vector([*components(cauchy), state[6] + growth])


def stress(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """Cauchy stress, Pa, 3 x 3, at the step's end."""
    return _returned(u, state, p, z, mean)[0]


def energies(
    u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None
) -> dict[str, tuple[Expr, Quadrature]]:
    """Energies per volume of the mesh, J/m^3, with the history `state` of the same instant (u = 0).

    "elastic" is that of the small elastic strain C^-1 tau; "plastic" the work that the yield stress has done.
    """
    cauchy, k = tensor(state), ufl.tr(tensor(state)) / 3
    elastic = ufl.inner(ufl.dev(cauchy), ufl.dev(cauchy)) / (4 * shear_modulus(p)) + k**2 / (2 * bulk_modulus(p))
    done = p.yield_stress * state[6] + p.hardening.work(state[6])
    return {"elastic": (elastic, rule(u)), "plastic": (done, rule(u))}


def reference() -> Reference:
    """A steel below first yield."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=1.0e12))


def _stretch(u: Expr) -> Expr:
    return ufl.Identity(3) + ufl.grad(u)


def _trial(u: Expr, state: Expr, p: Parameters, mean: Expr | None) -> Expr:
    """Cauchy stress, Pa, of a step without flow beyond what `_elastic_part` leaves out."""
    f = _stretch(u)
    strain = linear_strain(u) + nonlinear_strain(u)
    volume = ufl.det(f)
    if mean is not None:
        # a root, which has no value where a cell is inside out
        factor = (mean / volume) ** (1 / 3)
        f, strain, volume = factor * f, factor**2 * strain + (factor**2 - 1) / 2 * ufl.Identity(3), mean
    stretch = square_root(ufl.Identity(3) + 2 * strain)
    rotation = f * ufl.inv(stretch)
    d = ufl.dev(_logarithm(strain, stretch)) + ufl.ln(volume) / 3 * ufl.Identity(3)
    begin, whole = tensor(state), elasticity(d, p)
    elastic = _elastic_part(d, begin + whole, state, p)
    middle = begin + (elasticity(elastic, p) + _convected(begin, elastic)) / 2
    return rotation * (begin + whole + _convected(middle, elastic)) * rotation.T


def _logarithm(strain: Expr, stretch: Expr) -> Expr:
    """1/2 ln(1 + 2 strain), given the root of 1 + 2 strain: its digits are those of the strain.

    Twice the inverse hyperbolic tangent of (stretch - 1) / (stretch + 1), by its series; off by h^7 / 448 at h.
    """
    half = ufl.inv(stretch + ufl.Identity(3))
    y = ufl.sym(2 * strain * half * half)
    square = y * y
    return 2 * ufl.sym(y + y * square / 3 + y * square * square / 5)


def _convected(stress: Expr, d: Expr) -> Expr:
    """B(stress, d): what Truesdell's rate adds to the stress in axes that turn, of a stretching d."""
    return d * stress + stress * d - ufl.tr(d) * stress


def _elastic_part(d: Expr, trial: Expr, state: Expr, p: Parameters) -> Expr:
    """The elastic part of the stretching d, by a return of `trial`, Pa, at the yield stress of the step's begin."""
    size = j2_plasticity.von_mises(ufl.dev(trial), p)
    over = ufl.max_value(size - p.yield_stress - p.hardening.growth(state[6]), 0.0)
    return d - over / (2 * shear_modulus(p) * size) * ufl.dev(trial)


def _returned(
    u: Expr, state: Expr, p: Parameters, z: Expr | None, mean: Expr | None
) -> tuple[Expr, Expr]:
    """Cauchy stress, Pa, at the step's end, and growth of the accumulated plastic strain."""
    trial = _trial(u, state, p, mean)
    deviator = ufl.dev(trial)
    size = j2_plasticity.von_mises(deviator, p)
    growth = j2_plasticity.plastic_growth(size, state[6], p, z=z, kinematic=0.0)
    return trial - 3 * shear_modulus(p) * growth / size * deviator, growth
