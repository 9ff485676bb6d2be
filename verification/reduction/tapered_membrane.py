"""Cantilevered tapered membrane (NAFEMS FV32).

A trapezium in its plane, 10 m long, 5 m at the clamped and 1 m at the free end, E = 200 GPa, nu = 0.3, 8000 kg/m^3.
"""

from __future__ import annotations

import warnings

from mpi4py import MPI

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import UnitWarning
from flexmbd.forms import plane_stress
from flexmbd.reduction import craig_bampton
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("NAFEMS R0015, Selected Benchmarks for Natural Frequency Analysis, 1987, test FV32")
REFERENCES = (Reference("1 to 6", "Hz", (44.623, 130.03, 162.70, 246.05, 379.90, 391.44), 1e-4, Sureness.PRIMARY),)


def compute() -> Computed:
    """Held flat; modes with the clamped edge held are those of the mesh."""
    mesh = meshes.sheet(10.0, 5.0, divisions=(16, 8), comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    x[:, 1] *= 1.0 - 0.8 * x[:, 0] / 10.0
    p = plane_stress.Parameters(E=2e11, nu=0.3, rho=8000.0, t=0.05, out_of_plane=1e8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)  # of what holds it flat
        model = ContinuumModel(mesh, plane_stress, p, degree=2, interfaces=[Interface("x_min")])
    found = craig_bampton(model, modes=6, frame="x_min", geometric_stiffness=False).frequencies(["x_min"])
    return Computed((numbers(found[:6]),), mesh="16 x 8 quadratic cells of plane stress")
