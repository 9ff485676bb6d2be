"""Heavy top on a fixed point.

15 kg, 1 m from the point, a spin of 150 rad/s about its axis at 4.61538 rad/s of precession: its axis nearly keeps
level.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Bruels, Cardona & Arnold 2012, Mechanism and Machine Theory 48")
PLACES = {
    0.2: (0.605550561377, 0.598957681795, -0.523983027430),
    1.0: (0.173343964098, 0.640088592070, -0.748490791134),
    2.0: (-0.150416822746, -0.724165591637, -0.673022269560),
}
REFERENCES = (
    *(Reference(f"place of the centre after {t:g} s", "m", place, 1e-9, Sureness.OWN) for t, place in PLACES.items()),
    Reference(
        "rotation after 2 s, a quaternion", "", (0.122947135042, -0.491079892550, 0.350430030344, -0.787986887550),
        1e-8, Sureness.OWN,
    ),
    Reference("energy, kept for 2 s", "J", (5435.6967908655,), 1e-11, Sureness.PRIMARY),
)  # fmt: skip


def compute() -> Computed:
    """A run to each instant."""
    found = []
    for t in PLACES:
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        top = scene.add(fm.RigidBody(15.0, (0.234375, 0.46875, 0.234375), (0.0, 1.0, 0.0)), name="top")
        point = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
        point.velocity = (0.0, 150.0, -4.61538)
        run = scene.simulate(t, rtol=1e-13, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        found.append(numbers(run.position(top.frame(p=(0, 1, 0)))[-1]))
    turned = run.beta(point)[-1]
    found.append(numbers(np.copysign(1.0, turned[0]) * turned))
    found.append(numbers(run.energy().total[-1]))
    return Computed(tuple(found), accuracy="Dormand & Prince 8(5,3), rtol 1e-13")
