"""Free body about its intermediate axis (Dzhanibekov).

Inertia 1, 2, 3 kg m^2, angular velocity 0.01, 5, 0.01 rad/s: it flips over again and again. The time between flips is
2 K(m) / lambda of Jacobi's solution.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd.multibody.joint.connection import Connection
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Jacobi's elliptic functions, as in Landau & Lifshitz, Mechanics, section 37")
RATES = {
    2.0: (-1.16125005964, 4.86329089188, 0.67049775068),
    10.0: (0.01271487063, 4.9999938332, 0.01097979865),
    20.0: (0.01571521767, 4.99998530317, 0.01220611959),
}
REFERENCES = (
    *(Reference(f"angular velocity after {t:g} s", "rad/s", rate, 1e-10, Sureness.OWN) for t, rate in RATES.items()),
    Reference(
        "rotation after 10 s, a quaternion", "", (0.38107559832, -0.00110604625, -0.92453880296, -0.0028577689), 1e-9,
        Sureness.OWN,
    ),
    Reference("time between flips", "s", (5.02592913815747,), 1e-9, Sureness.PRIMARY),
)  # fmt: skip


def compute() -> Computed:
    """A run to each instant; flips by the sign of the middle component."""
    rates, turns, flips = [], {}, (0.0, 0.0)
    for t in RATES:
        scene = fm.System()
        body = scene.add(fm.RigidBody(1.0, (1.0, 2.0, 3.0)), name="body")
        ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
        ball.velocity = (0.01, 5.0, 0.01)
        run = scene.simulate(t, rtol=1e-13, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        rates.append(numbers(run.beta_rate(ball)[-1]))
        turns[t] = np.copysign(1.0, run.beta(ball)[-1, 0]) * run.beta(ball)[-1]

        def middle(at: float, run: fm.Trajectory = run, ball: Connection = ball) -> float:
            return float(run.beta_rate(ball, t=np.array([at]))[0, 1])

        if t == 20.0:
            flips = tuple(brentq(middle, at - 1.0, at + 1.0, xtol=1e-13) for at in (2.5, 7.5))
    return Computed(
        (*rates, numbers(turns[10.0]), numbers(flips[1] - flips[0])), accuracy="Dormand & Prince 8(5,3), rtol 1e-13"
    )
