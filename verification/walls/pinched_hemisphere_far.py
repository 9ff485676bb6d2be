"""Pinched hemisphere, far.

R = 10, t = 0.04, a hole of 18 degrees, E = 6.825e7, nu = 0.3: four forces of 400 on its rim, in turn outwards and
inwards; under those outwards A, inwards B, at a tenth, a half and all of the load. A quarter.
"""

from __future__ import annotations

from collections.abc import Sequence

from verification.reference import Computed, Reference, Sureness, numbers
from verification.walls._wall import SZE, FloatArray
from verification.walls.pinched_hemisphere import hemisphere, opposed

SOURCE = SZE
TABLE = {0.1: (1.840, 1.499), 0.5: (5.902, 3.406), 1.0: (8.178, 4.067)}
REFERENCES = tuple(
    Reference(f"B inwards and A outwards, {share:g} of the load", "", moved, 0.01, Sureness.RECALLED)
    for share, moved in TABLE.items()
)


def bent(n: int, shares: Sequence[float] = tuple(TABLE)) -> FloatArray:
    """(shares, 2) Displacements of B inwards and A outwards under shares of the load; n x n cells."""
    shell, pulled, pushed = hemisphere((n, n))
    return shell.pulled(
        opposed(shell, pulled, pushed, 200.0),
        shares,
        lambda u: [-u[pushed, 1].mean(), u[pulled, 0].mean()],
    )


def compute() -> Computed:
    """By equilibrium_path."""
    return Computed(tuple(numbers(row) for row in bent(32)), mesh="32 x 32 solid-shells, a quarter")
