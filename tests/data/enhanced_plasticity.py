"""The brick of enhanced strains (`solid_enhanced`) with the law of `j2_plasticity`, small strain."""

from dataclasses import dataclass

import ufl

from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import solid_enhanced

CELLS = solid_enhanced.CELLS
ORDER = solid_enhanced.ORDER
REFERENCE = "INITIAL"

Quadrature = solid_enhanced.Quadrature
element = solid_enhanced.element
rigid_motion = solid_enhanced.rigid_motion
state = j2.state
state_names = j2.state_names
scaled_yield = j2.scaled_yield
local_unknowns = j2.local_unknowns
reference = j2.reference


@dataclass(frozen=True)
class Parameters(j2.Parameters):
    pass


def reference():
    r = j2.reference()
    return j2.Reference(_own(r.parameters))


def _own(p):
    return Parameters(E=p.E, nu=p.nu, rho=p.rho, yield_stress=p.yield_stress, hardening=p.hardening)


def _strain(u):
    d, alpha = ufl.split(u)
    return ufl.sym(ufl.grad(d)) + solid_enhanced.enhanced_strain(alpha, solid_enhanced.cell_frame(u))


def _trial(e, state, p):
    return 2 * j2.shear_modulus(p) * (ufl.dev(e) - j2.tensor(state))


def _return(u, state, p, z):
    e = _strain(u)
    shifted = _trial(e, state, p)
    trial = j2.von_mises(shifted, p)
    growth = j2.plastic_growth(trial, state[6], p, z=z, kinematic=0.0)
    flow = 1.5 / trial * shifted
    return e, shifted - 2 * j2.shear_modulus(p) * growth * flow, flow, growth


def local_residual(z, u, state, p):
    return j2.consistency(z, j2.von_mises(_trial(_strain(u), state, p), p), state[6], p, kinematic=0.0)


def residual(u, v, state, p, z=None):
    return [(ufl.inner(stress(u, state, p, z), _strain(v)), Quadrature(3))]


def update(u, state, p, z=None):
    _, _, flow, growth = _return(u, state, p, z)
    return ufl.as_vector([*j2.components(j2.tensor(state) + growth * flow), state[6] + growth])


def stress(u, state, p, z=None):
    e, deviator, _, _ = _return(u, state, p, z)
    return deviator + j2.bulk_modulus(p) * ufl.tr(e) * ufl.Identity(3)


def energies(u, state, p):
    e = _strain(u)
    strain = ufl.dev(e) - j2.tensor(state)
    elastic = j2.shear_modulus(p) * ufl.inner(strain, strain) + j2.bulk_modulus(p) / 2 * ufl.tr(e) ** 2
    done = p.yield_stress * state[6] + p.hardening.work(state[6])
    return {"elastic": (elastic, Quadrature(3)), "plastic": (done, Quadrature(3))}


kinetic_energy = solid_enhanced.kinetic_energy
