"""Free symmetric body.

Inertia 0.04 kg m^2 across its axis and 0.02 along it. In its axes the angular velocity goes round at s = (I - J) / I
of its axial part.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Drake, free_body test; closed form of Euler's equations")
ACROSS, ALONG, START, END = 0.04, 0.02, (2.0, -4.0, 6.0), 10.0
SLIP = (ACROSS - ALONG) / ACROSS * START[2] * END
REFERENCES = (
    Reference(
        "angular velocity in body axes after 10 s", "rad/s",
        (
            START[0] * np.cos(SLIP) + START[1] * np.sin(SLIP), -START[0] * np.sin(SLIP) + START[1] * np.cos(SLIP),
            START[2],
        ),
        1e-11, Sureness.PRIMARY,
    ),
    Reference(
        "angular momentum in axes at rest, kept", "kg m^2/s", (ACROSS * START[0], ACROSS * START[1], ALONG * START[2]),
        1e-11, Sureness.PRIMARY,
    ),
)  # fmt: skip


def compute() -> Computed:
    """One run."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (ACROSS, ACROSS, ALONG)), name="body")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    ball.velocity = START
    run = scene.simulate(END, rtol=1e-13, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    rate = run.beta_rate(ball)[-1]
    momentum = run.rotation(body.frame())[-1] @ ((ACROSS, ACROSS, ALONG) * rate)
    return Computed((numbers(rate), numbers(momentum)), accuracy="Dormand & Prince 8(5,3), rtol 1e-13")
