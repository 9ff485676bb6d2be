"""Deep arch of 215 degrees, clamped and hinged.

R = 100, EI = 1e6, A = 2, E = 1.5e6: a load on its crown makes it buckle to the side.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar, limit_load
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("DaDeppo & Schmidt 1975, Journal of Applied Mechanics 42: P R^2 / EI = 8.97")
REFERENCES = (Reference("load of the limit point", "", (897.0,), 6e-4, Sureness.RECALLED),)


def compute() -> Computed:
    """Nearly inextensible; no shear."""
    bar = Bar(3e6, np.inf, np.inf, 1e6, 1e6, 1e6)
    half = np.deg2rad(107.5)

    def at(angle: float) -> tuple[float, float, float]:
        return 100.0 * float(np.sin(angle)), 0.0, 100.0 * float(np.cos(angle))

    points = {"clamp": at(-half), "crown": at(0.0), "hinge": at(half)}
    halves = [("clamp", at(-0.5 * half), "crown"), ("crown", at(0.5 * half), "hinge")]
    scene = fm.System()
    arch = scene.add(bar.beam(points, halves, 12), name="arch")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=points["clamp"]), arch.frame("clamp"))
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(p=points["hinge"]), arch.frame("hinge"))
    scene.add_force(fm.force.FrameForce(arch.frame("crown"), (0.0, 0.0, lambda t: -t)))
    return Computed((numbers(limit_load(scene, to=950.0)),), mesh="24 exact elements")
