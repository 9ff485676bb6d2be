"""Steel ball that strikes a steel beam, clamped at its ends or free.

Of 20 mm, at 0.3 m/s, in the middle of a beam of 150 x 15 x 10 mm. The reduced beam gives way by its modes and contact
patches, with Hertz' law under the ball in series, less what a patch holds of its dent; against all nodes of the same
mesh by central differences.
"""

from __future__ import annotations

import time

import numpy as np

import flexmbd as fm
from flexmbd import contact
from verification.contact._struck_beam import BALL, MASS, NU, SIZES, SPEED, Beam, E, Struck, record, unreduced
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("The problem of Gehr et al. 2022; own solution without reduction", "10.48550/arXiv.2207.00795")
END, MODES, RTOL = 2e-4, (20, 60), 1e-5
#: What is compared, and within what: the even load of the unreduced beam is on a square, that of the law on a disc.
COMPARED = (("impulse", 5e-3), ("largest force", 1e-2), ("time of the release", 1e-2), ("speed of the rebound", 2e-2))
REFERENCES = tuple(
    Reference(f"{name}, 20 and 60 modes: {what} over the unreduced beam's", "", (1.0, 1.0), within, Sureness.OWN)
    for name in ("clamped", "free")
    for what, within in COMPARED
)


def struck(part: fm.ReducedBody, *, clamped: bool, rtol: float = RTOL) -> Struck:
    """By the machine, of a reduced beam."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(part), name="beam")
    if clamped:
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
        scene.connect(fm.joint.Fixed(), scene.ground.frame((SIZES[0], 0.0, 0.0)), body.frame("x_max"))
        middle = 0.5 * SIZES[0]
    else:
        scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        middle = 0.0
    ball = scene.add(fm.RigidBody(MASS, (0.4 * MASS * BALL**2,) * 3), name="ball")
    fall = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame((middle, 0.0, 0.0)), ball.frame())
    fall.position, fall.velocity = 0.5 * SIZES[2] + BALL + 1e-9, -SPEED
    (pair,) = scene.touch(
        contact.ElasticSurface(body, "top"), contact.Sphere(ball.frame(), BALL), contact.Hertz(E=E, nu=NU)
    )
    began = time.process_time()
    run = scene.simulate(END, rtol=rtol)
    seconds = time.process_time() - began
    t = np.linspace(0.0, END, 2001)
    force = run.contacts(pair, t=t)[0].normal_force.reshape(len(t), -1).sum(axis=1)
    return Struck(t, force, float(run.velocity(ball.frame())[-1, 2]), len(run.t) - 1, seconds)


def figures(found: Struck) -> np.ndarray:
    """Those that are compared: N s, N, s and m/s."""
    return np.array([found.impulse, found.force.max(), found.t[found.force > 0.0][-1], found.rebound])


def compute() -> Computed:
    """Clamped and free."""
    found = []
    for clamped in (True, False):
        beam = Beam(clamped)
        whole = figures(unreduced(beam, end=END))
        shares = [figures(struck(record(beam, modes), clamped=clamped)) / whole for modes in MODES]
        found += [numbers(one) for one in np.transpose(shares)]
    return Computed(tuple(found), mesh="31 x 3 x 2 bricks of degree 2, 9 patches", accuracy=f"rtol {RTOL:g}")
