"""L-frame that swings in space.

Two legs of 240 mm, 10 mm x 30 mm, hung on a ball at one end and free at the other; a triangular pulse of 0.2 s (50 N
at 0.1 s) across the plane on the elbow. Largest ways of the free end within 0.5 s, read off a plot.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd.forms import beam_timoshenko
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("FinEtoolsFlexBeams' example argyr_swing, after Argyris")
REFERENCES = (
    Reference(
        "least x, largest y, largest z of the free end's way", "mm", (-429.7, 521.5, 313.6), 3e-2, Sureness.SECONDARY
    ),
)


@fm.compiled(breaks=(0.1, 0.2))
def pulse(t: float) -> float:
    """N."""
    return 500.0 * max(0.0, 0.1 - abs(t - 0.1))


def compute() -> Computed:
    """In mm, N, t and s."""
    section = beam_timoshenko.Parameters.rectangle(71240.0, 0.31, 5e-9, width=10.0, height=30.0, orientation=(0, 0, 1))
    points = {"ball": (0.0, 240.0, 0.0), "elbow": (240.0, 240.0, 0.0), "free": (240.0, 0.0, 0.0)}
    scene = fm.System()
    legs = [("ball", "elbow"), ("elbow", "free")]
    frame = scene.add(fm.ExactBeam(points, {"legs": legs}, {"legs": section}, 6), name="frame")
    scene.connect(fm.joint.Spherical(), scene.ground.frame(p=points["ball"]), frame.frame("ball"))
    scene.add_force(fm.force.FrameForce(frame.frame("elbow"), (0.0, 0.0, pulse)))
    run = scene.simulate(0.5, rtol=1e-5)
    way = run.position(frame.frame("free"), t=np.linspace(0.0, 0.5, 2001)) - points["free"]
    largest = way[:, 0].min(), way[:, 1].max(), way[:, 2].max()
    return Computed((numbers(largest),), mesh="12 exact elements", accuracy="Radau IIA, rtol 1e-5")
