"""Pinched hemisphere.

R = 10, t = 0.04, a hole of 18 degrees, E = 6.825e7, nu = 0.3: four forces of 2 on its rim, in turn outwards and
inwards; displacement under a force. A quarter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import MACNEAL, FloatArray, Wall

SOURCE = MACNEAL
REFERENCES = (Reference("displacement under a force", "", (0.0940,), 0.01, Sureness.SECONDARY),)
Nodes = NDArray[np.intp]


def hemisphere(cells: tuple[int, int]) -> tuple[Wall, Nodes, Nodes]:
    """A quarter, and its nodes under both loads; cells around and along the meridian."""

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        polar, around = np.radians(18.0 + 72.0 * j), 0.5 * np.pi * i
        return 10 * np.sin(polar) * np.cos(around), 10 * np.sin(polar) * np.sin(around), 10 * np.cos(polar)

    shell = Wall(cells, place, 0.04, E=6.825e7, nu=0.3, normals=lambda x: x)
    for axis in (0, 1):
        shell.hold(shell.on(axis, 0.0), [axis])
    shell.hold(shell.near((9.98, 0.0, 0.0), 1e-6), [2])
    return shell, shell.near((10.0, 0.0, 0.0), 0.03), shell.near((0.0, 10.0, 0.0), 0.03)


def opposed(shell: Wall, pulled: Nodes, pushed: Nodes, force: float) -> FloatArray:
    """(dofs,) Both forces."""
    return shell.forces((pulled, (force, 0.0, 0.0)), (pushed, (0.0, -force, 0.0)))


def pinched(n: int) -> float:
    """Displacement under a force, n x n cells."""
    shell, pulled, pushed = hemisphere((n, n))
    return float(shell.linear(opposed(shell, pulled, pushed, 1.0))[pulled, 0].mean())


def compute() -> Computed:
    """Linear."""
    return Computed((numbers(pinched(32)),), mesh="32 x 32 solid-shells, a quarter")
