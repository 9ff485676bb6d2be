"""Elliptic membrane (NAFEMS LE1).

A quarter of a thin membrane between the ellipses of 2 m x 1 m and 3.25 m x 2.75 m, pulled by 10 MPa on its outer
edge, E = 210 GPa, nu = 0.3, plane stress: stress along y at D, the inner end of the long axis. By bricks that are
free across.
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

SOURCE = Source("NAFEMS, The Standard NAFEMS Benchmarks, TNSB Rev. 3, 1990, test LE1")
REFERENCES = (Reference("stress yy at D", "MPa", (92.7,), 2e-3, Sureness.PRIMARY),)


def compute() -> Computed:
    """Curved quadratic cells."""
    mesh = meshes.block(1.0, 1.0, 0.01, divisions=(24, 24, 1), degree=2, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    share, angle = x[:, 0].copy(), 0.5 * np.pi * (x[:, 1] + 0.5)
    x[:, 0], x[:, 1] = (2.0 + 1.25 * share) * np.cos(angle), (1.0 + 1.75 * share) * np.sin(angle)
    steel = {"E": 210e9, "nu": 0.3, "rho": 7800.0}
    body = NonlinearModel(mesh, st_venant_kirchhoff, st_venant_kirchhoff.Parameters(**steel), degree=2)
    held = prescribed_dofs(body, {"y_min": "y", "y_max": "x", "z_min": "z"})
    force = -1e6 * load_vectors(body, [Pressure("p", "x_max")])[:, 0]
    follow(body, [1.0], prescribed=held, load=lambda t: t * force)
    model = ContinuumModel(
        mesh, solid_linear, solid_linear.Parameters(**steel), degree=2, interfaces=[Interface("x_max")]
    )
    recovery = StressRecovery(model)
    at = int(np.argmin(np.linalg.norm(recovery.x - (2.0, 0.0, -0.005), axis=1)))
    return Computed(
        (numbers(1e-5 * recovery.nodal(body.displacement)[at, 1, 1]),), mesh="24 x 24 x 1 curved quadratic bricks"
    )
