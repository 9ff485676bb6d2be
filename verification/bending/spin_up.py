"""Spin-up of a beam (Simo and Vu-Quoc's robot arm).

A beam of 10 m on a hub that is brought from rest to 6 rad/s in 15 s, smoothly: how far its tip lags and draws in, and
how far it is stretched when it spins steadily, tan(a L) / a - L. A linear beam without geometric stiffening diverges
here.
"""

from __future__ import annotations

import math

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Simo & Vu-Quoc 1987, Journal of Sound and Vibration 119; Ansys VM258; transient by a planar exact "
    "beam of another program, extrapolated",
)
LENGTH, EA, RHO_A, OMEGA, RISE = 10.0, 2.8e7, 1.2, 6.0, 15.0
ALPHA = OMEGA * np.sqrt(RHO_A / EA)
REFERENCES = (
    Reference("largest lag of the tip", "m", (-0.57383,), 1e-4, Sureness.OWN),
    Reference("largest draw of the tip", "m", (-0.018823,), 5e-4, Sureness.OWN),
    Reference("lag at 2.5, 5, 10 s", "m", (-0.151283, -0.468479, -0.362886), 2e-4, Sureness.OWN),
    Reference(
        "stretch of the steady motion", "m", (math.tan(ALPHA * LENGTH) / ALPHA - LENGTH,), 1e-2, Sureness.PRIMARY
    ),
)
RATE = OMEGA / RISE


def angle(t: float) -> float:
    """rad, of the hub."""
    if t < 15.0:
        return RATE * (0.5 * t * t + (RISE / (2.0 * math.pi)) ** 2 * (math.cos(2.0 * math.pi * t / RISE) - 1.0))
    return OMEGA * t - 0.5 * OMEGA * RISE


def speed(t: float) -> float:
    """rad/s."""
    return RATE * (t - RISE / (2.0 * math.pi) * math.sin(2.0 * math.pi * t / RISE)) if t < 15.0 else OMEGA


def acceleration(t: float) -> float:
    """rad/s^2."""
    return RATE * (1.0 - math.cos(2.0 * math.pi * t / RISE)) if t < 15.0 else 0.0


def compute() -> Computed:
    """Sixteen elements."""
    bar = Bar(EA, 1e7, 1e7, 1.4e4, 1.4e4, 1.4e4, rho_A=RHO_A, rho_Iy=6e-4, rho_Iz=6e-4)
    scene = fm.System()
    ends = {"hub": (0.0, 0.0, 0.0), "tip": (LENGTH, 0.0, 0.0)}
    beam = scene.add(bar.beam(ends, [("hub", "tip")], 16), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), beam.frame("hub"))
    hinge.prescribe(fm.Motion(*(fm.compiled(one, breaks=(RISE,)) for one in (angle, speed, acceleration))))
    run = scene.simulate(20.0, rtol=1e-8)
    t = np.linspace(0.0, 20.0, 8001)
    place, turned = run.position(beam.frame("tip"), t=t), np.array([angle(one) for one in t])
    c, s = np.cos(turned), np.sin(turned)
    along, across = c * place[:, 0] + s * place[:, 1] - LENGTH, c * place[:, 1] - s * place[:, 0]
    return Computed(
        (
            numbers(across.min()), numbers(along.min()), numbers(across[[1000, 2000, 4000]]),
            numbers(along[t > 15.5].mean()),
        ),
        mesh="16 exact elements", accuracy="Radau IIA, rtol 1e-8",
    )  # fmt: skip
