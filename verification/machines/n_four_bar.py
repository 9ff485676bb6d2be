"""Rows of four-bars (IFToMM A02).

2 N + 1 rods of 1 m and 1 kg make N windows in a row, hinged to the ground by three-dimensional revolute joints, most
of whose constraints are redundant. Upright, their first free corner moves at 1 m/s; twice a turn they all lie flat,
where the constraints lose rank.
"""

from __future__ import annotations

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems, A02; "
    "numbers by its equation of one degree of freedom"
)
PLACES = {
    2: {1.0: (-0.195020301950, -0.980799205662), 10.0: (0.328458111536, 0.944518538180)},
    40: {1.0: (-0.115356880632, -0.993324111300), 10.0: (0.180512226684, 0.983572740583)},
}
REFERENCES = tuple(
    Reference(f"N = {n}, x, y of the first corner after {t:g} s", "m", place, 1e-7, Sureness.OWN)
    for n, row in PLACES.items()
    for t, place in row.items()
)


def four_bars(windows: int) -> tuple[fm.System, fm.Frame, list[Connection]]:
    """The machine, its first corner, and the hinges of its feet."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    hinge = fm.joint.Revolute("z")
    upright, feet = [], []
    for i in range(windows + 1):
        upright.append(scene.add(rod(1.0, 1.0, along=1), name=f"upright {i}"))
        feet.append(scene.connect(hinge, scene.ground.frame(p=(i, 0, 0)), upright[i].frame()))
    for i in range(windows):
        beam = scene.add(rod(1.0, 1.0), name=f"beam {i}")
        scene.connect(hinge, upright[i].frame(p=(0, 1, 0)), beam.frame()).velocity = 1.0
        scene.connect(hinge, beam.frame(p=(1, 0, 0)), upright[i + 1].frame(p=(0, 1, 0)))
    for foot in feet:
        foot.velocity = -1.0
    return scene, upright[0].frame(p=(0, 1, 0)), feet


def compute() -> Computed:
    """A run to each instant."""
    found = []
    for windows, row in PLACES.items():
        for t in row:
            scene, corner, _ = four_bars(windows)
            run = scene.simulate(t, rtol=1e-10, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
            found.append(numbers(run.position(corner)[-1, :2]))
    return Computed(tuple(found), accuracy="Dormand & Prince 8(5,3), rtol 1e-10")
