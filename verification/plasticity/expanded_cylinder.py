"""Thick cylinder opened far.

Radii 10 and 20, rigid and perfectly plastic, plane strain, its bore opened to three times its radius: pressure over
the yield stress, ln((b^2 / a^2 + r^2 - 1) / r^2) / sqrt(3), r = how far it is opened. Here E is 22 000 yield stresses
and nu = 0.4535.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import hencky_plasticity
from verification.plasticity._pieces import places_of
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("solids4foam, cylinderExpansion; Hill 1950, The Mathematical Theory of Plasticity")
TABLE = {12.0: 0.6501029057, 15.0: 0.4891876478, 20.0: 0.3230943258, 30.0: 0.166093322}
REFERENCES = tuple(
    Reference(f"pressure at the inner radius {a:g}", "", (p,), 3e-3, Sureness.PRIMARY) for a, p in TABLE.items()
)
AROUND = 12


def compute() -> Computed:
    """A quarter of it, the bore moved along the radius."""
    mesh = meshes.quarter_ring(1.0, 20.0, 10.0, divisions=(16, AROUND, 1), comm=MPI.COMM_SELF)
    soft = hencky_plasticity.Parameters(E=22e3, nu=0.4535, rho=1.0, yield_stress=1.0)
    body = NonlinearModel(mesh, hencky_plasticity, soft, degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z", "inner": "xy"})
    bore = np.isin(held, prescribed_dofs(body, {"inner": "xy"}))
    x = places_of(body, held)[:, :2]
    along = np.where(np.isin(held, body.displacement_dofs[:, 0]), x[:, 0], x[:, 1]) / 10.0 * bore
    steps = np.unique(np.round([*TABLE, *np.geomspace(10.2, 30.0, 40)], 6))
    path = follow(body, steps, prescribed=held, displacement=lambda a: (a - 10.0) * along)
    # a pressure on the polygon of the bore pushes its nodes outwards by this area times it
    area = AROUND * np.sin(0.5 * np.pi / AROUND)
    found = {round(step.t, 6): float(step.reactions @ along) / (step.t * area) for step in path.steps}
    return Computed(tuple(numbers(found[a]) for a in TABLE), mesh="16 x 12 bricks", accuracy=f"{len(steps)} steps")
