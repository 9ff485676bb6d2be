"""Billiard ball that is pushed off without spin.

It slides until its surface has stopped: after 2 v / (7 mu g) it rolls with 5/7 of its speed, whatever friction is.
"""

from __future__ import annotations

import numpy as np

from flexmbd import contact
from verification.contact._bodies import G, ball, incline
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Coriolis 1835, Theorie mathematique des effets du jeu de billard; closed form of Coulomb's law")
RADIUS, MASS, SPEED, MU = 0.0286, 0.17, 2.0, 0.2
ROLLS = 2.0 * SPEED / (7.0 * MU * G)
STEP = 1e-4
REFERENCES = (
    Reference("by bristles: speed when it rolls", "m/s", (5.0 / 7.0 * SPEED,), 1e-8, Sureness.PRIMARY),
    Reference("by bristles: time from which it rolls", "s", (ROLLS,), 1e-6, Sureness.PRIMARY),
    Reference("by impulses: speed when it rolls", "m/s", (5.0 / 7.0 * SPEED,), 1e-8, Sureness.PRIMARY),
    Reference("by impulses: time from which it rolls", "s", (ROLLS,), 1e-6, Sureness.PRIMARY),
)


def rolled(
    depth: float, law: contact.NormalLaw | contact.Hard, *, friction: contact.Friction | None, how: dict[str, float]
) -> list[float]:
    """m/s and s: speed at the end, and where the slip, which falls evenly, comes to zero."""
    scene, floor = incline(0.0)
    body = ball(scene, RADIUS, (0.0, 0.0, RADIUS - depth), mass=MASS, velocity=(SPEED, 0.0, 0.0))
    pair = scene.touch(floor, contact.Sphere(body.frame(), RADIUS), law, friction=friction)
    run = scene.simulate(1.2 * ROLLS, **how)  # type: ignore[arg-type]
    slip = run.contacts(pair)[0].slip[:, 0]
    slides = (slip > 0.01 * SPEED) & (slip < 0.9 * SPEED)
    rate, first = np.polyfit(run.t[slides], slip[slides], 1)
    return [float(run.velocity(body.frame())[-1, 0]), float(-first / rate)]


def compute() -> Computed:
    """Both ways."""
    load, depth = MASS * G, 1e-6
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.5, speed=1e-3)
    k = load / depth
    rough = contact.Friction(MU, stiffness=k, damping=0.1 * float(np.sqrt(k * MASS)), load=load)
    found = [
        *rolled(depth, law, friction=rough, how={"rtol": 1e-6}),
        *rolled(0.0, contact.Hard(mu=MU), friction=None, how={"h": STEP}),
    ]
    return Computed(tuple(map(numbers, found)), accuracy=f"rtol 1e-6; Moreau-Jean, h = {STEP:g} s")
