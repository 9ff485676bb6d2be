"""Right-angle cantilever in motion.

Two legs of 10, clamped, a triangular force of up to 50 for 2 s across the plane at the elbow. The published curve of
the elbow was digitised; geometrically exact beams and chains of reduced pieces agree with each other to 0.03.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Simo & Vu-Quoc 1988, Computer Methods in Applied Mechanics and Engineering 66; the curve as digitised in "
    "FinEtoolsFlexStructures",
    "10.1016/0045-7825(88)90073-4",
)
CURVE = {2.33: 2.39, 3.86: 5.09, 5.16: 7.24, 6.58: 8.32, 8.28: 6.78}
REASON = "Neither the elbow nor the tip of any of our models goes along the digitised curve."
REFERENCES = tuple(
    Reference(f"elbow across the plane at {t:g} s", "", (u,), 0.2 / 8.32, Sureness.SECONDARY, size=8.32, fails=REASON)
    for t, u in CURVE.items()
)


@fm.compiled(breaks=(1.0, 2.0))
def triangle(t: float) -> float:
    """At the elbow."""
    return 50.0 * max(0.0, 1.0 - abs(t - 1.0))


def compute() -> Computed:
    """Eight elements a leg."""
    bar = Bar(1e6, 1e6, 1e6, 1e3, 1e3, 1e3, rho_A=1.0, rho_Iy=10.0, rho_Iz=10.0)
    points = {"clamp": (0.0, 0.0, 0.0), "elbow": (10.0, 0.0, 0.0), "tip": (10.0, 10.0, 0.0)}
    scene = fm.System()
    beam = scene.add(bar.beam(points, [("clamp", "elbow"), ("elbow", "tip")], 8, y=(0.0, 0.0, 1.0)), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("elbow"), (0.0, 0.0, triangle)))
    run = scene.simulate(8.3, rtol=1e-6)
    found = run.position(beam.frame("elbow"), t=np.array(list(CURVE)))[:, 2]
    return Computed(tuple(numbers(one) for one in found), mesh="16 exact elements", accuracy="Radau IIA, rtol 1e-6")
