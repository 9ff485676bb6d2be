"""Thick elliptic plate (NAFEMS LE10).

A quarter of a plate of 0.6 m between the ellipses of 2 m x 1 m and 3.25 m x 2.75 m, held all along its outer face
across the pressure's direction and in the middle of that face along it, 1 MPa on top, E = 210 GPa, nu = 0.3: stress
along y at D, on top of the inner edge.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, NonlinearModel, follow, prescribed_dofs
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.forms import solid_linear, st_venant_kirchhoff
from flexmbd.reduction import Pressure, load_vectors
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("NAFEMS, The Standard NAFEMS Benchmarks, TNSB Rev. 3, 1990, test LE10")
REFERENCES = (
    Reference("stress yy at D, curved cells", "MPa", (-5.38,), 2e-2, Sureness.PRIMARY),
    Reference("stress yy at D, straight cells", "MPa", (-5.38,), 2e-2, Sureness.PRIMARY),
)


def stress(divisions: tuple[int, int, int], *, degree: int) -> float:
    """MPa, by cells of this degree of geometry and quadratic displacements."""
    mesh = meshes.block(1.0, 1.0, 0.6, divisions=divisions, degree=degree, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    share, angle = x[:, 0] * (0.25 + 0.75 * x[:, 0]), 0.5 * np.pi * (x[:, 1] + 0.5)  # finer at the inner edge
    x[:, 0], x[:, 1] = (2.0 + 1.25 * share) * np.cos(angle), (1.0 + 1.75 * share) * np.sin(angle)
    steel = {"E": 210e9, "nu": 0.3, "rho": 7800.0}
    body = NonlinearModel(mesh, st_venant_kirchhoff, st_venant_kirchhoff.Parameters(**steel), degree=2)
    outer = prescribed_dofs(body, {"x_max": "z"})
    middle = body.displacement_dofs[abs(body.layout.node_x[:, 2]) < 1e-9, 2]
    faces = prescribed_dofs(body, {"x_max": "xy", "y_min": "y", "y_max": "x"})
    held = np.union1d(faces, np.intersect1d(outer, middle)).astype(np.int32)
    force = 1e6 * load_vectors(body, [Pressure("p", "z_max")])[:, 0]
    follow(body, [1.0], prescribed=held, load=lambda t: t * force)
    model = ContinuumModel(
        mesh, solid_linear, solid_linear.Parameters(**steel), degree=2, interfaces=[Interface("x_max")]
    )
    recovery = StressRecovery(model)
    at = int(np.argmin(np.linalg.norm(recovery.x - (2.0, 0.0, 0.3), axis=1)))
    return 1e-6 * float(recovery.nodal(body.displacement)[at, 1, 1])


def compute() -> Computed:
    """Both kinds of cells, the same grid."""
    grid = (8, 24, 8)
    values = numbers(stress(grid, degree=2)), numbers(stress(grid, degree=1))
    return Computed(values, mesh="8 x 24 x 8 quadratic bricks")
