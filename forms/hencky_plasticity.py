"""Elasto-plastic solid of finite strain: logarithmic (Hencky) elasticity and J2 flow.

Unknown: displacement u (m) from the updated configuration, which the mesh is, to the present one, both
in the axes of the body frame. With f = 1 + grad u and the elastic left Cauchy-Green tensor b:

    trial:   b = f b' f^T,   h = 1/2 ln b                              (logarithmic elastic strain)
    stress:  J tau = 2 mu dev h + J p 1,   p = kappa ln theta / theta  (Cauchy stress tau)
    flow:    dev h returned radially where sqrt(3/2) |2 mu dev h| exceeds sigma_y(alpha)

In these strains the equations of a step are those of small strain (exponential map), for strains of any
size; a uniaxial test follows them exactly in Kirchhoff stress J tau and logarithmic strain. The rate is
the logarithmic one: no oscillation in simple shear, where sigma_12 = 4 h / sqrt(4 + gamma^2). It is the
one to take for metals at large strain, because the elastic law is that of an energy: a closed cycle of
elastic strain gives no work. History: b of unit determinant (xx, yy, zz, yz, xz, xy) less the unit tensor,
alpha, ln theta, and J - 1, the present volume over the initial one.

theta is J, or with `cell_mean` the mean dilatation of the cell: then linear cells do not lock under plastic
flow, which keeps the volume, and the virtual work is still the derivative of an energy.

The logarithm is 4 ln of the fourth root: roots of a 3 x 3 tensor from its invariants, whose first is one
Newton iteration of a scalar, and Gauss quadrature of ln(1 + a) = integral of a / (1 + t a) with four points.
All of it is smooth at b = 1, as eigenvalues are not. Its relative error at an elastic stretch of exp h is
4 pi tanh(h/8)^9 / h: round-off up to 1.1, 5e-9 for 2, 3e-5 for 8. The exponential of a plastic step is
Pade's of order (3, 3): z^7 / 800 off where the step's plastic strain is z, 1e-10 for a tenth.

References: Simo 1992, doi:10.1016/0045-7825(92)90123-2 (exponential map); Simo, Taylor & Pister 1985,
doi:10.1016/0045-7825(85)90033-7 (mean dilatation); Hoger & Carlson 1984, doi:10.1090/qam/736511 (roots).
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms import j2_plasticity
from flexmbd.forms.j2_plasticity import (
    Expr,
    LinearHardening,
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

# Points and weights of Gauss on the interval from 0 to 1.
_GAUSS = (
    (0.06943184420297371, 0.17392742256872692),
    (0.33000947820757187, 0.32607257743127307),
    (0.66999052179242813, 0.32607257743127307),
    (0.93056815579702629, 0.17392742256872692),
)

# Of the first invariant of a root: enough for stretches of 8.
_NEWTON = 6


@dataclass(frozen=True)
class Parameters(j2_plasticity.IsotropicPlasticity):
    """The material: yields at first at that Kirchhoff stress; its plastic strain is logarithmic."""


@dataclass(frozen=True)
class Reference(j2_plasticity.Reference):
    """The elastic problem of `solid_linear`, below first yield."""


def state(p: Parameters) -> Expr:
    """The history at rest, (9,): see above."""
    return ufl.as_vector([0.0] * 9)


def state_names(p: Parameters) -> dict[str, int]:
    """Parts of the history by name: see above; the accumulated plastic strain is alpha."""
    return {"elastic_left_cauchy_green": 6, "plastic_strain": 1, "log_mean_dilatation": 1, "dilatation": 1}


def local_residual(z: Expr, u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None) -> Expr:
    """What the increment z of the accumulated plastic strain makes zero; dimensionless."""
    size = j2_plasticity.von_mises(_trial(u, state, p)[1], p)
    return j2_plasticity.consistency(z, size, state[6], p, kinematic=0.0)


def cell_mean(u: Expr, state: Expr, p: Parameters) -> Expr:
    """What is averaged over each cell: present volume over updated volume."""
    return ufl.det(_stretch(u))


def residual(
    u: Expr, v: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Terms:
    """Virtual work of the internal forces per updated volume, J/m^3: one term, linear in v.

    Args:
        u: displacement from the updated configuration, m.
        v: virtual displacement, m.
        state: history at the step's begin, (9,).
        p: parameters.
        z: solution of `local_residual`, where there is one.
        mean: of `cell_mean` over the cell; without it det f at the point.
    """
    _, _, kirchhoff, _ = _return(u, state, p, z)
    f = _stretch(u)
    stress = kirchhoff / (1 + state[8]) + ufl.det(f) * _pressure(u, state, p, mean) * ufl.Identity(3)
    return [(ufl.inner(stress * ufl.inv(f).T, ufl.grad(v)), rule(u))]


def update(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """The history at the step's end, (9,)."""
    b, flow, _, growth = _return(u, state, p, z)
    j = ufl.det(_stretch(u))
    # exp(-2 growth flow) by Pade's formula of order (3, 3): the unit tensor to the last digit where nothing flows
    x = -2 * growth * flow
    even, odd = ufl.Identity(3) + x * x / 10, x / 2 + x * x * x / 120
    relaxed = ufl.inv(even - odd) * (even + odd) * b
    relaxed = ufl.sym(relaxed) / ufl.det(relaxed) ** (1 / 3) - ufl.Identity(3)
    theta = state[7] + ufl.ln(j if mean is None else mean)
    return ufl.as_vector([*components(relaxed), state[6] + growth, theta, (1 + state[8]) * j - 1])


def stress(
    u: Expr, state: Expr, p: Parameters, *, z: Expr | None = None, mean: Expr | None = None
) -> Expr:
    """Cauchy stress, Pa, 3 x 3, at the step's end."""
    _, _, kirchhoff, _ = _return(u, state, p, z)
    volume = (1 + state[8]) * ufl.det(_stretch(u))
    return kirchhoff / volume + _pressure(u, state, p, mean) * ufl.Identity(3)


def energies(
    u: Expr, state: Expr, p: Parameters, *, mean: Expr | None = None
) -> dict[str, tuple[Expr, Quadrature]]:
    """Energies per volume of the mesh, J/m^3, with the history `state` of the same instant (u = 0).

    "elastic" is what unloading gives back, "plastic" the work that the yield stress has done.
    """
    strain = logarithm(tensor(state) + ufl.Identity(3)) / 2
    elastic = shear_modulus(p) * ufl.inner(ufl.dev(strain), ufl.dev(strain)) + bulk_modulus(p) / 2 * state[7] ** 2
    done = p.yield_stress * state[6] + p.hardening.work(state[6])
    volume = 1 + state[8]
    return {"elastic": (elastic / volume, rule(u)), "plastic": (done / volume, rule(u))}


def reference() -> Reference:
    """A steel below first yield."""
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=1.0e12, hardening=LinearHardening(1.0e9)))


def logarithm(b: Expr) -> Expr:
    """ln b of a symmetric positive tensor, 3 x 3, by two roots and Gauss quadrature."""
    root = square_root(square_root(b))
    excess = root - ufl.Identity(3)
    return 4 * sum(weight * excess * ufl.inv(ufl.Identity(3) + t * excess) for t, weight in _GAUSS)


def square_root(b: Expr) -> Expr:
    """The symmetric positive root v of b = v v, 3 x 3 (Hoger & Carlson 1984)."""
    first, third = ufl.tr(b), ufl.sqrt(ufl.det(b))
    square = b * b
    second = (first**2 - ufl.tr(square)) / 2
    # the largest root of x^4 - 2 I x^2 - 8 sqrt(III) x + I^2 - 4 II, by Newton from above
    x = ufl.sqrt(3 * first)
    for _ in range(_NEWTON):
        value = ((x**2 - 2 * first) * x - 8 * third) * x + first**2 - 4 * second
        x = x - value / (4 * ((x**2 - first) * x - 2 * third))
    y = (x**2 - first) / 2
    return (x * third * ufl.Identity(3) + (x**2 - y) * b - square) / (x * y - third)


def _stretch(u: Expr) -> Expr:
    return ufl.Identity(3) + ufl.grad(u)


def _trial(u: Expr, state: Expr, p: Parameters) -> tuple[Expr, Expr]:
    """Trial b of unit determinant, and deviator of the trial Kirchhoff stress, Pa."""
    f = _stretch(u)
    b = f * (tensor(state) + ufl.Identity(3)) * f.T / ufl.det(f) ** (2 / 3)
    return b, shear_modulus(p) * ufl.dev(logarithm(b))


def _return(u: Expr, state: Expr, p: Parameters, z: Expr | None) -> tuple[Expr, Expr, Expr, Expr]:
    """Trial b, direction of flow 3/2 s / q, deviator of the Kirchhoff stress, and growth of alpha."""
    b, deviator = _trial(u, state, p)
    size = j2_plasticity.von_mises(deviator, p)
    growth = j2_plasticity.plastic_growth(size, state[6], p, z=z, kinematic=0.0)
    flow = 1.5 / size * deviator
    return b, flow, deviator - 2 * shear_modulus(p) * growth * flow, growth


def _pressure(u: Expr, state: Expr, p: Parameters, mean: Expr | None) -> Expr:
    """kappa ln theta / theta, Pa: the derivative of kappa/2 (ln theta)^2 by theta."""
    theta = state[7] + ufl.ln(ufl.det(_stretch(u)) if mean is None else mean)
    return bulk_modulus(p) * theta * ufl.exp(-theta)
