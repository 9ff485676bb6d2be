"""Cantilever rolled up by a moment.

A moment of 2 pi EI / L at its tip bends a beam to a full circle; half of it to half a circle, twice to two.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar, at_rest, straight
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Euler: constant curvature; used by Simo & Vu-Quoc 1986 and by most since")
LENGTH, BAR = 10.0, Bar(1e4, 5e3, 5e3, 100.0, 100.0, 100.0)
TURNS = (0.5, 1.0, 2.0)


def place(turns: float) -> tuple[float, float]:
    """Of the tip on the circle."""
    angle = 2.0 * np.pi * turns
    return LENGTH * float(np.sin(angle)) / angle, LENGTH * (1.0 - float(np.cos(angle))) / angle


REFERENCES = tuple(
    Reference(f"tip, {turns:g} of a turn", "m", place(turns), 1e-8, Sureness.PRIMARY, size=LENGTH) for turns in TURNS
)


def compute() -> Computed:
    """Eight elements; a beam of constant curvature is exact with any number."""
    found = []
    for turns in TURNS:
        scene, beam = straight(BAR, LENGTH, 8)
        moment = 2.0 * np.pi * turns * BAR.EIz / LENGTH
        scene.add_force(fm.force.FrameForce(beam.frame("tip"), torque=(0.0, 0.0, lambda t, m=moment: m * t)))
        found.append(numbers(at_rest(scene, steps=4).position(beam.frame("tip"))[:2]))
    return Computed(tuple(found), mesh="8 exact elements")
