"""Simply supported Timoshenko beam.

2 m, 0.4 m x 0.4 m, E = 1 GPa, nu = 0.3, 7850 kg/m^3, shear factor 10 (1 + nu) / (12 + 11 nu), torsion constant 0.8436
of the polar moment.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Exudyn's ANCF beam tests; roots of (rho^2 I / k G) w^4 - (rho A + rho I k^2 (1 + E / k G)) w^2 + E I k^4 = 0"
)
BENDING = (95.63398088, 332.23451364, 635.69628837, 965.73546690)
REFERENCES = (
    Reference("bending 1 to 4", "rad/s", BENDING, 5e-5, Sureness.PRIMARY),
    Reference("extension, fixed and free", "rad/s", (280.3206251329,), 5e-5, Sureness.PRIMARY),
    Reference("twist, fixed and free: half of free and free", "rad/s", (0.5 * 319.34980860,), 5e-5, Sureness.PRIMARY),
)


def compute() -> Computed:
    """Held at one end along x, y, z and against twist, at the other along y and z."""
    shear = 10.0 * 1.3 / (12.0 + 11.0 * 0.3)
    second = 0.4**4 / 12.0
    section = beam_timoshenko.Parameters(
        E=1e9, nu=0.3, rho=7850.0, A=0.16, Iy=second, Iz=second, J=0.8436 * 2.0 * second, ky=shear, kz=shear,
        orientation=(0.0, 1.0, 0.0),
    )  # fmt: skip
    mesh = meshes.line(2.0, divisions=40, comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, beam_timoshenko, section, degree=2, interfaces=[Interface("start"), Interface("end")])
    record = craig_bampton(model, modes=101, frame="start")
    found = 2.0 * np.pi * record.frequencies({"start": ("x", "y", "z", "rx"), "end": ("y", "z")})

    def nearest(*wanted: float) -> tuple[float, ...]:
        return numbers(*(found[np.argmin(abs(found - one))] for one in wanted))

    values = nearest(*BENDING), nearest(280.3206251329), nearest(0.5 * 319.34980860)
    return Computed(values, mesh="40 quadratic beam elements, 101 modes of Craig and Bampton")
