"""Pinched cylinder with diaphragms.

R = 300, L = 600, t = 3, E = 3e6, nu = 0.3: opposite forces of 1 in the middle; displacement under a force. An octant.
"""

from __future__ import annotations

import numpy as np

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import MACNEAL, FloatArray, Wall, radial

SOURCE = MACNEAL
REFERENCES = (
    Reference("displacement under a force", "1e-5", (1.8248,), 0.013, Sureness.SECONDARY),
)


def pinched(n: int) -> float:
    """Displacement under a force, n x n cells."""
    radius, half = 300.0, 300.0

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return radius * np.sin(0.5 * np.pi * i), half * j, radius * np.cos(0.5 * np.pi * i)

    tube = Wall((n, n), place, 3.0, E=3e6, nu=0.3, normals=radial)
    tube.hold(tube.on(1, 0.0), [0, 2])
    tube.hold(tube.on(1, half), [1])
    for axis in (0, 2):
        tube.hold(tube.on(axis, 0.0), [axis])
    loaded = tube.near((0.0, half, radius), 3.0)
    return -float(tube.linear(tube.forces((loaded, (0.0, 0.0, -0.25))))[loaded, 2].mean())


def compute() -> Computed:
    """Linear."""
    return Computed((numbers(1e5 * pinched(32)),), mesh="32 x 32 solid-shells, an octant")
