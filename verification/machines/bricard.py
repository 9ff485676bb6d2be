"""Bricard's mechanism (IFToMM A04).

Five rods of 1 m and 1 kg with a square section of 0.1 m, and six hinges along y, z, x, y, z, x: by Gruebler's count
it cannot move, yet it has one degree of freedom, for one of its constraints is redundant in all positions. It falls
from rest.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems, A04; numbers by "
    "the exact equation of its symmetric motion"
)
PLACES = {
    0.5: (0.968283679107, -1.224625159436, 0.750146609438),
    1.0: (0.510501461187, -1.649167599395, 0.140123114553),
    5.0: (0.999999997738, -1.000067257698, 0.999932740040),
    10.0: (0.999999963806, -1.000269012696, 0.999730951120),
}
REFERENCES = tuple(
    Reference(f"x, y, z of P3 after {t:g} s", "m", place, 1e-9, Sureness.OWN) for t, place in PLACES.items()
)
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], dtype=float)


def mechanism() -> tuple[fm.System, fm.Frame]:
    """The machine, and P3 on the third rod."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    before, p3 = scene.ground.frame(), scene.ground.frame()
    for k, axis in enumerate("yzxyz"):
        way = CORNERS[k + 1] - CORNERS[k]
        inertia = np.where(way != 0.0, 0.02 / 12.0, 1.01 / 12.0)
        rod = scene.add(fm.RigidBody(1.0, tuple(inertia), tuple(0.5 * way)), name=f"rod {k + 1}")
        scene.connect(fm.joint.Revolute(axis), before, rod.frame())
        before = rod.frame(p=tuple(way))
        if k == 2:
            p3 = before
    scene.connect(fm.joint.Revolute("x"), before, scene.ground.frame(p=tuple(CORNERS[5])))
    return scene, p3


def compute() -> Computed:
    """A run to each instant."""
    found = []
    for t in PLACES:
        scene, p3 = mechanism()
        run = scene.simulate(t, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        found.append(numbers(run.position(p3)[-1]))
    return Computed(tuple(found), accuracy="Dormand & Prince 8(5,3), rtol 1e-12")
