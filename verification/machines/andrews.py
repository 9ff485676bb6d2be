"""Andrews' squeezing mechanism (IFToMM A03).

Seven planar bodies, a spring and a motor; three loops close in one point. Here each body hangs on a hinge of its own,
and each loop is a pin between two of them, whose force is the published multiplier.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Mazzia & Magherini 2008, Test Set for Initial Value Problem Solvers, problem Andrews; PSIDE with a tolerance of "
    "1e-14"
)
ANGLES = (
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948, 0.5244099658805304,
    0.5347301163226948, 1.048080741042263,
)  # fmt: skip
RATES = (
    1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385, 0.5735699284790808,
    -19.29337464421385, 0.3231791658026955,
)  # fmt: skip
FORCES = (
    199.1753333731910, -29.75531228015052, 23.06654119098399, 31.45271365475927, 22.64249232082739, 11.61740700019673,
)  # fmt: skip
REFERENCES = (
    Reference("beta, Theta, gamma, Phi, delta, Omega, epsilon after 0.03 s", "rad", ANGLES, 1e-8, Sureness.PRIMARY),
    Reference("their rates", "rad/s", RATES, 1e-8, Sureness.PRIMARY),
    Reference("multipliers 1 to 6", "N", FORCES, 1e-5, Sureness.PRIMARY),
)
A, B, C = (-0.06934, -0.00227, 0.0), (-0.03635, 0.03273, 0.0), (0.014, 0.072, 0.0)
START = (
    -0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885, 0.487364979543842550,
    -0.222668390165885885, 1.23054744454982119,
)  # fmt: skip


def mechanism() -> tuple[fm.System, list[Connection], list[Connection], list[fm.Frame]]:
    """The machine, its hinges in the order of the angles, its pins, and a frame of each pin's second body."""
    scene = fm.System()
    hinge, pin = fm.joint.Revolute("z"), fm.joint.PointOnLine("z")

    def body(name: str, mass: float, inertia: float, x: float, y: float) -> fm.RigidBody:
        return scene.add(fm.RigidBody(mass, (inertia, inertia, inertia), (x, y, 0.0)), name=name)

    ground = scene.ground.frame
    k1 = body("K1", 0.04325, 2.194e-6, 0.00092, 0.0)
    k2 = body("K2", 0.00365, 4.410e-7, -0.0115, 0.0)
    k3 = body("K3", 0.02373, 5.255e-6, 0.01874, -0.01043)
    k4 = body("K4", 0.00706, 5.667e-7, 0.0, 0.01421 - 0.02)
    k5 = body("K5", 0.0705, 1.169e-5, 0.02308, 0.00916)
    k6 = body("K6", 0.00706, 5.667e-7, 0.02 - 0.01421, 0.0)
    k7 = body("K7", 0.05498, 1.912e-5, 0.00449, -0.01228)
    beta = scene.connect(hinge, ground(), k1.frame())
    theta = scene.connect(hinge, k1.frame(p=(0.007, 0.0, 0.0)), k2.frame())
    gamma = scene.connect(hinge, ground(p=B), k3.frame())
    delta = scene.connect(hinge, ground(p=A), k5.frame())
    phi = scene.connect(hinge, k5.frame(p=(0.04, 0.0, 0.0)), k4.frame())
    epsilon = scene.connect(hinge, ground(p=A), k7.frame())
    omega = scene.connect(hinge, k7.frame(p=(0.0, -0.04, 0.0)), k6.frame())
    point = k2.frame(p=(-0.028, 0.0, 0.0))
    ends = [k3.frame(p=(0.0, -0.035, 0.0)), k4.frame(p=(0.0, -0.02, 0.0)), k6.frame(p=(0.02, 0.0, 0.0))]
    pins = [scene.connect(pin, point, end, name=f"pin {k}") for k, end in enumerate(ends, 1)]
    angles = [beta, theta, gamma, phi, delta, omega, epsilon]
    for joint, value in zip(angles, START, strict=True):
        joint.position = value
    scene.add_force(fm.force.JointTorque(beta, 0.033))
    scene.add_force(fm.force.SpringDamper(ground(p=C), k3.frame(p=(0.02, -0.018, 0.0)), 4530.0, 0.07785))
    return scene, angles, pins, ends


def compute() -> Computed:
    """One run; the forces of the pins in the axes of the ground."""
    scene, angles, pins, ends = mechanism()
    run = scene.simulate(0.03, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    forces = [(run.rotation(end)[-1] @ run.reaction(pin)[-1, :3])[:2] for pin, end in zip(pins, ends, strict=True)]
    return Computed(
        (
            numbers(*(run.beta(joint)[-1] for joint in angles)),
            numbers(*(run.beta_rate(joint)[-1] for joint in angles)),
            numbers(np.ravel(forces)),
        ),
        accuracy="Dormand & Prince 8(5,3), rtol 1e-12",
    )
