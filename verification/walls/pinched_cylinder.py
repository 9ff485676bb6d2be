"""Pinched cylinder with diaphragms.

R = 300, L = 600, t = 3, E = 3e6, nu = 0.3: opposite forces of 1 in the middle; displacement under a force. An octant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import MACNEAL, FloatArray, Wall, radial

SOURCE = MACNEAL
Nodes = NDArray[np.intp]
REFERENCES = (
    Reference("displacement under a force", "1e-5", (1.8248,), 0.013, Sureness.SECONDARY),
)


def octant(n: int, *, E: float, yield_stress: float | None = None, hardening: float = 0.0) -> tuple[Wall, Nodes]:
    """Of n x n cells, with its diaphragm and its symmetry; and its nodes under a force."""
    radius, half = 300.0, 300.0

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return radius * np.sin(0.5 * np.pi * i), half * j, radius * np.cos(0.5 * np.pi * i)

    tube = Wall(
        (n, n), place, 3.0, E=E, nu=0.3, normals=radial, yield_stress=yield_stress, hardening=hardening
    )
    tube.hold(tube.on(1, 0.0), [0, 2])
    tube.hold(tube.on(1, half), [1])
    for axis in (0, 2):
        tube.hold(tube.on(axis, 0.0), [axis])
    return tube, tube.near((0.0, half, radius), 3.0)


def pinched(n: int) -> float:
    """Displacement under a force, n x n cells."""
    tube, loaded = octant(n, E=3e6)
    return -float(tube.linear(tube.forces((loaded, (0.0, 0.0, -0.25))))[loaded, 2].mean())


def compute() -> Computed:
    """Linear."""
    return Computed((numbers(1e5 * pinched(32)),), mesh="32 x 32 solid-shells, an octant")
