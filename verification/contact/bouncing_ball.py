"""Ball that bounces until it lies.

It falls by 1 m, and each impact leaves half of its speed: infinitely many impacts, at t0 + 2 t0 (e + ... + e^k), after
which it lies from t0 (1 + e) / (1 - e) on, t0 the time of the first fall. Once by a stiff spring that loses as much at
every speed, once by impulses at fixed steps.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd import contact
from verification.contact._bodies import G, ball, incline
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Closed form: a geometric series of flights")
RADIUS, HEIGHT, E, COUNTED = 0.1, 1.0, 0.5, 6
FALL = float(np.sqrt(2.0 * HEIGHT / G))
REST = FALL * (1.0 + E) / (1.0 - E)
IMPACTS = numbers(FALL * (1.0 + 2.0 * np.cumsum([0.0, *(E ** np.arange(1, COUNTED))])))
STEP = 1e-4
REFERENCES = (
    Reference("stiff spring: first six impacts", "s", IMPACTS, 1e-4, Sureness.PRIMARY),
    Reference("stiff spring: time from which it lies", "s", (REST,), 2e-4, Sureness.PRIMARY),
    Reference("impulses: first six impacts", "s", IMPACTS, 1e-3, Sureness.PRIMARY),
    Reference("impulses: time from which it lies", "s", (REST,), 2e-3, Sureness.PRIMARY),
)


def bounces(law: contact.NormalLaw | contact.Hard, **how: object) -> tuple[np.ndarray, float]:
    """s: begins of the first contacts, and the end of the last flight."""
    scene, floor = incline(0.0)
    body = ball(scene, RADIUS, (0.0, 0.0, RADIUS + HEIGHT))
    pair = scene.touch(floor, contact.Sphere(body.frame(), RADIUS), law)
    run = scene.simulate(1.001 * REST, **how)  # type: ignore[arg-type]
    pressed = run.contacts(pair)[0].normal_force > 0.0
    begins = run.t[1:][pressed[1:] & ~pressed[:-1]]
    return begins[:COUNTED], float(run.t[np.flatnonzero(~pressed)[-1]])


def compute() -> Computed:
    """Both ways."""
    spring = bounces(
        contact.PowerLaw(k=1e12, restitution=E, speed=None), rtol=1e-8,
        integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    )  # fmt: skip
    impulses = bounces(contact.Hard(restitution=E), h=STEP)
    values = [numbers(*one) for one in (spring[:1], spring[1:], impulses[:1], impulses[1:])]
    return Computed(tuple(values), accuracy=f"Dormand & Prince 8(5,3), rtol 1e-8; Moreau-Jean, h = {STEP:g} s")
