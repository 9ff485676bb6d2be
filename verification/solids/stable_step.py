"""Longest stable steps.

Central differences on lumped masses are stable up to 2 / omega: a bar of bricks that do not strain across up to the
time that a wave takes through one, h sqrt(rho / E); beams with lumped translations and condensed rotations up to
2 h^2 / sqrt(48 EI / rho A). Told is what is found over that; and the growth in 2000 steps of a bar's vibration at
0.99 of it, which stays bounded.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, ExplicitRun, Interface, NonlinearModel, Support, condensed_rotations
from flexmbd.forms import beam_timoshenko, j2_plasticity
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Eigenvalues of lumped elements in closed form; Krieg 1973 and Key & Beisinger 1971 for beams")
REFERENCES = (
    Reference("bar: step over h sqrt(rho / E)", "", (1.0,), 2e-3, Sureness.PRIMARY),
    Reference("bar at 0.99 of it: energy after 2000 steps over that at the start", "", (1.0,), 1e-6, Sureness.PRIMARY),
    Reference("beam: step over 2 h^2 / sqrt(48 EI / rho A)", "", (1.0,), 2e-3, Sureness.PRIMARY),
)
CELLS, LENGTH, E, RHO = 50, 1.0, 2e11, 8000.0


def bar() -> tuple[float, float]:
    """The step over that of the wave, and the energy kept."""
    steel = j2_plasticity.Parameters(E=E, nu=0.0, rho=RHO, yield_stress=1e12)
    mesh = meshes.block(LENGTH, 0.02, 0.02, divisions=(CELLS, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, j2_plasticity, steel, degree=1)
    sides = [Support(f"{axis}_{end}", **{axis: True}) for axis in "yz" for end in ("min", "max")]

    def velocity(x: np.ndarray) -> np.ndarray:
        """Of all waves."""
        along = 1e-3 * np.random.default_rng(1).standard_normal(len(np.unique(np.round(x[:, 0], 9))))
        _, layer = np.unique(np.round(x[:, 0], 9), return_inverse=True)
        return np.column_stack([along[layer], np.zeros(len(x)), np.zeros(len(x))])

    run = ExplicitRun(body, velocity=velocity, supports=sides)
    step = LENGTH / CELLS * float(np.sqrt(RHO / E))
    account = run.simulate(2000 * 0.99 * step, h=0.99 * step, outputs=2)
    return run.stable_step / step, float(account.total[-1] / account.total[0])


def beam() -> float:
    """The step over that of an endless row of beams."""
    shear = 12.0 * CELLS**2 / 0.5  # with which the linear cell is the cubic one without shear
    unit = beam_timoshenko.Parameters(
        E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1.0, Iz=1.0, J=1.0, ky=shear, kz=shear, orientation=(0.0, 1.0, 0.0)
    )
    line = meshes.line(1.0, divisions=CELLS, comm=MPI.COMM_SELF)
    model = ContinuumModel(line, beam_timoshenko, unit, degree=1, interfaces=[Interface("start")])
    return condensed_rotations(model).stable_step() * CELLS**2 * float(np.sqrt(48.0)) / 2.0


def compute() -> Computed:
    """Both."""
    step, energy = bar()
    return Computed((numbers(step), numbers(energy), numbers(beam())), mesh=f"{CELLS} cells")
