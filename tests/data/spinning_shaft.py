"""A Timoshenko beam whose sections spin about its axis, with the angular momentum rho (Iy + Iz) spin per length."""

from __future__ import annotations

from dataclasses import dataclass

import ufl

from flexmbd.forms import beam_timoshenko as beam

CELLS = beam.CELLS
ORDER = beam.ORDER
REFERENCE = beam.REFERENCE


@dataclass(frozen=True)
class Parameters:
    """The beam's parameters, and the speed of its sections about their axis against the body's frame, rad/s."""

    beam: beam.Parameters
    spin: float


@dataclass(frozen=True)
class Reference:
    """That of the beam."""

    parameters: Parameters

    def displacement(self, x):
        return beam.reference().displacement(x)

    def body_force(self, x):
        return beam.reference().body_force(x)


element = beam.element
rigid_motion = beam.rigid_motion


def strain_energy(u, p):
    return beam.strain_energy(u, p.beam)


def kinetic_energy(v, p):
    return beam.kinetic_energy(v, p.beam)


def gyroscopic(u, v, p):
    (_, rule), _ = beam.kinetic_energy(u, p.beam)
    momentum = p.beam.rho * (p.beam.Iy + p.beam.Iz) * p.spin
    return [(momentum / 2 * ufl.dot(_tangent(u), ufl.cross(_turn(v), _turn(u))), rule)]


def motion(u, xi, p):
    return beam.motion(u, xi, p.beam)


def section_inertia(p):
    return beam.section_inertia(p.beam)


def stress(u, state, p):
    return beam.stress(u, state, p.beam)


def reference():
    return Reference(Parameters(beam.reference().parameters, 300.0))


def _turn(u):
    return ufl.as_vector([u[i] for i in range(3, 6)])


def _tangent(u):
    jacobian = ufl.Jacobian(ufl.domain.extract_unique_domain(u))
    t = ufl.as_vector([jacobian[i, 0] for i in range(3)])
    return t / ufl.sqrt(ufl.dot(t, t))
