"""Right-angle frame that buckles out of its plane.

Two legs of 0.24 m, 30 mm high and 0.6 mm thick, clamped at one end, a force in the plane at the other along the first
leg.
"""

from __future__ import annotations

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Argyris et al. 1979; Simo & Vu-Quoc 1986; Exudyn's rightAngleFrame", "10.1016/0045-7825(86)90079-4")
REFERENCES = (Reference("force at which it buckles", "N", (1.088,), 1e-2, Sureness.SECONDARY),)


def compute() -> Computed:
    """E = 71.24 GPa, nu = 0.31, torsion h w^3 / 3."""
    E, leg, w, h = 7.124e10, 0.24, 0.0006, 0.03
    G = E / 2.62
    bar = Bar(E * h * w, G * h * w, G * h * w, G * h * w**3 / 3.0, E * w * h**3 / 12.0, E * h * w**3 / 12.0)
    points = {"clamp": (0.0, 0.0, 0.0), "corner": (leg, 0.0, 0.0), "tip": (leg, -leg, 0.0)}
    scene = fm.System()
    frame = scene.add(bar.beam(points, [("clamp", "corner"), ("corner", "tip")], 16, y=(0.0, 0.0, 1.0)), name="frame")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), frame.frame("clamp"))
    scene.add_force(fm.force.FrameForce(frame.frame("tip"), (lambda t: t, 0.0, 0.0)))
    path = scene.equilibrium(path=fm.Continuation(to=1.2))
    return Computed((numbers(path.critical[0].t),), mesh="32 exact elements")
