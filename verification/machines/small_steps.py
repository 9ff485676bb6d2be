"""Slider-crank by ever smaller steps.

Fixed steps of generalized-alpha on a loop. The iteration matrix has entries of 1 and of h^2: unscaled, round-off grows
as 1 / h in velocities and 1 / h^2 in reactions; scaled, velocities keep all digits, and accelerations and reactions
have the velocities' round-off over h. A crank of 1 m and a rod of 2 m, all masses 1 kg, free at 60 degrees and 2 rad/s;
told is the largest error in 100 steps of the crank's rate and of the force along the slider, over these.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Energy of the one degree of freedom; Arnold, Bruels & Cardona 2015 for the scaling")
STEPS = {1e-4: 1e-6, 1e-6: 1e-7, 1e-8: 1e-5, 1e-9: 1e-4}
REFERENCES = tuple(
    Reference(f"h = {h:g} s: errors of rate and force", "", (0.0, 0.0), within, Sureness.PRIMARY, size=1.0)
    for h, within in STEPS.items()
)
BEGIN, RATE = np.pi / 3.0, 2.0


def shape(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Inertia and its slope by the crank's angle, and of the slider's place the first and second slopes."""
    s, c = np.sin(angle), np.cos(angle)
    root = np.sqrt(1.0 - 0.25 * s * s)  # cosine of the rod's angle p, sin p = s / 2
    p1 = 0.5 * c / root
    p2 = (-0.5 * s + 0.5 * s * p1 * p1) / root
    x1, x2 = -s - s * p1, -c - c * p1 - s * p2
    # the rod's middle: x = cos + root, y = s / 2
    mx1, mx2 = -s - 0.5 * s * p1, -c - 0.5 * c * p1 - 0.5 * s * p2
    inertia = 1.0 / 3.0 + mx1**2 + 0.25 * c * c + p1 * p1 / 3.0 + x1**2
    slope = 2.0 * (mx1 * mx2 - 0.25 * s * c + p1 * p2 / 3.0 + x1 * x2)
    return inertia, slope, x1, x2


def errors(h: float) -> tuple[float, float]:
    """Of 100 steps."""
    scene = fm.System()
    across = float(np.arcsin(0.5 * np.sin(BEGIN)))
    crank, link = scene.add(rod(1.0, 1.0), name="crank"), scene.add(rod(2.0, 1.0), name="rod")
    slider = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="slider")
    shaft = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
    knee = scene.connect(fm.joint.Revolute("z"), crank.frame(p=(1.0, 0.0, 0.0)), link.frame())
    pin = scene.connect(fm.joint.Revolute("z"), link.frame(p=(2.0, 0.0, 0.0)), slider.frame())
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame())
    shaft.position, knee.position, slide.position = BEGIN, -BEGIN - across, np.cos(BEGIN) + 2.0 * np.cos(across)
    shaft.velocity = RATE
    run = scene.simulate(100 * h, h=h, integrator=fm.GeneralizedAlpha())
    inertia, slope, x1, x2 = shape(run.beta(shaft))
    rate = RATE * np.sqrt(inertia[0] / inertia)
    force = x1 * (-0.5 * slope * rate**2 / inertia) + x2 * rate**2
    off = abs(run.beta_rate(shaft) - rate), abs(run.reaction(pin)[:, 0] - force)
    return float(off[0].max() / RATE), float(off[1].max() / abs(force).max())


def compute() -> Computed:
    """Each step."""
    return Computed(tuple(numbers(*errors(h)) for h in STEPS), accuracy="generalized-alpha, 100 steps each")
