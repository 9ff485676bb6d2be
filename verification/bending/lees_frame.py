"""Lee's frame.

Two bars of 120 cm at a right angle, hinged at their far ends, a load on the horizontal one at a fifth of its length from the corner: it
snaps through and back.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Lee, Manuel & Rossow 1968, Journal of the Engineering Mechanics Division ASCE 94; the load as quoted since")
REFERENCES = (Reference("load of the first limit point", "N", (18532.0,), 1e-3, Sureness.RECALLED),)
SECONDS = 1.0


def compute() -> Computed:
    """E = 7.2e6 N/cm^2, A = 6 cm^2, I = 2 cm^4; no shear."""
    bar = Bar(7.2e6 * 6.0, np.inf, np.inf, 7.2e6 * 2.0, 7.2e6 * 2.0, 7.2e6 * 2.0)
    points = {"foot": (0.0, 0.0, 0.0), "corner": (0.0, 0.0, 120.0), "load": (24.0, 0.0, 120.0), "end": (120.0, 0.0, 120.0)}
    scene = fm.System()
    frame = scene.add(bar.beam(points, [("foot", "corner"), ("corner", "load"), ("load", "end")], 16), name="frame")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), frame.frame("foot"))
    scene.connect(fm.joint.PointOnLine("y"), scene.ground.frame(p=points["end"]), frame.frame("end"))
    scene.add_force(fm.force.FrameForce(frame.frame("load"), (0.0, 0.0, lambda t: -t)))
    path = scene.equilibrium(path=fm.Continuation(to=25000.0, back_to=-2e4))
    limit = next(one.t for one in path.critical if one.kind is fm.CriticalKind.LIMIT)
    return Computed((numbers(limit),), mesh="48 exact elements")
