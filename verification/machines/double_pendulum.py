"""Double pendulums.

Two uniform rods of 1 m and 1 kg let go from the horizontal, and with the second one hanging.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Lagrange's equations of the textbook, at two tolerances")
PLACES = {
    ("both horizontal", 1.0): (-1.6621151358, -1.0414666372),
    ("both horizontal", 3.0): (1.3304368251, -1.3986448605),
    ("both horizontal", 5.0): (1.8552219378, -0.7395679325),
    ("second hanging", 1.0): (-1.4419899284, -0.5402322145),
    ("second hanging", 3.0): (-0.7953051438, 0.2018162218),
    ("second hanging", 5.0): (-1.0991590247, -1.3491665132),
}
REFERENCES = tuple(
    Reference(f"{start}, x, z of the tip after {t:g} s", "m", place, 2e-9, Sureness.OWN)
    for (start, t), place in PLACES.items()
)


def compute() -> Computed:
    """A run to each instant."""
    found = []
    for start, t in PLACES:
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        first, second = (scene.add(rod(1.0, 1.0, along=2), name=name) for name in ("first", "second"))
        hinge = fm.joint.Revolute("y")
        scene.connect(hinge, scene.ground.frame(), first.frame()).position = 0.5 * np.pi
        elbow = scene.connect(hinge, first.frame(p=(0, 0, 1)), second.frame())
        elbow.position = 0.0 if start == "both horizontal" else 0.5 * np.pi
        run = scene.simulate(t, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        found.append(numbers(run.position(second.frame(p=(0, 0, 1)))[-1, [0, 2]]))
    return Computed(tuple(found), accuracy="Dormand & Prince 8(5,3), rtol 1e-12")
