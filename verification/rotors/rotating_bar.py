"""Bar that spins about its end.

How far it stretches: tan(a L) / a - L where the force grows with what it stretches, a^2 = rho Omega^2 / E; and to the
first order, rho Omega^2 L^3 / 3 E.
"""

from __future__ import annotations

import math

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("code_aster V3.04.104 for the first order; u'' + a^2 (x + u) = 0 for the whole")
FAST, SLOW = 0.5, 1e-3
REFERENCES = (
    Reference(f"stretch over L at a L = {FAST:g}", "", (math.tan(FAST) / FAST - 1.0,), 1e-5, Sureness.PRIMARY),
    Reference(f"stretch over L at a L = {SLOW:g}", "", (SLOW**2 / 3.0,), 1e-5, Sureness.PRIMARY),
)


def stretch(rate: float) -> float:
    """Of a bar of unit length, stiffness and mass."""
    bar = Bar(1.0, 0.5, 0.5, 1.0, 1.0, 1.0, rho_A=1.0, rho_Iy=1e-6, rho_Iz=1e-6)
    scene = fm.System()
    shaft = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="shaft")
    beam = scene.add(bar.beam({"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}, [("root", "tip")], 64), name="bar")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), shaft.frame())
    turn.prescribe(lambda t: (rate * t, rate, 0.0))
    scene.connect(fm.joint.Fixed(), shaft.frame(), beam.frame("root"))
    return float(np.linalg.norm(scene.equilibrium().position(beam.frame("tip"))) - 1.0)


def compute() -> Computed:
    """Both speeds."""
    return Computed((numbers(stretch(FAST)), numbers(stretch(SLOW))), mesh="64 exact elements")
