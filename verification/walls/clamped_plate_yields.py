"""Limit load of a clamped square plate under a pressure, of a metal that does not harden.

L = 1, t = 0.02, E = 10^4 yield stresses, nu = 0.3. The load is read where the plate has sagged by an eighth of its
thickness: hinges have formed all around, and as a membrane it does not bear yet. A quarter; the hinges at its edges
are as wide as a cell, so that the load falls with the cells' size: 53, 49 and 46 at 4, 8 and 16 cells.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers
from verification.walls._wall import FloatArray, Wall

SOURCE = Source(
    "Christiansen & Larsen 1983, International Journal for Numerical Methods in Engineering 19:169",
)
REFERENCES = (
    Reference("pressure at the limit, over the plastic moment over the square of the side", "1", (44.13,), 0.049,
              Sureness.RECALLED),
)  # fmt: skip


def limit(cells: int) -> float:
    """Pressure over M_p / L^2 at a sag of t / 8."""
    side, thickness, strength = 1.0, 0.02, 2e7

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return 0.5 * side * i, 0.5 * side * j, 0.0

    plate = Wall((cells, cells), place, thickness, E=1e4 * strength, nu=0.3, yield_stress=strength)
    for axis in (0, 1):
        plate.hold(plate.on(axis, 0.5 * side), [0, 1, 2])
        plate.hold(plate.on(axis, 0.0), [axis])
    unit = strength * thickness**2 / 4.0 / side**2
    pressure = plate.weight((0.0, 0.0, 1.0 / thickness))
    path = plate.path(pressure, fm.Continuation(to=60.0 * unit, longest_step=0.02, most_points=40))
    middle = np.intersect1d(plate.on(0, 0.0), plate.on(1, 0.0))
    sags = [one.displacement[plate.dofs[middle, 2]].mean() / thickness for one in path.points]
    return float(np.interp(0.125, sags, [one.t / unit for one in path.points]))


def compute() -> Computed:
    """By equilibrium_path."""
    return Computed((numbers(limit(16)),), mesh="16 x 16 solid-shells of 5 points, a quarter")
