"""Taylor's bar.

A copper rod of 32.4 mm, 3.2 mm in radius, flies against a rigid wall at 227 m/s: E = 117 GPa, nu = 0.35, 8930 kg/m^3,
yield stress 0.4 GPa, hardening 0.1 GPa. Its length after 80 microseconds, in the middle of what codes agree on.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, RigidPlane, Support
from flexmbd.forms import hencky_plasticity
from flexmbd.forms.j2_plasticity import LinearHardening
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Taylor 1948; codes' band of 21.4 mm to 21.7 mm and 6.97 mm to 7.24 mm as recalled", "10.1098/rspa.1948.0081"
)
REFERENCES = (
    Reference("length after 80 microseconds", "mm", (21.55,), 0.15 / 21.55, Sureness.RECALLED),
    Reference("radius of the foot", "mm", (7.105,), 0.135 / 7.105, Sureness.RECALLED),
)


def compute() -> Computed:
    """A quarter of it, central differences."""
    copper = hencky_plasticity.Parameters(
        E=117e9, nu=0.35, rho=8930.0, yield_stress=0.4e9, hardening=LinearHardening(0.1e9)
    )
    mesh = meshes.round_bar(3.2e-3, 32.4e-3, divisions=(2, 2, 24), comm=MPI.COMM_SELF)
    rod = NonlinearModel(mesh, hencky_plasticity, copper, degree=1)
    run = ExplicitRun(
        rod,
        velocity=(0.0, 0.0, -227.0),
        planes=[RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), penalty=None, name="wall")],
        supports=[Support("x_min", x=True), Support("y_min", y=True)],
    )
    run.simulate(80e-6, outputs=1)
    x = run.motion.x
    values = numbers(1e3 * x[:, 2].max()), numbers(1e3 * np.hypot(x[:, 0], x[:, 1]).max())
    return Computed(values, mesh="a quarter of it, 24 layers of 12 bricks", accuracy="stable steps")
