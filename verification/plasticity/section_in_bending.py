"""Rectangular section bent into the plastic range.

Moment over that of first yield at curvatures of up to ten times that of first yield: 1.5 (1 - (k_y / k)^2 / 3).
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import j2_plasticity
from verification.plasticity._pieces import node_at, places_of
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Prager & Hodge 1951, Theory of Perfectly Plastic Solids")
CURVATURES = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
REFERENCES = (
    Reference(
        "moment at k / k_y = 1, 1.5, 2, 3, 5, 10",
        "",
        tuple(1.5 * (1.0 - 1.0 / (3.0 * k * k)) for k in CURVATURES),
        1e-3,
        Sureness.PRIMARY,
    ),
)


def compute() -> Computed:
    """A slice of a narrow strip whose ends stay plane."""
    height, length, width, young, strength = 0.1, 0.005, 0.005, 200e9, 250e6
    mesh = meshes.block(length, height, width, divisions=(1, 16, 1), comm=MPI.COMM_SELF)
    steel = j2_plasticity.Parameters(E=young, nu=0.3, rho=7800.0, yield_stress=strength)
    body = NonlinearModel(mesh, j2_plasticity, steel, degree=2)
    middle = node_at(body, (0.0, 0.0, -0.5 * width))
    ends = prescribed_dofs(body, {"x_min": "x", "x_max": "x"})
    held = np.unique([*ends, body.displacement_dofs[middle, 1], *prescribed_dofs(body, {"z_min": "z"})])
    y = np.where(np.isin(held, prescribed_dofs(body, {"x_max": "x"})), places_of(body, held)[:, 1], 0.0)
    first = 2.0 * strength / (young * height)
    path = follow(body, CURVATURES, prescribed=held, displacement=lambda k: -k * first * length * y)
    moments = (-step.reactions @ y / (strength * width * height**2 / 6.0) for step in path.steps)
    return Computed((numbers(*moments),), mesh="16 quadratic bricks over the height")
