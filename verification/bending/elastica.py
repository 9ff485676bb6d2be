"""Elastica under a dead load at its tip.

A clamped beam without extension or shear under P across its tip: way of the tip along and across, over L, and its
turn.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar, at_rest, straight
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Bisshopp & Drucker 1945, Quarterly of Applied Mathematics 3; digits by its elliptic integrals")
TABLE = {
    0.5: (0.0159189624708, 0.162143575658, 0.244533647133),
    1.0: (0.0564332362834, 0.301720773800, 0.461351949712),
    2.0: (0.160641720825, 0.493457480397, 0.781749831557),
    5.0: (0.387628360724, 0.713791523612, 1.21536811761),
    10.0: (0.554995597754, 0.810609024880, 1.43028553880),
}
REFERENCES = tuple(
    Reference(f"u / L, v / L, turn at P L^2 / EI = {load:g}", "", row, 1e-6, Sureness.OWN)
    for load, row in TABLE.items()
)
BAR = Bar(1e9, np.inf, np.inf, 1.0, 1.0, 1.0)


def compute() -> Computed:
    """Extension takes 1e-8 of the length."""
    found = []
    for load in TABLE:
        scene, beam = straight(BAR, 1.0, 48)
        tip = beam.frame("tip")
        scene.add_force(fm.force.FrameForce(tip, (0.0, lambda t, load=load: load * t, 0.0)))
        rest = at_rest(scene, steps=2)
        x, y, _ = rest.position(tip)
        turned = rest.rotation(tip)
        found.append(numbers(1.0 - x, y, np.arctan2(turned[1, 0], turned[0, 0])))
    return Computed(tuple(found), mesh="48 exact elements")
