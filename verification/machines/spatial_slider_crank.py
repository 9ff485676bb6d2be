"""Slider-crank in space.

A crank of 0.08 m turns about x at 6 rad/s 0.1 m beside the slider's line and 0.12 m above it; the rod of 0.3 m hangs
on the crank by a universal joint and on the slider by a ball. Velocities at the start follow from the crank's; weight
works for 5 s without any loss of energy.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Haug 1989, Computer-Aided Kinematics and Dynamics of Mechanical Systems; IFToMM benchmark library; start by hand"
)
# kinetic energy of the start: crank, rod and slider by the velocities below
ROD_AXIS = np.array([2.0, -1.0, -2.0]) / 3.0
OMEGA, V_ROD = np.array([1.92, -0.96, 0.48]), np.array([0.12, -0.24, 0.0])
SPIN = float(OMEGA @ ROD_AXIS)
HEIGHT = 0.12 * 0.16 + 0.5 * 0.1
START = (
    0.5 * (1e-4 + 0.12 * 0.04**2) * 36.0
    + 0.25 * float(V_ROD @ V_ROD)
    + 0.5 * (4e-4 * SPIN**2 + 4e-3 * (float(OMEGA @ OMEGA) - SPIN**2))
    + 0.24**2
    + 9.81 * HEIGHT
)
REFERENCES = (
    Reference("velocity of the slider at the start", "m/s", (0.24,), 1e-12, Sureness.SECONDARY),
    Reference("velocity of the rod's centre", "m/s", (0.12, -0.24, 0.0), 1e-12, Sureness.SECONDARY),
    Reference("angular velocity of the rod", "rad/s", (1.92, -0.96, 0.48), 1e-12, Sureness.SECONDARY),
    Reference("energy after 5 s, that of the start", "J", (START,), 1e-8, Sureness.PRIMARY),
)


def compute() -> Computed:
    """One run."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    b, c = np.array([0.0, 0.1, 0.2]), np.array([0.2, 0.0, 0.0])
    crank = scene.add(fm.RigidBody(0.12, (1e-4, 1e-4, 1e-5), (0.0, 0.0, 0.04)), name="crank")
    along = (c - b) / 0.3
    inertia = 4e-3 * np.eye(3) - 3.6e-3 * np.outer(along, along)
    rod = scene.add(fm.RigidBody(0.5, inertia.tolist(), tuple(0.5 * (c - b))), name="rod")
    slider = scene.add(fm.RigidBody(2.0, (1e-4, 1e-4, 1e-4)), name="slider")
    turn = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(p=(0.0, 0.1, 0.12)), crank.frame())
    turn.velocity = 6.0
    across = np.cross([1.0, 0.0, 0.0], along)
    cross = fm.joint.Universal((1.0, 0.0, 0.0), tuple(across / np.linalg.norm(across)))
    scene.connect(cross, crank.frame(p=(0.0, 0.0, 0.08)), rod.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=tuple(c)), slider.frame())
    scene.connect(fm.joint.Spherical(), rod.frame(p=tuple(c - b)), slider.frame())
    run = scene.simulate(5.0, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    middle = rod.frame(p=tuple(0.5 * (c - b)))
    total = run.energy().total
    return Computed(
        (
            numbers(run.velocity(slider.frame())[0, 0]),
            numbers(run.velocity(middle)[0]),
            numbers(run.rotation(rod.frame())[0] @ run.angular_velocity(rod.frame())[0]),
            numbers(total[-1]),
        ),
        accuracy="Dormand & Prince 8(5,3), rtol 1e-11",
    )
