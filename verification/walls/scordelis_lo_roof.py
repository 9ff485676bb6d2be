"""Scordelis-Lo roof.

R = 25, L = 50, 40 degrees to either side, t = 0.25, E = 4.32e8, nu = 0, a weight of 90 per area, diaphragms at the
ends: deflection of the middle of the free edge. The deep shell's is 0.6 % lower. A quarter.
"""

from __future__ import annotations

import numpy as np

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import MACNEAL, FloatArray, Wall, radial

SOURCE = MACNEAL
REFERENCES = (Reference("deflection of the free edge", "", (0.3024,), 0.01, Sureness.SECONDARY),)


def sagged(n: int) -> float:
    """Deflection of the free edge, n x n cells."""
    radius, half, angle = 25.0, 25.0, np.radians(40.0)

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return radius * np.sin(angle * i), half * j, radius * np.cos(angle * i)

    roof = Wall((n, n), place, 0.25, E=4.32e8, nu=0.0, normals=radial)
    roof.hold(roof.on(1, 0.0), [0, 2])
    roof.hold(roof.on(1, half), [1])
    roof.hold(roof.on(0, 0.0), [0])
    edge = roof.near((radius * np.sin(angle), half, radius * np.cos(angle)), 0.25)
    return -float(roof.linear(roof.weight((0.0, 0.0, -90.0 / 0.25)))[edge, 2].mean())


def compute() -> Computed:
    """Linear."""
    return Computed((numbers(sagged(32)),), mesh="32 x 32 solid-shells, a quarter")
