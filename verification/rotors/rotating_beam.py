"""Frequencies of a beam on a spinning hub (Southwell, Wright).

Flap of a clamped beam of Euler and Bernoulli on a hub of radius delta L at the speed gamma, both made pure numbers by
sqrt(rho A L^4 / EI): the lowest three. Lag follows by mu^2 = flap^2 - gamma^2.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.bending._bars import Bar
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Wright, Smith, Thresher & Wang 1982, Journal of Applied Mechanics 49; digits by the equation's power series",
    "10.1115/1.3161966",
)
# hub radius over L, speed: flap
TABLE = {
    (0.0, 0.0): (3.51601527, 22.0344916, 61.6972144),
    (0.0, 2.0): (4.13731957, 22.6149220, 62.2731841),
    (0.0, 6.0): (7.36037302, 26.8090817, 66.6839144),
    (0.0, 12.0): (13.1701505, 37.6031123, 79.6144785),
    (0.0, 50.0): (51.0798113, 126.484586, 210.637911),
    (1.0, 2.0): (4.83368887, 23.3660420, 63.0675481),
    (1.0, 10.0): (16.6063628, 44.3682239, 89.1563288),
    (5.0, 10.0): (29.4744517, 72.0809385, 129.859741),
}
LAG = (5.0489749, 32.119686, 73.976464)
REFERENCES = (
    *(
        Reference(f"flap at delta = {hub:g}, gamma = {speed:g}", "", row, 3e-4, Sureness.OWN)
        for (hub, speed), row in TABLE.items()
    ),
    Reference("lag at delta = 0, gamma = 10", "", LAG, 3e-4, Sureness.OWN),
)
#: So stiff along that it stretches by 1e-6 at most, and stiffer across than any of the rows in the other plane.
EA, N = 1e9, 32


def frequencies(hub: float, speed: float, *, EIy: float = 1.0, EIz: float = 1e4) -> tuple[float, ...]:
    """The lowest three; flap is along z by EIy, lag along y by EIz."""
    bar = Bar(EA, np.inf, np.inf, 1e4, EIy, EIz, rho_A=1.0, rho_Iy=1e-7, rho_Iz=1e-7)
    scene = fm.System()
    shaft = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    beam = scene.add(
        bar.beam({"root": (hub, 0.0, 0.0), "tip": (hub + 1.0, 0.0, 0.0)}, [("root", "tip")], N), name="beam"
    )
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), shaft.frame())
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    scene.connect(fm.joint.Fixed(), shaft.frame(p=(hub, 0.0, 0.0)), beam.frame("root"))
    about = scene.equilibrium()
    return numbers(2.0 * np.pi * scene.linearize(about=about).frequencies()[:3])


def compute() -> Computed:
    """Each row of the table."""
    flap = tuple(frequencies(hub, speed) for hub, speed in TABLE)
    return Computed((*flap, frequencies(0.0, 10.0, EIy=1e4, EIz=1.0)), mesh=f"{N} exact elements")
