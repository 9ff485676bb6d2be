"""Elastic bar that falls onto a rigid wall.

10 m long, E = 900, rho = 1, g = 10, its lower end 5 m above: it touches at 1 s, for two passages of the wave through
it, and leaves as fast as it came; meanwhile the wall gives it twice its momentum and bears its weight.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, RigidPlane
from flexmbd.forms import j2_plasticity
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Doyen, Ern & Piperno 2011, SIAM Journal on Scientific Computing 33")
LENGTH, FALL, G, CELLS = 10.0, 5.0, 10.0, 100
REFERENCES = (
    Reference("time of the impact", "s", (1.0,), 5e-3, Sureness.PRIMARY),
    Reference("time of the release", "s", (5.0 / 3.0,), 1e-2, Sureness.PRIMARY),
    Reference("impulse of the wall", "N s", (800.0 / 3.0,), 1e-2, Sureness.PRIMARY),
)


def compute() -> Computed:
    """Along x, of bricks that do not strain across."""
    soft = j2_plasticity.Parameters(E=900.0, nu=0.0, rho=1.0, yield_stress=1e12)
    mesh = meshes.block(LENGTH, 1.0, 1.0, divisions=(CELLS, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, j2_plasticity, soft, degree=1)
    wall = RigidPlane((-FALL, 0.0, 0.0), (1.0, 0.0, 0.0), penalty=None, name="wall")
    run = ExplicitRun(body, gravity=(-G, 0.0, 0.0), planes=[wall])
    t = np.linspace(0.0, 2.0, 1001)
    first = body.layout.node_x[:, 0] < 1e-9
    ends = (body.layout.node_x[:, 0] < 1e-9) | (body.layout.node_x[:, 0] > LENGTH - 1e-9)
    run.simulate(t[-1], outputs=len(t) - 1)
    x = np.array(run.places)[-len(t) :, :, 0]
    touches = t[x[:, first].mean(axis=1) < -FALL + 1e-6 * LENGTH]
    weights = np.where(ends, 0.5, 1.0)
    after = t > 1.8
    # the mean over layers, the outer ones with half the weight; it falls freely
    centre = x[after] @ weights / weights.sum() + 0.5 * G * t[after] ** 2
    speed = np.polyfit(t[after], centre, 1)[0]  # of the parabola at t = 0: all that the wall has given, per mass
    return Computed(
        (numbers(touches[0]), numbers(touches[-1]), numbers(LENGTH * speed)),
        mesh=f"{CELLS} bricks", accuracy="stable steps of central differences",
    )  # fmt: skip
