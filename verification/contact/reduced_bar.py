"""Reduced elastic bar that falls onto a rigid wall.

10 m long, E = 900, rho = 1, g = 10, its lower end 5 m above: it touches from 1 s to 5/3 s, two passages of its wave,
and is given 800/3 N s. Of 5 to 40 modes and one contact patch, whose residual flexibility is all that is between the
bar and the wall.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd import contact
from verification.contact._bars import LENGTH, bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Doyen, Ern & Piperno 2011, SIAM Journal on Scientific Computing 33")
FALL, G, MODES, RTOL = 5.0, 10.0, (5, 10, 20, 40), 1e-6
ENERGY = LENGTH * G * FALL  # J
REFERENCES = (
    Reference("40 modes: time of the impact", "s", (1.0,), 1e-3, Sureness.PRIMARY),
    Reference("40 modes: time of the release", "s", (5.0 / 3.0,), 1e-2, Sureness.PRIMARY),
    Reference("5, 10, 20, 40 modes: impulse of the wall", "N s", (800.0 / 3.0,) * 4, 1e-2, Sureness.PRIMARY),
    Reference("the same: energy that is lost, over that of the fall", "", (0.0,) * 4, 1e-6, Sureness.PRIMARY, size=1.0),
    Reference("the same: overlap over the length", "", (0.0,) * 4, 1e-12, Sureness.PRIMARY, size=1.0),
)


def dropped(modes: int) -> tuple[np.ndarray, float, float, float]:
    """s, N s, J, m: instants of contact, impulse, energy lost, overlap."""
    record = bar(modes, "x_min")
    scene = fm.System(gravity=(-G, 0.0, 0.0))
    body = scene.add(fm.FlexibleBody(record), name="bar")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame("x_max"))
    slide.position = LENGTH
    wall = contact.HalfSpace(scene.ground.frame((-FALL, 0.0, 0.0)), normal="x")
    (pair,) = scene.touch(contact.ElasticSurface(body, "end"), wall, contact.Hard())
    run = scene.simulate(2.6, rtol=RTOL, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    met = run.contacts(pair)[0]
    touches = run.t[met.normal_force[:, 0] > 0.0]
    late = np.array([2.0, 2.6])
    centre = run.position(body.frame(), t=late)[:, 0] + run.q(body, t=late) @ record.gram[0, 4::3] / record.mass
    # it flies: its momentum is what the wall has given, less its weight's
    impulse = record.mass * np.diff(centre + 0.5 * G * late**2)[0] / np.diff(late)[0]
    total = run.energy().total
    return touches, float(impulse), float(total[0] - total[-1]), max(0.0, -float(met.gap.min()))


def compute() -> Computed:
    """For each number of modes."""
    found = [dropped(modes) for modes in MODES]
    touches = found[-1][0]
    return Computed(
        (
            numbers(touches[0]), numbers(touches[-1]), numbers(*(one[1] for one in found)),
            numbers(*(one[2] / ENERGY for one in found)), numbers(*(one[3] / LENGTH for one in found)),
        ),
        mesh="200 bricks of degree 2, 5 to 40 modes, one patch", accuracy=f"Dormand & Prince 8(5,3), rtol {RTOL:g}",
    )  # fmt: skip
