"""How far Craig and Bampton's frequencies are above the mesh's.

A beam of Euler and Bernoulli, both ends as interfaces, free, and n modes with both held: relative errors of the
lowest free frequencies. And with the tip alone as interface, clamped at the root.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Craig & Bampton 1968, AIAA Journal 6; errors by 40 elements of Hermite", "10.2514/3.4741")
FREE = {
    1: (3.600e-3,), 2: (3.600e-3, 4.388e-3), 4: (4.105e-4, 9.188e-4, 4.273e-3, 3.889e-3),
    8: (2.591e-5, 9.581e-5, 4.644e-4),
}  # fmt: skip
CLAMPED = {1: (3.470e-4, 4.175e-3), 2: (5.838e-5, 1.091e-3, 3.698e-3), 4: (5.410e-6, 1.400e-4, 7.096e-4)}
REFERENCES = (
    *(Reference(f"free, {n} modes: errors", "", row, 1e-2, Sureness.OWN) for n, row in FREE.items()),
    *(Reference(f"clamped, {n} modes: errors", "", row, 1e-2, Sureness.OWN) for n, row in CLAMPED.items()),
)


def compute() -> Computed:
    """Bending in one plane comes first: all else is much stiffer."""
    section = beam_timoshenko.Parameters(
        E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=1e-8, Iz=1e-2, J=1e-2, ky=1.0, kz=1.0, orientation=(0.0, 1.0, 0.0)
    )
    mesh = meshes.line(1.0, divisions=40, comm=MPI.COMM_SELF)
    model = ContinuumModel(mesh, beam_timoshenko, section, degree=2, interfaces=[Interface("start"), Interface("end")])

    def found(n: int, clamped: list[str]) -> np.ndarray:
        record = craig_bampton(model, modes=n, frame="start", geometric_stiffness=False)
        return np.asarray(record.frequencies(clamped))

    values = []
    for clamped, table in (([], FREE), (["start"], CLAMPED)):
        whole = found(40, clamped)
        values.extend(numbers(found(n, clamped)[: len(row)] / whole[: len(row)] - 1.0) for n, row in table.items())
    return Computed(tuple(values), mesh="40 quadratic beam elements")
