"""Car axis.

An axle of two small masses on stiff springs, its left wheel on even ground, its right one on a bumpy road. Here the
line through the wheels is a body that a prescribed motion turns, along whose normal the left mass slides, so that no
constraint is left; the published multipliers are forces of joints.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Mazzia & Magherini 2008, Test Set for Initial Value Problem Solvers, problem Car Axis")
PLACES = (0.0493455784275402809, 0.496989460230171154, 1.04174252488542152, 0.373911027265361257)
RATES = (-0.0770583684040972358, 0.00744686658723778553, 0.0175568157537232222, 0.770341043779251976)
FORCES = (-0.00473688659084893325, -0.00110468033125734369)
REFERENCES = (
    Reference("xl, yl, xr, yr after 3 s", "", PLACES, 1e-10, Sureness.PRIMARY),
    Reference("their rates", "", RATES, 1e-8, Sureness.PRIMARY),
    Reference("multipliers 1, 2", "", FORCES, 1e-8, Sureness.PRIMARY),
)
MASS, REST, BUMP, OMEGA = 5e-4, 0.5, 0.1, 10.0


def road(t: float) -> tuple[float, float, float]:
    """Angle of the line through the wheels, its rate and acceleration: sin(angle) = 0.1 sin(10 t)."""
    s, rate = BUMP * np.sin(OMEGA * t), BUMP * OMEGA * np.cos(OMEGA * t)
    c = np.sqrt(1.0 - s * s)
    return np.arcsin(s), rate / c, -(OMEGA**2) * s / c + s * rate**2 / c**3


def compute() -> Computed:
    """One run."""
    scene = fm.System(gravity=(0.0, -1.0, 0.0))
    line = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="line")
    left = scene.add(fm.RigidBody(MASS, (0.0, 0.0, 0.0)), name="left")
    right = scene.add(fm.RigidBody(MASS, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), name="right")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), line.frame())
    turn.prescribe(road)
    slide = scene.connect(fm.joint.Prismatic("y"), line.frame(), left.frame())
    slide.position = REST
    axle = scene.connect(fm.joint.Revolute("z"), left.frame(), right.frame())
    axle.velocity = -BUMP * OMEGA
    wheel = right.frame(p=(1.0, 0.0, 0.0))
    scene.add_force(fm.force.SpringDamper(line.frame(), left.frame(), 1.0, REST))
    scene.add_force(fm.force.SpringDamper(line.frame(p=(1.0, 0.0, 0.0)), wheel, 1.0, REST))
    run = scene.simulate(3.0, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    places = [run.position(frame)[-1, :2] for frame in (left.frame(), wheel)]
    rates = [run.velocity(frame)[-1, :2] for frame in (left.frame(), wheel)]
    forces = run.reaction(slide)[-1, 0], 0.5 * run.reaction(axle)[-1, 0]
    return Computed(
        (numbers(*places), numbers(*rates), numbers(*forces)), accuracy="Dormand & Prince 8(5,3), rtol 1e-12"
    )
