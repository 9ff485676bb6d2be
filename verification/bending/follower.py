"""Cantilever under a force that follows its tip, and Beck's column.

Across the tip the beam winds up (GXBeam's follower example: L = 100, EI = 3.5e7, force up to 134 kN, P L^2 / EI =
38.2857); along it the column flutters without another equilibrium.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar, straight
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Argyris & Symeonidis 1981; Beck 1952; places of the tip by EI psi'' = -P cos(psi) from the tip on")
REFERENCES = (
    Reference("tip over L at P L^2 / EI = 4", "", (0.342745786223, 0.786168425650), 1e-6, Sureness.OWN, size=1.0),
    Reference(
        "tip over L at P L^2 / EI = 38.2857", "", (0.198986897161, -0.495693121645), 1e-4, Sureness.OWN, size=1.0
    ),
    Reference("flutter load of Beck's column, P L^2 / EI", "", (20.0509536,), 5e-4, Sureness.RECALLED),
)
BAR = Bar(1e8, np.inf, np.inf, 1.0, 1.0, 1.0, rho_Iy=1e-6, rho_Iz=1e-6)


def wound(load: float) -> tuple[float, ...]:
    """Tip, brought up in steps."""
    scene, beam = straight(BAR, 1.0, 48)
    tip = beam.frame("tip")
    scene.add_force(fm.force.FrameForce(tip, (0.0, lambda t: load * t, 0.0), axes=fm.force.Axes.FRAME))
    about = None
    for share in np.arange(1, 9) / 8:
        about = scene.equilibrium(t=float(share), about=about)
    return numbers(about.position(tip)[:2])


def flutter(n: int) -> float:
    """Load at which the column of n elements flutters."""
    scene, beam = straight(BAR, 1.0, n)
    along = (lambda t: -t, 0.0, 0.0)
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), along, axes=fm.force.Axes.FRAME))
    (critical,) = scene.equilibrium(path=fm.Continuation(to=22.0)).critical
    return float(critical.t)


def compute() -> Computed:
    """Rotary inertia of a hundredth of a percent, which the literature leaves out."""
    values = wound(4.0), wound(134.0 / 3.5), numbers(flutter(24))
    return Computed(values, mesh="48 exact elements; the column of 24")
