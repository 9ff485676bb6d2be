"""A metal that yields at a stress which grows with the rate: J2 flow by Perzyna's overstress, at small strain.

    alpha' = <q - sigma_y - H alpha> / eta,   eps_p' = 3/2 alpha' s / q,   q = sqrt(3/2) |s|

with the stress deviator s and the accumulated plastic strain alpha.  Pulled at the rate e a bar without hardening
comes to the overstress eta e: sigma = sigma_y + eta e (1 - exp(-E t / eta)), t from first yield on.  A step of the
length dt is integrated by the implicit Euler method, along the radius and closed; dt = 0 leaves no time to flow.
History: eps_p (6), alpha, and the work that the flow has taken.

References: Perzyna 1966, doi:10.1016/S0065-2156(08)70009-7; Simo & Hughes 1998, section 2.7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import ufl

from flexmbd.forms import solid_linear
from flexmbd.forms.j2_plasticity import CELLS as CELLS
from flexmbd.forms.j2_plasticity import ORDER as ORDER
from flexmbd.forms.j2_plasticity import REFERENCE as REFERENCE
from flexmbd.forms.j2_plasticity import bulk_modulus, components, rule, shear_modulus, tensor, von_mises
from flexmbd.forms.j2_plasticity import element as element
from flexmbd.forms.j2_plasticity import kinetic_energy as kinetic_energy
from flexmbd.forms.j2_plasticity import rigid_motion as rigid_motion


@dataclass(frozen=True)
class Parameters:
    """Young's modulus, Pa; Poisson's ratio; density, kg/m^3; yield stress, Pa; hardening, Pa; viscosity, Pa s."""

    E: float
    nu: float
    rho: float
    yield_stress: float
    hardening: float
    viscosity: float

    def __post_init__(self):
        solid_linear.Parameters(self.E, self.nu, self.rho)
        for name, least in (("yield_stress", 1e-300), ("hardening", 0.0), ("viscosity", 0.0)):
            if not least <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)}")


@dataclass(frozen=True)
class Reference:
    """The elastic problem of a solid, below first yield; and what yields in steps of dt seconds."""

    parameters: Parameters
    dt: float = 1e-3

    def displacement(self, x):
        """In m."""
        return self._elastic().displacement(x)

    def body_force(self, x):
        """In N/m^3."""
        return self._elastic().body_force(x)

    @property
    def yielding(self):
        """A material that yields at a strain of a thousandth."""
        return (replace(self.parameters, yield_stress=2e8, viscosity=1e6),)

    def _elastic(self):
        p = self.parameters
        return solid_linear.Reference(solid_linear.Parameters(p.E, p.nu, p.rho))


def state(p):
    return ufl.as_vector([0.0] * 8)


def cell_mean(u, state, p):
    return ufl.div(u)


def residual(u, v, state, p, *, dt, mean=None):
    deviator, _, _ = _return(u, state, p, dt)
    pressure = bulk_modulus(p) * (ufl.div(u) if mean is None else mean)
    return [(ufl.inner(deviator, ufl.sym(ufl.grad(v))) + pressure * ufl.div(v), rule(u))]


def update(u, state, p, *, dt, mean=None):
    deviator, flow, growth = _return(u, state, p, dt)
    done = growth * ufl.inner(deviator, flow)
    return ufl.as_vector([*components(tensor(state) + growth * flow), state[6] + growth, state[7] + done])


def stress(u, state, p, *, dt, mean=None):
    deviator, _, _ = _return(u, state, p, dt)
    return deviator + bulk_modulus(p) * (ufl.div(u) if mean is None else mean) * ufl.Identity(3)


def energies(u, state, p, *, mean=None):
    strain = _elastic_deviator(u, state)
    volume = ufl.div(u) if mean is None else mean
    elastic = shear_modulus(p) * ufl.inner(strain, strain) + bulk_modulus(p) / 2 * volume**2
    return {"elastic": (elastic, rule(u)), "plastic": (ufl.as_ufl(1.0) * state[7], rule(u))}


def scaled_yield(p, factor):
    return replace(p, yield_stress=factor * p.yield_stress)


def reference():
    return Reference(Parameters(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=1e12, hardening=1e9, viscosity=1e6))


def _elastic_deviator(u, state):
    return ufl.dev(ufl.sym(ufl.grad(u))) - tensor(state)


def _return(u, state, p, dt):
    """Deviator of the stress, Pa, and of the flow, and the growth of alpha, at the step's end."""
    mu = shear_modulus(p)
    trial = 2 * mu * _elastic_deviator(u, state)
    q = von_mises(trial, p)
    over = ufl.max_value(q - p.yield_stress - p.hardening * state[6], 0.0)
    growth = over * dt / ((3 * mu + p.hardening) * dt + p.viscosity)
    flow = 1.5 / q * trial
    return trial - 2 * mu * growth * flow, flow, growth
