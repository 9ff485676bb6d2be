"""Simo's and Wong's symmetric top.

Inertia 5, 5, 1 kg m^2 about its tip, weight moment 20 N m, spin 50 rad/s, tilted by 0.05 rad and by 0.3 rad. It nods
between two tilts, which follow from elliptic integrals with period and precession.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Simo & Wong 1991, International Journal for Numerical Methods in Engineering 31", "10.1002/nme.1620310103"
)
# tilt at the start: lowest tilt (rad), period of nutation (s), precession in a period (rad)
NUTATION = {
    0.05: (0.054551690224342, 0.68545849728962, 0.28610768780066),
    0.3: (0.32673371464485, 0.68225601583118, 0.28410848611437),
}
REFERENCES = (
    *(
        reference
        for tilt, (lowest, period, turn) in NUTATION.items()
        for reference in (
            Reference(
                f"tilt {tilt:g} rad: lowest tilt, after {0.5 * period:.6g} s", "rad", (lowest,), 1e-8, Sureness.OWN
            ),
            Reference(f"tilt {tilt:g} rad: precession in a period", "rad", (turn,), 1e-7, Sureness.OWN),
        )
    ),
    Reference("tilt 0.05 rad: axis after 10 s", "", (-0.0471322314, 0.0267486864, 0.9985304505), 1e-9, Sureness.OWN),
)


def spin(tilt: float, t: float) -> np.ndarray:
    """(2, 3) The axis at the start and at the end."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    mass = 20.0 / 9.81
    top = scene.add(fm.RigidBody(mass, (5.0 - mass, 5.0 - mass, 1.0), (0.0, 0.0, 1.0)), name="top")
    point = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    point.position = (np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0)
    point.velocity = (0.0, 0.0, 50.0)
    run = scene.simulate(t, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    return np.asarray(run.position(top.frame(p=(0, 0, 1)))[[0, -1]])


def compute() -> Computed:
    """Half a period and a whole one of each tilt, and 10 s."""
    found = []
    for tilt, (_, period, _) in NUTATION.items():
        low = spin(tilt, 0.5 * period)[-1]
        found.append(numbers(np.arctan2(np.hypot(*low[:2]), low[2])))
        first, last = spin(tilt, period)
        found.append(numbers(np.arctan2(last[1], last[0]) - np.arctan2(first[1], first[0])))
    return Computed((*found, numbers(spin(0.05, 10.0)[-1])), accuracy="Dormand & Prince 8(5,3), rtol 1e-12")
