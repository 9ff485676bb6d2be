"""Open cylinder, pulled out by two forces.

R = 4.953, L = 10.35, t = 0.094, E = 10.5e6, nu = 0.3125; opposite forces of 40 000 in the middle of its length, which
bend it first and stretch it then. At 0.025, 0.4 and all of the load: A under the force goes outwards, B in the
middle and C at the end, a quarter around, go inwards. An octant.
"""

from __future__ import annotations

import numpy as np

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import SZE, FloatArray, Wall, radial

SOURCE = SZE
TABLE = {0.025: (0.819, 0.864, 0.872), 0.4: (2.376, 3.443, 3.632), 1.0: (2.768, 4.551, 3.269)}
REFERENCES = tuple(
    Reference(f"A, B and C, {share:g} of the load", "", moved, 0.01, Sureness.SECONDARY)
    for share, moved in TABLE.items()
)


def pulled_out(cells: tuple[int, int]) -> FloatArray:
    """(shares, 3) Displacements of A, B and C; cells around and along."""
    radius, half = 4.953, 5.175

    def place(i: FloatArray, j: FloatArray) -> tuple[FloatArray | float, ...]:
        return radius * np.sin(0.5 * np.pi * i), half * j, radius * np.cos(0.5 * np.pi * i)

    tube = Wall(cells, place, 0.094, E=10.5e6, nu=0.3125, normals=radial)
    for axis in range(3):  # of symmetry; the tube ends at y = half, freely
        tube.hold(tube.on(axis, 0.0), [axis])
    a, b, c = (tube.near(at, 0.1) for at in ((0.0, 0.0, radius), (radius, 0.0, 0.0), (radius, half, 0.0)))
    return tube.pulled(
        tube.forces((a, (0.0, 0.0, 10000.0))),
        list(TABLE),
        lambda u: [u[a, 2].mean(), -u[b, 0].mean(), -u[c, 0].mean()],
    )


def compute() -> Computed:
    """By equilibrium_path."""
    return Computed(tuple(numbers(row) for row in pulled_out((24, 16))), mesh="24 x 16 solid-shells, an octant")
