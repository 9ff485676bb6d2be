"""Hinged cylindrical roof that snaps through and back.

R = 2540, half the length 254, half the angle 0.1 rad, t = 6.35, E = 3102.75, nu = 0.3: straight edges hinged in the
middle surface, curved ones free, a force on its crown. The force has a largest value, turns, and so does the
deflection. A quarter of two layers, so that the middle surface has nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import flexmbd as fm
from flexmbd.continuation.crossing import CriticalKind
from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import SZE, FloatArray, Wall, radial

SOURCE = SZE
# the table's points lie somewhat beside the extrema, and its mesh is as coarse as this one
REFERENCES = (
    Reference("largest force", "N", (585.9,), 0.01, Sureness.SECONDARY),
    Reference("largest deflection before it turns back, and least after that", "mm", (17.008, 14.451), 0.01,
              Sureness.SECONDARY),
    Reference("least force", "N", (-386.4,), 0.03, Sureness.SECONDARY),
)  # fmt: skip


@dataclass(frozen=True)
class Snap:
    """What a path through both turns shows.

    Attributes:
        largest: N, force.
        least: N, force.
        turns: mm, deflections of the crown at which it turns back, and on again.
    """

    largest: float
    least: float
    turns: tuple[float, float]


def snapped(cells: tuple[int, int]) -> Snap:
    """Cells around and along."""
    radius = 2540.0

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return radius * np.sin(0.1 * i), 254.0 * j, radius * np.cos(0.1 * i)

    roof = Wall(cells, place, 6.35, E=3102.75, nu=0.3, normals=radial, layers=2)
    for axis in (0, 1):
        roof.hold(roof.on(axis, 0.0), [axis])
    middle = abs(np.hypot(roof.x[:, 0], roof.x[:, 2]) - radius) < 1e-6
    roof.hold(np.flatnonzero(middle & (abs(roof.x[:, 0] - radius * np.sin(0.1)) < 1e-6)), [0, 1, 2])
    crown = roof.near((0.0, 0.0, radius), 0.1)
    path = roof.path(roof.forces((crown, (0.0, 0.0, -0.25))), fm.Continuation(to=700.0, longest_step=0.04))
    deflection = np.array([-one.displacement[roof.dofs[crown, 2]].mean() for one in path.points])
    largest, least = (one.t for one in path.critical if one.kind is CriticalKind.LIMIT)
    back = 1 + int(np.argmax(np.diff(deflection) < 0.0))
    on = back + int(np.argmax(np.diff(deflection[back - 1 :]) > 0.0))
    return Snap(largest, least, (_extreme(deflection, back - 1), _extreme(deflection, on - 1)))


def _extreme(values: FloatArray, near: int) -> float:
    """Of the parabola through three values, evenly apart."""
    low, middle, high = values[near - 1 : near + 2]
    return float(middle - (high - low) ** 2 / (8.0 * (low - 2.0 * middle + high)))


def compute() -> Computed:
    """By equilibrium_path."""
    found = snapped((16, 16))
    values = (numbers(found.largest), numbers(found.turns), numbers(found.least))
    return Computed(values, mesh="16 x 16 x 2 solid-shells, a quarter")
