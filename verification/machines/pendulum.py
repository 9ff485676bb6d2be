"""Simple pendulum (IFToMM A01).

A point mass of 1 kg on 1 m, let go from the horizontal at x = -1 m, g = 9.81 m/s^2; and how long it takes to come
back, 4 sqrt(L / g) K(sin^2(pi / 4)), of the point and of a uniform bar.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ellipk

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems, A01")
PERIOD = 4.0 * np.sqrt(1.0 / 9.81) * float(ellipk(0.5))
REFERENCES = (
    Reference("x, y after 1 s", "m", (0.986291751132, -0.165010853126), 1e-11, Sureness.OWN),
    Reference("x, y after 5 s", "m", (-0.942305435044, -0.334754338414), 1e-11, Sureness.OWN),
    Reference("x, y after 10 s", "m", (-0.275087462576, -0.961419205099), 1e-11, Sureness.OWN),
    Reference("period of the point mass", "s", (PERIOD,), 1e-12, Sureness.PRIMARY),
    Reference("period of a uniform bar", "s", (PERIOD * np.sqrt(2.0 / 3.0),), 1e-12, Sureness.PRIMARY),
)
METHOD = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def swing(body: fm.RigidBody, t_end: float) -> tuple[fm.Trajectory, Connection, fm.Frame]:
    """Let it go."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(body, name="bob")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame())
    hinge.position = np.pi
    return scene.simulate(t_end, rtol=1e-13, integrator=METHOD), hinge, bob.frame(p=(1.0, 0.0, 0.0))


def period(body: fm.RigidBody, exact: float, *, pull: float) -> float:
    """When it is at rest again, s: by the rate that is left at the exact time, and the acceleration there (rad/s^2)."""
    run, hinge, _ = swing(body, exact)
    return float(exact - run.beta_rate(hinge)[-1] / pull)


def compute() -> Computed:
    """One run for the places, one for each period."""
    point = fm.RigidBody(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    places = []
    for t in (1.0, 5.0, 10.0):
        run, _, tip = swing(point, t)
        places.append(numbers(run.position(tip)[-1, :2]))
    pulls = 9.81, 1.5 * 9.81
    periods = [
        numbers(period(body, reference.published[0], pull=pull))
        for body, reference, pull in zip((point, rod(1, 1)), REFERENCES[3:], pulls, strict=True)
    ]
    return Computed((*places, *periods), accuracy="Dormand & Prince 8(5,3), rtol 1e-13")
