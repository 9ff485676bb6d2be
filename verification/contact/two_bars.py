"""Two equal elastic bars that meet.

Of 10 m, waves of 30 m/s: one comes at 0.3 m/s, the other one is at rest. They touch for 2 L / c, two passages of the
wave, and then the first one is at rest and the second one goes on, without a vibration (Saint-Venant). Both are
reduced and touch by a contact patch each.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd import contact
from verification.contact._bars import LENGTH, bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Saint-Venant 1867; Timoshenko & Goodier, Theory of Elasticity, section 167; d'Alembert's solution")
SPEED, GAP, MODES, RTOL = 0.3, 0.03, (5, 20, 40), 1e-6
MEETS, LASTS = GAP / SPEED, 2.0 * LENGTH / 30.0
FORCE = 0.5 * SPEED * 30.0  # N: rho A c v / 2
REFERENCES = (
    Reference("40 modes: time of the touch and of the release", "s", (MEETS, MEETS + LASTS), 1e-2, Sureness.PRIMARY),
    Reference("40 modes: mean force while they touch", "N", (FORCE,), 1e-2, Sureness.PRIMARY),
    Reference("5, 20, 40 modes: speed of the second over that of the first", "", (1.0,) * 3, 1e-2, Sureness.PRIMARY),
    Reference("the same: momentum that is lost", "", (0.0,) * 3, 1e-10, Sureness.PRIMARY, size=1.0),
    Reference("the same: energy that is lost", "", (0.0,) * 3, 1e-5, Sureness.PRIMARY, size=1.0),
)


def met(modes: int) -> tuple[np.ndarray, float, np.ndarray, float]:
    """s, N, m/s, J: ends of the contact, mean force, mean speeds of both afterwards, share of the energy lost."""
    records = bar(modes, "x_max"), bar(modes, "x_min")
    scene = fm.System()
    bodies, held = [], ("x_min", "x_max")
    for record, frame, name, place, speed in zip(
        records, held, ("first", "second"), (-LENGTH - GAP, LENGTH), (SPEED, 0.0), strict=True
    ):
        bodies.append(scene.add(fm.FlexibleBody(record), name=name))
        slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), bodies[-1].frame(frame))
        slide.position, slide.velocity = place, speed
    one, other = (contact.ElasticSurface(body, "end") for body in bodies)
    (pair,) = scene.touch(one, other, contact.Hard())
    run = scene.simulate(1.5, rtol=RTOL, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    force = run.contacts(pair)[0].normal_force.sum(axis=1)
    touches = run.t[force > 0.0]
    late = np.array([1.0, 1.5])
    speeds = []
    for body, record in zip(bodies, records, strict=True):
        centre = run.position(body.frame(), t=late)[:, 0] + run.q(body, t=late) @ record.gram[0, 4::3] / record.mass
        speeds.append(np.diff(centre)[0] / np.diff(late)[0])
    total = run.energy().total
    mean = np.trapezoid(force, run.t) / (touches[-1] - touches[0])
    return touches[[0, -1]], float(mean), np.array(speeds), float(1.0 - total[-1] / total[0])


def compute() -> Computed:
    """For each number of modes."""
    found = [met(modes) for modes in MODES]
    ends, force, _, _ = found[-1]
    speeds = np.array([one[2] for one in found]) / SPEED
    lost = [one[3] for one in found]
    return Computed(
        (numbers(ends), numbers(force), numbers(speeds[:, 1]), numbers(1.0 - speeds.sum(axis=1)), numbers(*lost)),
        mesh="200 bricks of degree 2, 5 to 40 modes and one patch, each",
        accuracy=f"Dormand & Prince 8(5,3), rtol {RTOL:g}",
    )  # fmt: skip
