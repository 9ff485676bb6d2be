"""Cantilevers that stretch and shear.

A beam of Euler and Bernoulli that stretches under 3 EI / L^2, and Reissner's short one (L = 2 m, h = 0.5 m) under
62.5 MN, which shears.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar, at_rest, straight
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Gerstmayr & Irschik 2008, Journal of Sound and Vibration 318; Nachbagauer, Pechstein, Irschik & Gerstmayr 2011, "
    "Multibody System Dynamics 26; Exudyn's ANCFcantileverTest"
)
REFERENCES = (
    Reference("thin, way of the tip along and across", "m", (-0.508537304326, -1.207239854550), 1e-7, Sureness.PRIMARY),
    Reference("short, as published", "m", (0.1509710, 0.7105684), 1e-6, Sureness.PRIMARY),
    Reference("short, by the beam's equations", "m", (0.15097114424, 0.71056859785), 1e-6, Sureness.OWN),
)
E = 2.07e11


def tip(bar: Bar, force: float) -> np.ndarray:
    """(3,) m, way of the tip of 2 m."""
    scene, beam = straight(bar, 2.0, 64)
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, lambda t: force * t, 0.0)))
    return np.asarray(at_rest(scene, steps=2).position(beam.frame("tip")) - [2.0, 0.0, 0.0])


def compute() -> Computed:
    """Both."""
    second = 0.1**4 / 12.0
    thin = Bar(E * 0.01, np.inf, np.inf, E * second, E * second, E * second)
    bent = tip(thin, -3.0 * E * second / 4.0)
    area, second, shear = 0.05, 0.1 * 0.5**3 / 12.0, E / 2.6 * 0.05 * 13.0 / (12.0 + 11.0 * 0.3)
    short = Bar(E * area, shear, shear, E * second, E * second, E * second)
    sheared = tip(short, 6.25e7)
    sheared = numbers(-sheared[0], sheared[1])
    return Computed((numbers(bent[:2]), sheared, sheared), mesh="64 exact elements")
