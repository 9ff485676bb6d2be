"""Double pendulums of very unlike masses.

Point masses on massless rods of 1 m, 1 kg above a million kilograms and the other way round, let go from the
horizontal: places of the lower one by Lagrange's equations, written so that nothing cancels.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Lagrange's equations of the textbook, by DOP853 at two tolerances")
PLACES: dict[tuple[float, float], dict[float, tuple[float, float]]] = {
    (1.0, 1e6): {1.0: (-0.9574258236506, -1.7559429881659), 3.0: (1.9123136950349, -0.5857100698699)},
    (1e6, 1.0): {1.0: (-1.7654513544204, 0.4618097998584), 3.0: (-0.583613020456, -1.8977194232056)},
}
REFERENCES = tuple(
    Reference(f"{upper:g} kg above {lower:g} kg, x, z of the lower one after {t:g} s", "m", place, 1e-8, Sureness.OWN)
    for (upper, lower), row in PLACES.items()
    for t, place in row.items()
)


def compute() -> Computed:
    """A run of each."""
    found = []
    for (upper, lower), row in PLACES.items():
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        bodies = [
            scene.add(fm.RigidBody(mass, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)), name=name)
            for mass, name in ((upper, "upper"), (lower, "lower"))
        ]
        first = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bodies[0].frame())
        scene.connect(fm.joint.Revolute("y"), bodies[0].frame(p=(0.0, 0.0, -1.0)), bodies[1].frame())
        first.position = -0.5 * np.pi
        run = scene.simulate(max(row), rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        for t in row:
            found.append(numbers(run.position(bodies[1].frame(p=(0.0, 0.0, -1.0)), t=np.array([t]))[0, [0, 2]]))
    return Computed(tuple(found), accuracy="Dormand & Prince 8(5,3), rtol 1e-12")
