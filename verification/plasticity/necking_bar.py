"""Round bar pulled until it necks.

Radius 6.413 mm, length 53.334 mm, E = 206.9 GPa, nu = 0.29, flow stress 0.45 + 0.265 (1 - exp(-16.93 a)) + 0.12924 a
GPa: the largest force, at which the flow stress grows by itself per strain (Considere).
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import hencky_plasticity
from flexmbd.forms.j2_plasticity import VoceHardening
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Simo & Armero 1992 for the bar; the force by Considere's condition without elastic strain")
REFERENCES = (
    Reference("largest force, per section of the mesh times the circle", "kN", (79.7317,), 5e-3, Sureness.OWN),
    Reference(
        "largest force, as the mesh has it", "kN", (79.7317,), 5e-3, Sureness.OWN,
        fails="The mesh's section is a polygon, which lacks 2.6 % of the circle.",
    ),
)  # fmt: skip


def compute() -> Computed:
    """An eighth of it, as far as it stays a cylinder; in N and mm."""
    radius, half = 6.413, 26.667
    steel = hencky_plasticity.Parameters(
        E=206.9e3, nu=0.29, rho=1.0, yield_stress=450.0,
        hardening=VoceHardening(saturation=265.0, rate=16.93, modulus=129.24),
    )  # fmt: skip
    mesh = meshes.round_bar(radius, half, divisions=(2, 2, 6), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, hencky_plasticity, steel, degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "z_max": "z"})
    pulled = np.isin(held, prescribed_dofs(body, {"z_max": "z"}))
    steps = np.array([0.05, 0.1, 0.3, 0.7, 1.2, 1.8, 2.4, *np.arange(3.0, 4.01, 0.1)])
    path = follow(body, steps, prescribed=held, displacement=lambda u: np.where(pulled, u, 0.0))
    # of a quarter of a polygon of 16 sides
    largest = 4e-3 * max(step.reactions[pulled].sum() for step in path.steps)
    polygon = 8.0 * np.sin(np.pi / 8.0) / np.pi
    values = numbers(largest / polygon), numbers(largest)
    return Computed(values, mesh="6 layers of 12 bricks", accuracy=f"{len(steps)} steps")
