"""Bend of 45 degrees (Bathe and Bolourchi; NAFEMS 3DNLG-5).

An eighth of a circle of radius 100 in, section 1 in x 1 in, E = 1e7 psi, nu = 0, clamped, under a dead force across
its plane. With the polar moment for the torsion constant as most beams of the literature have it, and with the
square's own (0.140577 in^4), as NAFEMS' test.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Bathe & Bolourchi 1979; NAFEMS R0024, test 3DNLG-5, and the Abaqus Benchmarks Guide, whose elements "
    "B31, B32 and B33 scatter by 0.3 % there; rows of digits by shooting with the rod's equations",
    "10.1002/nme.1620140703",
)
REFERENCES = (
    Reference("600 lbf, as published", "in", (-13.4, -23.5, 53.4), 5e-3, Sureness.PRIMARY),
    Reference("300 lbf", "in", (-7.044642, -11.931781, 40.192392), 2e-5, Sureness.OWN),
    Reference("450 lbf", "in", (-10.781257, -18.472416, 48.503492), 2e-5, Sureness.OWN),
    Reference("600 lbf", "in", (-13.604632, -23.560582, 53.475478), 2e-5, Sureness.OWN),
    Reference("600 lbf, torsion of a square", "in", (-13.731646, -23.819092, 53.607986), 2e-5, Sureness.OWN),
    Reference("3DNLG-5, 600 lbf, Abaqus' B32", "in", (-13.73, -23.81, 53.60), 1e-3, Sureness.SECONDARY),
    Reference("3DNLG-5, 3000 lbf, Abaqus' B32", "in", (-25.06, -47.70, 68.46), 2e-3, Sureness.SECONDARY),
)
POLAR, SQUARE = 1e7 / 2.0 / 6.0, 0.140577 * 5e6


def tips(torsion: float, forces: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Ways of the tip under forces, brought up one after the other."""
    found: list[tuple[float, ...]] = []

    def at(angle: float) -> tuple[float, float, float]:
        return 100.0 * (1.0 - float(np.cos(angle))), 100.0 * float(np.sin(angle)), 0.0

    bar = Bar(1e7, 5e6 / 1.2, 5e6 / 1.2, torsion, 1e7 / 12.0, 1e7 / 12.0)
    scene = fm.System()
    ends = {"clamp": at(0.0), "tip": at(np.pi / 4)}
    beam = scene.add(bar.beam(ends, [("clamp", at(np.pi / 8), "tip")], 64, y=(0.0, 0.0, 1.0)), name="bend")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(p=ends["clamp"]), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, lambda t: t)))
    about = None
    for force in (150.0, 300.0, 450.0, 600.0, 1000.0, 1700.0, 3000.0):
        if force <= max(forces):
            about = scene.equilibrium(t=force, about=about)
        if force in forces:
            found.append(numbers(about.position(beam.frame("tip")) - ends["tip"]))
    return found


def compute() -> Computed:
    """Both torsion constants."""
    low, middle, high = tips(POLAR, (300.0, 450.0, 600.0))
    square, far = tips(SQUARE, (600.0, 3000.0))
    return Computed((high, low, middle, high, square, square, far), mesh="64 exact elements")
