"""Perzyna's viscoplastic metal at large strain: overstress = viscosity times the rate of plastic strain."""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms import solid_linear, updated_lagrangian
from flexmbd.forms.j2_plasticity import bulk_modulus, components, rule, shear_modulus, tensor, von_mises
from flexmbd.forms.updated_lagrangian import CELLS as CELLS
from flexmbd.forms.updated_lagrangian import ORDER as ORDER
from flexmbd.forms.updated_lagrangian import REFERENCE as REFERENCE
from flexmbd.forms.updated_lagrangian import element as element
from flexmbd.forms.updated_lagrangian import kinetic_energy as kinetic_energy
from flexmbd.forms.updated_lagrangian import rigid_motion as rigid_motion


@dataclass(frozen=True)
class Parameters:
    """Young's modulus, Pa; Poisson's ratio; density, kg/m^3; yield stress, Pa; viscosity, Pa s."""

    E: float
    nu: float
    rho: float
    yield_stress: float
    viscosity: float


@dataclass(frozen=True)
class Reference:
    """The elastic problem of a solid, below first yield; and what yields in steps of dt seconds."""

    parameters: Parameters
    yielding: tuple[Parameters, ...] = (Parameters(2.1e11, 0.3, 7850.0, 2e8, 1e6),)
    dt: float = 1e-3

    def displacement(self, x):
        return self._elastic().displacement(x)

    def body_force(self, x):
        return self._elastic().body_force(x)

    def _elastic(self):
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def state(p):
    return ufl.as_vector([0.0] * 7)


def cell_mean(u, state, p):
    return ufl.det(_stretch(u))


def residual(u, v, state, p, *, dt, mean=None):
    f = _stretch(u)
    nominal = ufl.det(f) * _returned(u, state, p, dt, mean)[0] * ufl.inv(f).T
    return [(ufl.inner(nominal, ufl.grad(v)), rule(u))]


def update(u, state, p, *, dt, mean=None):
    cauchy, growth = _returned(u, state, p, dt, mean)
    return ufl.as_vector([*components(cauchy), state[6] + growth])


def stress(u, state, p, *, dt, mean=None):
    return _returned(u, state, p, dt, mean)[0]


def energies(u, state, p, *, mean=None):
    cauchy, k = tensor(state), ufl.tr(tensor(state)) / 3
    elastic = ufl.inner(ufl.dev(cauchy), ufl.dev(cauchy)) / (4 * shear_modulus(p)) + k**2 / (2 * bulk_modulus(p))
    return {"elastic": (elastic, rule(u)), "plastic": (p.yield_stress * state[6], rule(u))}


def scaled_yield(p, factor):
    return Parameters(p.E, p.nu, p.rho, factor * p.yield_stress, p.viscosity)


def reference():
    return Reference(Parameters(2.1e11, 0.3, 7850.0, 1e12, 1e6))


def _stretch(u):
    return ufl.Identity(3) + ufl.grad(u)


def _returned(u, state, p, dt, mean):
    """Cauchy stress, Pa, and growth of the accumulated plastic strain."""
    f = _stretch(u)
    strain = updated_lagrangian.linear_strain(u) + updated_lagrangian.nonlinear_strain(u)
    if mean is not None:
        factor = (mean / ufl.det(f)) ** (1 / 3)
        f, strain = factor * f, factor**2 * strain + (factor**2 - 1) / 2 * ufl.Identity(3)
    stress = tensor(state) + updated_lagrangian.elasticity(strain, p)
    trial = f * stress * f.T / ufl.sqrt(ufl.det(f)) ** 2
    q = von_mises(ufl.dev(trial), p)
    over = ufl.max_value(q - p.yield_stress, 0.0)
    growth = over * dt / (3 * shear_modulus(p) * dt + p.viscosity)
    return trial - 3 * shear_modulus(p) * growth / q * ufl.dev(trial), growth
