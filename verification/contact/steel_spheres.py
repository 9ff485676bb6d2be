"""Two steel spheres that meet (Hertz).

Of 0.1 m, E = 210 GPa, nu = 0.3, at 1 m/s: approach, force and duration of an elastic impact, by the quasi-static law
F = 4/3 E* R*^(1/2) delta^(3/2).
"""

from __future__ import annotations

import numpy as np
from scipy.special import gamma

import flexmbd as fm
from flexmbd import contact
from verification.contact._bodies import ball
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Hertz 1882, Journal fuer die reine und angewandte Mathematik 92; Johnson 1985, Contact Mechanics, section 11.4"
)
RADIUS, SPEED, E, NU = 0.05, 1.0, 2.1e11, 0.3
MASS = float(4.0 / 3.0 * np.pi * RADIUS**3 * 7850.0)
STIFFNESS = float(4.0 / 3.0 * E / (2.0 * (1.0 - NU**2)) * np.sqrt(0.5 * RADIUS))
DEPTH = float((1.25 * 0.5 * MASS * SPEED**2 / STIFFNESS) ** 0.4)
#: 2 delta / v times the integral of (1 - x^(5/2))^(-1/2) from 0 to 1, 2.94327 in all.
DURATION = float(2.0 * np.sqrt(np.pi) * gamma(0.4) / (2.5 * gamma(0.9)) * DEPTH / SPEED)
REFERENCES = (
    Reference("largest approach", "m", (DEPTH,), 1e-6, Sureness.PRIMARY),
    Reference("largest force", "N", (STIFFNESS * DEPTH**1.5,), 1e-6, Sureness.PRIMARY),
    Reference("duration", "s", (DURATION,), 2e-4, Sureness.PRIMARY),
    Reference("speeds afterwards, of the one that moved and of the other", "m/s", (0.0, SPEED), 1e-7, Sureness.PRIMARY),
)


def compute() -> Computed:
    """On a line."""
    scene = fm.System()
    first = ball(scene, RADIUS, (0.0, 0.0, 0.0), mass=MASS, velocity=(SPEED, 0.0, 0.0))
    other = ball(scene, RADIUS, (2.0 * RADIUS + 1e-6, 0.0, 0.0), mass=MASS)
    law = contact.Hertz(E=E, nu=NU)
    pair = scene.touch(contact.Sphere(first.frame(), RADIUS), contact.Sphere(other.frame(), RADIUS), law)
    t = np.linspace(0.0, 1.3 * DURATION, 40001)
    run = scene.simulate(t[-1], rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    met = run.contacts(pair, t=t)[0]
    speeds = numbers(run.velocity(first.frame())[-1, 0], run.velocity(other.frame())[-1, 0])
    return Computed(
        (numbers(-met.gap.min()), numbers(met.normal_force.max()), numbers(np.ptp(t[met.gap < 0.0])), speeds),
        accuracy="Dormand & Prince 8(5,3), rtol 1e-9",
    )
