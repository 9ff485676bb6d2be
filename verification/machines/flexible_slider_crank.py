"""Slider-crank with a flexible connecting rod (Simeon).

The crank turns at 150 rad/s; the rod bends by two sines and stretches by one quadratic element, linearly, without
damping or gravity. Here the rod is a record made of these four shapes. The problem as it is distributed has 8 and 2
where the element's mass matrix has 8/15 and 2/15, and so has the record.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

import flexmbd as fm
from flexmbd.record.groups import InterfaceFrame
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Simeon 1996, Mathematical Modelling of Systems 2; Test Set for Initial Value Problem Solvers, problem Slider "
    "Crank, MEBDFI with a tolerance of 1e-14"
)
RIGID = (15.00000000000104, -0.3311734988256260, 0.1697373328427860)
ELASTIC = (1.893192899613509e-4, 2.375751249879174e-5, -5.323896770569702e-6, -8.363313279112129e-6)
RATES = (60.25346755138369, -8.753116326670527)
ELASTIC_RATES = (-0.03005541400289738, -5.500431812571696e-3, 4.974111734266989e-4, 1.105560003626645e-3)
FORCES = (-62.32935833287916, -163.7920993367306, 25.29857947066878)
REFERENCES = (
    Reference("phi1, phi2, x3 after 0.1 s", "rad, m", RIGID, 1e-8, Sureness.PRIMARY),
    Reference("rates of phi2, x3", "rad/s, m/s", RATES, 1e-7, Sureness.PRIMARY),
    Reference("elastic coordinates", "m", ELASTIC, 1e-6, Sureness.PRIMARY),
    Reference("their rates", "m/s", ELASTIC_RATES, 1e-5, Sureness.PRIMARY),
    Reference("multipliers", "N, N m", FORCES, 1e-5, Sureness.PRIMARY),
)
CRANK, ROD, SIDE, RHO, E, OMEGA = 0.15, 0.3, 0.008, 7870.0, 2e11, 150.0
MASS = RHO * SIDE**2 * ROD


def rod() -> tuple[fm.ReducedBody, np.ndarray]:
    """The record, its frame at the crank's pin, and the test set's coordinates by the modal ones."""
    s, weight = np.polynomial.legendre.leggauss(24)
    s, weight = 0.5 * (s + 1.0), 0.5 * weight * MASS
    nothing = np.zeros_like(s)
    # x and y of the two sines and of the element's middle and end
    shapes = [
        (nothing, np.sin(np.pi * s)), (nothing, np.sin(2.0 * np.pi * s)), (4.0 * s * (1.0 - s), nothing),
        (s * (2.0 * s - 1.0), nothing),
    ]  # fmt: skip
    fields = [np.ones_like(s), ROD * s, nothing, nothing, *(part for x, y in shapes for part in (x, y, nothing))]
    gram = np.einsum("ik,jk,k->ij", fields, fields, weight)
    gram[2, 2] = gram[3, 3] = MASS * SIDE**2 / 12.0
    along = np.ix_([10, 13], [10, 13])
    gram[along] = MASS * np.array([[8.0, 1.0], [1.0, 2.0]])
    stretch = E * SIDE**2 / ROD * np.array([[16.0, -8.0], [-8.0, 7.0]]) / 3.0
    bend = E * SIDE**2 / ROD * np.pi**4 * (SIDE / ROD) ** 2 * np.array([1.0 / 24.0, 2.0 / 3.0])
    stiffness = scipy.linalg.block_diag(np.diag(bend), stretch)
    q = np.arange(4)
    mass = sum(gram[np.ix_(4 + 3 * q + k, 4 + 3 * q + k)] for k in range(3))
    values, by_modes = scipy.linalg.eigh(stiffness, mass)
    whole = scipy.linalg.block_diag(np.eye(4), np.kron(by_modes, np.eye(3)))
    tip = np.zeros((6, 4))
    tip[0] = by_modes[3]
    ends = (
        InterfaceFrame("pin", np.zeros(3), np.eye(3), np.zeros((6, 4))),
        InterfaceFrame("tip", np.array([ROD, 0.0, 0.0]), np.eye(3), tip),
    )
    record = fm.ReducedBody(
        gram=whole.T @ gram @ whole, stiffness=values, damping=np.zeros((4, 4)), interfaces=ends, frame="pin",
        partition=by_modes, partition_names=("sine 1", "sine 2", "middle", "end"),
    )  # fmt: skip
    return record, by_modes


def compute() -> Computed:
    """One run from the distributed start."""
    record, by_modes = rod()
    scene = fm.System()
    inertia = 0.002727
    crank = scene.add(fm.RigidBody(0.36, (inertia, inertia, inertia)), name="crank")
    body = scene.add(fm.FlexibleBody(record), name="rod")
    slider = scene.add(fm.RigidBody(0.075552, (1e-5, 1e-5, 1e-5)), name="slider")
    hinge = fm.joint.Revolute("z")
    drive = scene.connect(hinge, scene.ground.frame(), crank.frame())
    drive.prescribe(lambda t: (OMEGA * t, OMEGA, 0.0))
    pin = scene.connect(hinge, crank.frame(p=(CRANK, 0.0, 0.0)), body.frame("pin"))
    end = scene.connect(hinge, body.frame("tip"), slider.frame())
    guide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame())
    body.q = np.linalg.solve(by_modes, [0.0, 0.0, 1.03339863e-5, 1.69327969e-5])
    body.q_rate = np.linalg.solve(by_modes, [0.444896105, 4.63434311e-3, -1.78591076e-6, -2.68938672e-6])
    pin.velocity, end.velocity = -74.9957670 - OMEGA, 74.9957670
    run = scene.simulate(0.1, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    phi1, phi2 = run.beta(drive)[-1], run.beta(drive)[-1] + run.beta(pin)[-1]
    rate = run.beta_rate(drive)[-1] + run.beta_rate(pin)[-1]
    # the guide holds the slider across; along it nothing but the rod's force moves it
    across, along = run.reaction(guide)[-1, 1], 0.075552 * run.acceleration(slider.frame())[-1, 0]
    return Computed(
        (
            numbers(phi1, phi2, run.position(slider.frame())[-1, 0]),
            numbers(rate, run.velocity(slider.frame())[-1, 0]),
            numbers(by_modes @ run.q(body)[-1]),
            numbers(by_modes @ run.q_rate(body)[-1]),
            numbers(-across, -along, -run.drive(drive)[-1]),
        ),
        mesh="four shapes", accuracy="Dormand & Prince 8(5,3), rtol 1e-12",
    )  # fmt: skip
