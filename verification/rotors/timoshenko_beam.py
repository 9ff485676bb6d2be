"""Simply supported Timoshenko beam.

2 m, 0.4 m x 0.4 m, E = 1 GPa, nu = 0.3, 7850 kg/m^3, shear factor 10 (1 + nu) / (12 + 11 nu), torsion constant 0.8436 of the polar moment.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Exudyn's ANCF beam tests; roots of (rho^2 I / k G) w^4 - (rho A + rho I k^2 (1 + E / k G)) w^2 + E I k^4 = 0")
BENDING = (95.63398088, 332.23451364, 635.69628837, 965.73546690)
REFERENCES = (
    Reference("bending 1 to 4", "rad/s", BENDING, 5e-5, Sureness.PRIMARY),
    Reference("extension, fixed and free", "rad/s", (280.3206251329,), 5e-5, Sureness.PRIMARY),
    Reference("twist, fixed and free: half of free and free", "rad/s", (0.5 * 319.34980860,), 5e-5, Sureness.PRIMARY),
)
SECONDS = 0.5


def compute() -> Computed:
    """Held at one end along x, y, z and against twist, at the other along y and z."""
    shear = 10.0 * 1.3 / (12.0 + 11.0 * 0.3)
    second = 0.4**4 / 12.0
    section = SimpleNamespace(
        E=1e9, nu=0.3, rho=7850.0, A=0.16, Iy=second, Iz=2.0 * second, Iyz=0.0, J=0.8436 * 2.0 * second, ky=shear, kz=shear,
        orientation=(0.0, 1.0, 0.0),
    )  # fmt: skip
    scene = fm.System()
    ends = {"A": (0.0, 0.0, 0.0), "B": (2.0, 0.0, 0.0)}
    rotary = {"beam": (7850.0 * second, 7850.0 * second)}
    body = fm.ExactBeam(ends, {"beam": [("A", "B")]}, {"beam": section}, 32, rotary_inertia=rotary)
    beam = scene.add(body, name="beam")
    scene.connect(fm.joint.Universal("y", "z"), scene.ground.frame(), beam.frame("A"))
    scene.connect(fm.joint.PointOnLine("x"), scene.ground.frame(p=ends["B"]), beam.frame("B"))
    found = 2.0 * np.pi * scene.linearize().frequencies()

    def nearest(*wanted: float) -> tuple[float, ...]:
        return numbers(*(found[np.argmin(abs(found - one))] for one in wanted))

    return Computed(
        (nearest(*BENDING), nearest(280.3206251329), nearest(0.5 * 319.34980860)), mesh="32 exact elements"
    )
