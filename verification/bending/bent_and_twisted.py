"""Cantilever bent and twisted by moments.

L = 2 m, section 0.2 m x 0.4 m, a twisting moment of 0.5 MN m and a bending one of 2 MN m at the tip.
"""

from __future__ import annotations

import flexmbd as fm
from verification.bending._bars import Bar, at_rest, straight
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Nachbagauer, Gruber & Gerstmayr 2013, Journal of Computational and Nonlinear Dynamics 8; Exudyn's ANCFBeamTest",
)
REFERENCES = (
    Reference("way of the tip, their beam", "m", (1.0943e-4, 1.8625e-4, 1.8117e-2), 1e-4, Sureness.PRIMARY),
    Reference("way of the tip, ANSYS", "m", (1.0939e-4, 1.8646e-4, 1.8117e-2), 1e-4, Sureness.PRIMARY),
)


def compute() -> Computed:
    """Dead moments; the sizes of the components."""
    E, low, high = 2.07e11, 0.4 * 0.2**3 / 12.0, 0.2 * 0.4**3 / 12.0
    G = E / 2.6
    bar = Bar(E * 0.08, 0.8331 * G * 0.08, 0.7961 * G * 0.08, 0.5768 * G * (low + high), E * high, E * low)
    scene, beam = straight(bar, 2.0, 32)
    tip = beam.frame("tip")
    scene.add_force(fm.force.FrameForce(tip, torque=(lambda t: 0.5e6 * t, lambda t: 2e6 * t, 0.0)))
    way = numbers(abs(at_rest(scene, steps=2).position(tip) - [2.0, 0.0, 0.0]))
    return Computed((way, way), mesh="32 exact elements")
