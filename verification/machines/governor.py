"""Stiff flyball governor (after IFToMM A05).

Balls of 5 kg on rods of 1 m at a shaft that turns freely, springs of 8e5 N/m with dampers of 4e4 N s/m from the rods'
middles to a slider. The library gives a curve; the numbers are of Lagrange's equations by an implicit method.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems, A05; numbers by "
    "Lagrange's equations, SciPy's Radau method at 1e-11"
)
REFERENCES = (
    Reference("way of the slider after 10 s", "m", (0.8259620542948524,), 1e-7, Sureness.OWN),
    Reference("speed of the shaft after 10 s", "rad/s", (4.944056049822106,), 1e-6, Sureness.OWN),
)


def compute() -> Computed:
    """One run."""
    tilt = np.pi / 6.0
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    shaft = scene.add(fm.RigidBody(0.3, (0.1, 0.1, 5e-6), (0.0, 0.0, -0.5)), name="shaft")
    turning = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(0.0, 0.0, 1.0)), shaft.frame())
    turning.velocity = 2.0 * np.pi
    cube = 3.0 * 0.1**2 / 6.0
    slider = scene.add(fm.RigidBody(3.0, (cube, cube, cube)), name="slider")
    slide = scene.connect(fm.joint.Prismatic((0, 0, -1)), shaft.frame(), slider.frame())
    slide.position = np.cos(tilt)
    mass = 0.3 + 5.0
    com = (0.5 * 0.3 + 5.0) / mass
    across = 0.3 / 12.0 + 0.3 * (com - 0.5) ** 2 + 5.0 * (1.0 - com) ** 2
    for side in (1.0, -1.0):
        arm = scene.add(fm.RigidBody(mass, (across, across, 5e-6), (0.0, 0.0, -com)), name=f"arm {side:+.0f}")
        scene.connect(fm.joint.Revolute((0, -side, 0)), shaft.frame(), arm.frame()).position = tilt
        scene.add_force(fm.force.SpringDamper(arm.frame(p=(0.0, 0.0, -0.5)), slider.frame(), 8e5, 0.5, 4e4))
    run = scene.simulate(10.0, rtol=1e-9, integrator=fm.RadauIIA())
    return Computed(
        (numbers(run.beta(slide)[-1]), numbers(run.angular_velocity(shaft.frame())[-1, 2])),
        accuracy="Radau IIA, rtol 1e-9",
    )
