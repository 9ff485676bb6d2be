"""Babyboot, a chaotic double pendulum in space.

A rod swings about x; a plate turns about the rod's own axis. Errors grow by 1e7 within 10 s: seven digits of the
reference can be trusted there, and all at 2 s.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Mitiguy, MotionGenesis; Drake's test of it; at 2 s by the two equations of motion")
REFERENCES = (
    Reference("angles of rod and plate after 2 s", "deg", (56.426043845, 3.913478817), 1e-10, Sureness.OWN),
    Reference(
        "angles of rod and plate after 10 s", "deg", (-61.312983340691, -929.47789677244), 1e-7, Sureness.PRIMARY
    ),
    Reference("their rates", "rad/s", (-6.7440081040646, -2.7795690128833), 1e-6, Sureness.PRIMARY),
)


def compute() -> Computed:
    """A run to each instant."""
    found = {}
    for t in (2.0, 10.0):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        unit = 1e-7  # kg m^2 in a g cm^2
        rod = scene.add(fm.RigidBody(0.01, (50 * unit, 50 * unit, 0.0), (0.0, 0.0, -0.075)), name="rod")
        plate = scene.add(fm.RigidBody(0.1, (2500 * unit, 500 * unit, 2000 * unit)), name="plate")
        swing = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), rod.frame())
        turn = scene.connect(fm.joint.Revolute("z"), rod.frame(p=(0.0, 0.0, -0.2)), plate.frame())
        swing.position, turn.position = np.deg2rad(90.0), np.deg2rad(1.0)
        run = scene.simulate(t, rtol=3e-14, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        found[t] = [np.rad2deg([run.beta(one)[-1] for one in (swing, turn)])]
        found[t].append([run.beta_rate(one)[-1] for one in (swing, turn)])
    values = numbers(found[2.0][0]), numbers(found[10.0][0]), numbers(found[10.0][1])
    return Computed(values, accuracy="Dormand & Prince 8(5,3), rtol 3e-14")
