"""Slit annular plate, lifted at one side of the slit.

Radii 6 and 10, thickness 0.03, E = 21e6, nu = 0; clamped on the other side; a line force of 0.8 per length turns it
over. Lift of the inner (A) and of the outer corner (B) at a tenth, a half and all of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import SZE, FloatArray, Wall

SOURCE = SZE
TABLE = {0.1: (4.277, 5.876), 0.5: (10.468, 13.768), 1.0: (13.891, 17.528)}
REFERENCES = tuple(
    Reference(f"lift of A and B, {share:g} of the load", "", lifts, 0.012, Sureness.SECONDARY)
    for share, lifts in TABLE.items()
)


def lifted(cells: tuple[int, int], shares: Sequence[float] = tuple(TABLE)) -> FloatArray:
    """(shares, 2) Lifts of A and B under shares of the load; cells across and around."""

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        radius, angle = 6.0 + 4.0 * i, 2.0 * np.pi * j
        return radius * np.cos(angle), radius * np.sin(angle), 0.0

    plate = Wall(cells, place, 0.03, E=21e6, nu=0.0)
    # both sides of the slit lie at the same place: nodes of the first rows of cells are told by their numbers
    first, last = _sides(plate, cells)
    plate.hold(first, [0, 1, 2])
    share = np.r_[0.5, np.ones(cells[0] - 1), 0.5] / cells[0]
    loads = [(last[abs(np.hypot(*plate.x[last, :2].T) - r) < 1e-6], (0.0, 0.0, 3.2 * part))
             for r, part in zip(6.0 + 4.0 * np.linspace(0, 1, cells[0] + 1), share, strict=True)]  # fmt: skip
    inner, outer = loads[0][0], loads[-1][0]
    return plate.pulled(
        plate.forces(*loads), shares, lambda u: [u[inner, 2].mean(), u[outer, 2].mean()]
    )


def _sides(plate: Wall, cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the two sides of the slit, by their numbers in the surface, side by side around."""
    number = plate.body.mesh.mesh.geometry.input_global_indices
    around = number % ((cells[0] + 1) * (cells[1] + 1)) % (cells[1] + 1)
    return np.flatnonzero(around == 0), np.flatnonzero(around == cells[1])


def compute() -> Computed:
    """By equilibrium_path."""
    return Computed(tuple(numbers(row) for row in lifted((6, 80))), mesh="6 x 80 solid-shells")
