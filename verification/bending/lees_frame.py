"""Lee's frame.

Two bars of 120 cm at a right angle, hinged at their far ends, a load on the horizontal one at a fifth of its length
from the corner: it snaps through and back. With shear of nu = 0.3, which takes 0.06 % off.
"""

from __future__ import annotations

import flexmbd as fm
from verification.bending._bars import Bar, limit_load
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Lee, Manuel & Rossow 1968, Journal of the Engineering Mechanics Division ASCE 94; the load as quoted since"
)
REFERENCES = (Reference("load of the first limit point", "N", (18532.0,), 1e-3, Sureness.RECALLED),)


def compute() -> Computed:
    """E = 7.2e6 N/cm^2, nu = 0.3, section 2 cm x 3 cm."""
    shear = 7.2e6 / 2.6 * 6.0 * 5.0 / 6.0
    bar = Bar(7.2e6 * 6.0, shear, shear, 7.2e6 * 2.0, 7.2e6 * 2.0, 7.2e6 * 2.0)
    points = {
        "foot": (0.0, 0.0, 0.0),
        "corner": (0.0, 0.0, 120.0),
        "load": (24.0, 0.0, 120.0),
        "end": (120.0, 0.0, 120.0),
    }
    scene = fm.System()
    frame = scene.add(bar.beam(points, [("foot", "corner"), ("corner", "load"), ("load", "end")], 8), name="frame")
    for name in ("foot", "end"):
        scene.connect(fm.joint.Revolute("y"), scene.ground.frame(p=points[name]), frame.frame(name))
    scene.add_force(fm.force.FrameForce(frame.frame("load"), (0.0, 0.0, lambda t: -t)))
    return Computed((numbers(limit_load(scene, to=25000.0)),), mesh="24 exact elements")
