"""J2 flow with two back stresses (Armstrong & Frederick 1966): thirteen unknowns at a point.

    X_k' = 2/3 C_k eps_p' - gamma_k X_k alpha',   |s - X_1 - X_2| sqrt(3/2) <= sigma_y

Pulled once a bar has the stress sigma_y + sum C_k / gamma_k (1 - exp(-gamma_k alpha)) at the plastic strain alpha.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms.j2_plasticity import REFERENCE as REFERENCE
from flexmbd.forms.j2_plasticity import bulk_modulus, components, rule, shear_modulus, tensor, von_mises
from flexmbd.forms.j2_plasticity import element as element
from flexmbd.forms.j2_plasticity import kinetic_energy as kinetic_energy
from flexmbd.forms.j2_plasticity import rigid_motion as rigid_motion

CELLS = ("hexahedron",)
ORDER = {1: 2}


@dataclass(frozen=True)
class Parameters:
    """Young's modulus, Pa; Poisson's ratio; kg/m^3; yield stress, Pa; moduli C_k, Pa; recovery gamma_k."""

    E: float
    nu: float
    rho: float
    yield_stress: float
    C: tuple[float, float] = (40e9, 5e9)
    gamma: tuple[float, float] = (400.0, 20.0)


@dataclass(frozen=True)
class Reference:
    """The elastic problem of a solid, below first yield."""

    parameters: Parameters

    def displacement(self, x):
        return self._elastic().displacement(x)

    def body_force(self, x):
        return self._elastic().body_force(x)

    @property
    def yielding(self):
        return (replace(self.parameters, yield_stress=2e8),)

    def _elastic(self):
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def state(p):
    return ufl.as_vector([0.0] * 18)


def local_unknowns(p):
    """Growth of alpha; those of the back stresses over 2 mu."""
    return ufl.as_vector([0.0] * 13)


def local_residual(z, u, state, p):
    mu, trial = shear_modulus(p), _trial(u, state, p)
    before = [_part(state, 6), _part(state, 12)]
    now = _back_stresses(z, state, p)
    flow, q = _flow(trial - now[0] - now[1], p)
    over = von_mises(trial - before[0] - before[1], p) - p.yield_stress
    consistency = ufl.conditional(ufl.gt(over, 0.0), (q - p.yield_stress) / (3 * mu) - z[0], z[0])
    lacks = [consistency]
    for k in range(2):
        growth = (2 / 3 * p.C[k] * flow - p.gamma[k] * now[k]) * z[0]
        lacks += components((now[k] - before[k] - growth) / (2 * mu))
    return ufl.as_vector(lacks)


def residual(u, v, state, p, *, z):
    return [(ufl.inner(stress(u, state, p, z=z), ufl.sym(ufl.grad(v))), rule(u))]


def stress(u, state, p, *, z):
    flow, _ = _at_end(u, state, p, z)
    deviator = _trial(u, state, p) - 2 * shear_modulus(p) * z[0] * flow
    return deviator + bulk_modulus(p) * ufl.div(u) * ufl.Identity(3)


def update(u, state, p, *, z):
    flow, _ = _at_end(u, state, p, z)
    parts = [tensor(state) + z[0] * flow, *_back_stresses(z, state, p)]
    return ufl.as_vector([component for part in parts for component in components(part)])


def scaled_yield(p, factor):
    return replace(p, yield_stress=factor * p.yield_stress)


def reference():
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=1e12))


def _trial(u, state, p):
    return 2 * shear_modulus(p) * (ufl.dev(ufl.sym(ufl.grad(u))) - tensor(state))


def _at_end(u, state, p, z):
    return _flow(_trial(u, state, p) - sum(_back_stresses(z, state, p)), p)


def _back_stresses(z, state, p):
    mu = shear_modulus(p)
    return [_part(state, 6 * k) + 2 * mu * _part(z, 6 * k - 5) for k in (1, 2)]


def _flow(shifted, p):
    q = von_mises(shifted, p)
    return 1.5 / q * shifted, q


def _part(values, first):
    return tensor([values[first + i] for i in range(6)])
