"""Slider-crank that passes its branch points.

Crank and rod are uniform and of 1 m each, all masses 1 kg: with the crank across, the slider lies on the shaft, where
it could as well stay while both turn about it. Let go at 30 degrees and 2 rad/s it moves freely on along its branch,
on which the slider is at 2 cos(angle of the crank): the angle by integrals of the energy over it.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

import flexmbd as fm
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Energy of the one degree of freedom, integrated over the angle of the crank")
BEGIN, RATE, TIMES = np.pi / 6.0, 2.0, (1.0, 4.0, 10.0)


def inertia(angle: float) -> float:
    """kg m^2, of the machine about the crank: crank, rod and slider."""
    s, c = float(np.sin(angle)), float(np.cos(angle))
    return 1.0 / 3.0 + (2.25 * s * s + 0.25 * c * c + 1.0 / 12.0) + 4.0 * s * s


def passed(angle: float) -> float:
    """s, until the crank has this angle."""
    way = quad(lambda x: np.sqrt(inertia(x) / inertia(BEGIN)), BEGIN, angle, epsabs=1e-13, epsrel=1e-13, limit=500)
    return float(way[0]) / RATE


ANGLES = tuple(float(brentq(lambda x, t=t: passed(x) - t, BEGIN, BEGIN + 3.0 * RATE * t, xtol=1e-13)) for t in TIMES)
METHODS = (
    ("explicit 8(5,3), rtol 1e-10", 1e-7, fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1e-10),
    ("Radau IIA, rtol 1e-8", 1e-6, fm.RadauIIA(), 1e-8),
)
REFERENCES = tuple(
    Reference(
        f"angle, place of the slider after {t:g} s, {name}", "rad, m", (x, 2.0 * float(np.cos(x))), within,
        Sureness.PRIMARY,
    )
    for name, within, _, _ in METHODS
    for t, x in zip(TIMES, ANGLES, strict=True)
)  # fmt: skip


def compute() -> Computed:
    """A run by each method."""
    found = []
    for _, _, method, rtol in METHODS:
        scene = fm.System()
        crank, link = (scene.add(rod(1.0, 1.0), name=name) for name in ("crank", "rod"))
        slider = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="slider")
        shaft = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
        knee = scene.connect(fm.joint.Revolute("z"), crank.frame(p=(1.0, 0.0, 0.0)), link.frame())
        scene.connect(fm.joint.Revolute("z"), link.frame(p=(1.0, 0.0, 0.0)), slider.frame())
        slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame())
        shaft.position, knee.position, slide.position = BEGIN, -2.0 * BEGIN, 2.0 * float(np.cos(BEGIN))
        shaft.velocity = RATE
        run = scene.simulate(TIMES[-1], rtol=rtol, integrator=method)
        for t in TIMES:
            at = np.array([t])
            found.append(numbers(run.beta(shaft, t=at), run.position(slider.frame(), t=at)[0, 0]))
    return Computed(tuple(found), accuracy="8(5,3) and Radau IIA")
