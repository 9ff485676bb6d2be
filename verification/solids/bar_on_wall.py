"""Elastic bar against a rigid wall.

10 in long, E = 3e7 psi, rho = 7.3e-4, at 202.2 in/s and 0.01 in away: it touches for 2 L / c and flies back as fast,
for the wave through it takes all of its energy there and back.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, RigidPlane
from flexmbd.forms import j2_plasticity
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("d'Alembert's solution; Ansys VM265; code_aster SDNV100")
LENGTH, SPEED, GAP = 10.0, 202.2, 0.01
WAVE = float(np.sqrt(3e7 / 7.3e-4))
REFERENCES = (
    Reference("time of the impact", "s", (4.9456e-5,), 2.5e-3, Sureness.PRIMARY),
    Reference("time of the release", "s", (4.9456e-5 + 9.8657e-5,), 1e-2, Sureness.PRIMARY),
    Reference("mean speed afterwards over that before", "", (1.0,), 1e-2, Sureness.PRIMARY),
)


def compute() -> Computed:
    """Of 200 bricks, which do not strain across."""
    soft = j2_plasticity.Parameters(E=3e7, nu=0.0, rho=7.3e-4, yield_stress=1e12)
    mesh = meshes.block(LENGTH, 1.0, 1.0, divisions=(200, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, j2_plasticity, soft, degree=1)
    run = ExplicitRun(
        body,
        velocity=(-SPEED, 0.0, 0.0),
        planes=[RigidPlane((-GAP, 0.0, 0.0), (1.0, 0.0, 0.0), penalty=None, name="wall")],
    )
    t = np.linspace(0.0, 2.5e-4, 2501)
    first = body.layout.node_x[:, 0] < 1e-9
    inside = (body.layout.node_x[:, 0] > 1e-9) & (body.layout.node_x[:, 0] < LENGTH - 1e-9)
    run.simulate(t[-1], outputs=len(t) - 1)
    x = np.array(run.places)[-len(t) :, :, 0]
    touches = t[x[:, first].mean(axis=1) < -GAP + 1e-6 * LENGTH]
    # the mean over layers, the outer ones with half the weight
    centre = (x[:, inside].sum(axis=1) + 0.5 * x[:, ~inside].sum(axis=1)) / (0.5 * inside.size + 0.5 * inside.sum())
    after = t > 1.6e-4
    speed = np.polyfit(t[after], centre[after], 1)[0]
    return Computed(
        (numbers(touches[0]), numbers(touches[-1]), numbers(speed / SPEED)),
        mesh="200 bricks", accuracy="stable steps of central differences",
    )  # fmt: skip
