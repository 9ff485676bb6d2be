"""Column that twists.

1 m x 1 m x 6 m of neo-Hookean rubber, E = 17 MPa, nu = 0.45, 1100 kg/m^3, clamped at its foot, begins to turn at a
rate of sin(pi x / 12), its first mode of torsion. At 1 rad/s it comes back after half a period by the torsion constant
of a square; at 105 rad/s the top turns by nearly a revolution, no cell is turned inside out, and the energy stays.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, Support
from flexmbd.forms import neo_hookean
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Example twistingColumn of explicitSolidDynamics, an energy kept to 98 %; half a period by Saint-Venant's torsion "
    "of a square, 0.140577 a^4 for its constant and a^4 / 6 for its polar moment"
)
E, NU, RHO, HEIGHT = 17e6, 0.45, 1100.0, 6.0
HALF = 2.0 * HEIGHT / float(np.sqrt(E / (2.0 * (1.0 + NU)) * 6.0 * 0.140577 / RHO))
REFERENCES = (
    Reference("1 rad/s: time of the first return", "s", (HALF,), 2e-2, Sureness.PRIMARY),
    Reference("105 rad/s: energy after 0.3 s over that at the start", "", (1.0,), 2e-2, Sureness.SECONDARY),
)


def twist(rate: float, t: float) -> ExplicitRun:
    """A run with an output each 2 ms; rate in rad/s."""
    mesh = meshes.block(HEIGHT, 1.0, 1.0, divisions=(30, 5, 5), comm=MPI.COMM_SELF)
    rubber = neo_hookean.Parameters(E=E, nu=NU, rho=RHO)
    body = NonlinearModel(mesh, neo_hookean, rubber, degree=1)

    def velocity(x: np.ndarray) -> np.ndarray:
        turning = np.column_stack([np.zeros(len(x)), -x[:, 2], x[:, 1]])
        return rate * np.sin(0.5 * np.pi * x[:, :1] / HEIGHT) * turning

    run = ExplicitRun(body, velocity=velocity, supports=[Support("x_min", x=True, y=True, z=True)])
    run.simulate(t, outputs=round(t / 2e-3))
    return run


def compute() -> Computed:
    """Both rates."""
    slow = twist(1.0, 0.2)
    top = slow.motion.body.layout.node_x[:, 0] > HEIGHT - 1e-6
    y, z = slow.places[0][top, 1:].T
    angles = np.array([(y * x[top, 2] - z * x[top, 1]).sum() / (y * y + z * z).sum() for x in slow.places])
    back = int(np.argmax((angles[1:] < 0.0) & (angles[:-1] >= 0.0)))
    times = np.array(slow.account.t)
    first = np.interp(0.0, -angles[back : back + 2], times[back : back + 2])
    total = twist(105.0, 0.3).account.total
    return Computed(
        (numbers(first), numbers(total[-1] / total[0])), mesh="30 x 5 x 5 bricks",
        accuracy="stable steps of central differences",
    )  # fmt: skip
