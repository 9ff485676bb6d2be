"""Flying beam.

A free beam of 10 m, EI = 500, leaning at 3:4, is thrown by a force of 8 and a moment of 80 at its lower end for 2.5
s. What force and moment brought in stays: momentum 8 x 2.5, angular momentum and energy.
"""

from __future__ import annotations

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Simo & Vu-Quoc 1986, Journal of Applied Mechanics 53", "10.1115/1.3171871")
REFERENCES = (
    Reference("linear momentum after 7 s", "kg m/s", (20.0, 0.0, 0.0), 1e-7, Sureness.PRIMARY),
    Reference("angular momentum after 7 s over that after 2.5 s", "", (1.0,), 1e-7, Sureness.PRIMARY),
    Reference("energy after 7 s over that after 2.5 s", "", (1.0,), 1e-7, Sureness.PRIMARY),
)


@fm.compiled(breaks=(2.5,))
def force(t: float) -> float:
    """N."""
    return 8.0 if t < 2.5 else 0.0


@fm.compiled(breaks=(2.5,))
def moment(t: float) -> float:
    """N m."""
    return -80.0 if t < 2.5 else 0.0


def compute() -> Computed:
    """Eight elements."""
    bar = Bar(1e4, 1e4, 1e4, 500.0, 500.0, 500.0, rho_A=1.0, rho_Iy=10.0, rho_Iz=10.0)
    ends = {"lower": (6.0, 0.0, 0.0), "upper": (0.0, 8.0, 0.0)}
    scene = fm.System()
    beam = scene.add(bar.beam(ends, [("lower", "upper")], 8, y=(0.0, 0.0, 1.0)), name="beam")
    scene.connect(fm.joint.Free(), scene.ground.frame(p=ends["lower"]), beam.frame("lower"))
    scene.add_force(fm.force.FrameForce(beam.frame("lower"), (force, 0.0, 0.0), (0.0, 0.0, moment)))
    run = scene.simulate(7.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    after = run.t >= 2.5
    kept, total = run.momentum(), run.energy().total[after]
    turning = kept.angular[after, 2]
    return Computed(
        (numbers(kept.linear[-1]), numbers(turning[-1] / turning[0]), numbers(total[-1] / total[0])),
        mesh="8 exact elements", accuracy="Dormand & Prince 8(5,3), rtol 1e-9",
    )  # fmt: skip
