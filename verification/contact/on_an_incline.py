"""Blocks and balls on an incline.

A block slides with g (sin a - mu cos a) or, below the angle of friction, sticks; a solid ball rolls with 5/7 g sin a
where mu is above 2/7 tan a, and slides below. Other programs' blocks were seen to go by their size: here 1.4 m and
0.14 m.
"""

from __future__ import annotations

import numpy as np

from flexmbd import contact
from verification.contact._bodies import G, ball, block, incline
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Closed forms of Coulomb's law")
ANGLE, MU, SIZES = float(np.deg2rad(25.0)), 0.3, (1.4, 0.14)
SIN, COS = float(np.sin(ANGLE)), float(np.cos(ANGLE))
SLIDES, ROLLS = G * (SIN - MU * COS), 5.0 / 7.0 * G * SIN
LITTLE = 0.1  # friction with which the ball slides; 2/7 tan a is 0.133
SPINS = 2.5 * LITTLE * G * COS  # m/s^2, of the ball's surface
STEP = 1e-3
REFERENCES = (
    Reference(
        "block of 1.4 m and of 0.14 m by bristles: acceleration", "m/s^2", (SLIDES, SLIDES), 1e-3, Sureness.PRIMARY
    ),
    Reference("the same by impulses", "m/s^2", (SLIDES, SLIDES), 1e-9, Sureness.PRIMARY),
    Reference(
        "block with mu = 0.5 by bristles: way in 2 s over its size", "", (0.0,), 1e-6, Sureness.PRIMARY, size=1.0
    ),
    Reference("the same by impulses", "", (0.0,), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference(
        "ball with mu = 0.3 by bristles, by impulses: acceleration", "m/s^2", (ROLLS, ROLLS), 1e-9, Sureness.PRIMARY
    ),
    Reference(
        "ball with mu = 0.1 by impulses: acceleration, and that of its spin times its radius", "m/s^2",
        (G * (SIN - LITTLE * COS), SPINS), 1e-9, Sureness.PRIMARY,
    ),
)  # fmt: skip


def smooth(load: float, mass: float, *, size: float, mu: float) -> tuple[float, contact.PowerLaw, contact.Friction]:
    """A depth (m) at rest, the law that bears a load there, and friction as stiff."""
    depth = 1e-7 * size
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.3, speed=1e-3 * size)
    k = load / depth
    return depth, law, contact.Friction(mu, stiffness=k, damping=0.2 * float(np.sqrt(k * mass)), load=load)


def slid(size: float, mu: float, *, is_hard: bool, t_end: float) -> float:
    """m, the way of a block from rest."""
    scene, floor = incline(ANGLE)
    mass = 1000.0 * size**3
    depth, law, rough = smooth(0.25 * mass * G * COS, 0.25 * mass, size=size, mu=mu)
    body = block(scene, size, (0.0, 0.0, 0.5 * size - (0.0 if is_hard else depth)), mass=mass)
    box = contact.Box(body.frame(), (size, size, size))
    if is_hard:
        scene.touch(floor, box, contact.Hard(mu=mu))
        run = scene.simulate(t_end, h=STEP)
        return float(0.5 * t_end * run.velocity(body.frame())[-1, 0])  # of what goes evenly
    scene.touch(floor, box, law, friction=rough)
    run = scene.simulate(t_end, rtol=1e-6)
    return float(run.position(body.frame())[-1, 0])


def rolled(mu: float, *, is_hard: bool) -> tuple[float, float]:
    """m/s^2, of a ball's centre, and of its spin times its radius."""
    scene, floor = incline(ANGLE)
    radius, mass, t_end = 0.1, 2.0, 1.0
    depth, law, rough = smooth(mass * G * COS, mass, size=radius, mu=mu)
    body = ball(scene, radius, (0.0, 0.0, radius - (0.0 if is_hard else depth)), mass=mass)
    sphere = contact.Sphere(body.frame(), radius)
    if is_hard:
        scene.touch(floor, sphere, contact.Hard(mu=mu))
        run = scene.simulate(t_end, h=STEP)
    else:
        scene.touch(floor, sphere, law, friction=rough)
        run = scene.simulate(t_end, rtol=1e-6)
    spin = radius * run.angular_velocity(body.frame())[-1, 1]
    return float(run.velocity(body.frame())[-1, 0] / t_end), float(spin / t_end)


def compute() -> Computed:
    """All of them from rest."""
    by_bristles, by_impulses = (
        numbers(*(2.0 * slid(size, MU, is_hard=is_hard, t_end=1.0) for size in SIZES)) for is_hard in (False, True)
    )
    stuck = [numbers(slid(1.0, 0.5, is_hard=is_hard, t_end=2.0)) for is_hard in (False, True)]
    rolls = numbers(*(rolled(MU, is_hard=is_hard)[0] for is_hard in (False, True)))
    return Computed(
        (by_bristles, by_impulses, *stuck, rolls, numbers(rolled(LITTLE, is_hard=True))),
        accuracy=f"rtol 1e-6; Moreau-Jean, h = {STEP:g} s",
    )
