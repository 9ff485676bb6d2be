"""Pinched cylinder with diaphragms that yields.

R = 300, L = 600, t = 3, E = 3000, nu = 0.3, a yield stress of 24.3 that hardens by 300: both places of the forces are
pushed in together, to a quarter of the radius. Folds run outwards from there as hinges of the width of a cell, so that
the force waves, and is 4 % larger at 75 on 16 x 16 cells; which folds come first hangs on the steps as well, and with
twice as many of them it is 2.7 % larger there. Wagner, Klinkel & Gruttmann show the curve. The numbers are those of
CalculiX's 24 x 24 x 2 quadratic bricks (C3D20R) of the same law, 2 % above those of 16 x 16 x 2. An octant.
"""

from __future__ import annotations

import numpy as np

from verification.reference import Computed, Reference, Source, Sureness, numbers
from verification.walls._wall import FloatArray
from verification.walls.pinched_cylinder import octant

SOURCE = Source(
    "Wagner, Klinkel & Gruttmann 2002, Computers & Structures 80:857; numbers by CalculiX 2.20",
)
TABLE = {25.0: 467.4, 50.0: 842.2, 75.0: 1412.0}
REFERENCES = (
    Reference("force at 25, 50 and 75", "", tuple(TABLE.values()), 0.049, Sureness.OWN),
)  # fmt: skip


def pushed_in(n: int, ways: FloatArray) -> FloatArray:
    """(ways,) forces on the whole cylinder, n x n cells."""
    tube, loaded = octant(n, E=3000.0, yield_stress=24.3, hardening=300.0)
    return -4.0 * tube.pushed(loaded, 2, list(-ways))


def compute() -> Computed:
    """By follow, in steps of 5."""
    ways = np.arange(5.0, 76.0, 5.0)
    found = dict(zip(ways.tolist(), pushed_in(32, ways).tolist(), strict=True))
    return Computed((numbers([found[way] for way in TABLE]),), mesh="32 x 32 solid-shells of 5 points, an octant",
                    accuracy="steps of 5")  # fmt: skip
