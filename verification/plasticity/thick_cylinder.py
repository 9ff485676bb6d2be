"""Thick cylinder under pressure.

Radii 100 mm and 200 mm, E = 210 GPa, nu = 0.3, yield stress 0.24 GPa without hardening, plane strain: how far the
outside moves while the inside flows, and the pressure at which all of it does. The formulas take the flowing part for
incompressible, which is off by some tenths of a percent.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, PathError, follow, prescribed_dofs
from flexmbd.forms import j2_plasticity
from flexmbd.reduction import Pressure, load_vectors
from verification.plasticity._pieces import places_of
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Hill 1950, The Mathematical Theory of Plasticity; de Souza Neto, Peric & Owen 2008, section 7.5.1")
LIMIT = 2.0 * 0.24e9 / np.sqrt(3.0) * np.log(2.0)
TABLE = {0.10e9: 0.0577778, 0.12e9: 0.07040330517, 0.14e9: 0.08724216801, 0.16e9: 0.1115000586, 0.18e9: 0.1533014628}
REFERENCES = (
    *(
        Reference(f"way of the outside at {p / 1e9:g} GPa", "mm", (u,), 1e-3 if p == 0.10e9 else 5e-3, Sureness.PRIMARY)
        for p, u in TABLE.items()
    ),
    Reference("limit pressure", "GPa", (LIMIT / 1e9,), 5e-3, Sureness.PRIMARY),
)


def compute() -> Computed:
    """A quarter of it."""
    mesh = meshes.quarter_ring(0.02, 0.2, 0.1, divisions=(16, 24, 1), comm=MPI.COMM_SELF)
    steel = j2_plasticity.Parameters(E=210e9, nu=0.3, rho=7800.0, yield_stress=0.24e9)
    body = NonlinearModel(mesh, j2_plasticity, steel, degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"})
    force = load_vectors(body, [Pressure("p", "inner")])[:, 0]
    outside = prescribed_dofs(body, {"outer": "xy"})
    x = places_of(body, outside)[:, :2]
    along = np.where(np.isin(outside, body.displacement_dofs[:, 0]), x[:, 0], x[:, 1]) / np.linalg.norm(x, axis=1)
    found: list[float] = []

    def read(_: float) -> None:
        found.append(2e3 * float(body.displacement[outside] @ along) / len(outside))

    follow(body, list(TABLE), prescribed=held, load=lambda t: t * force, accepted=read)
    try:
        follow(
            body,
            [0.19e9, 0.191e9, 1.1 * LIMIT],
            prescribed=held,
            load=lambda t: t * force,
            reached=0.18e9,
            smallest=0.01,
        )
        reached = 1.1 * LIMIT
    except PathError as error:
        reached = error.path.steps[-1].t
    return Computed((*(numbers(one) for one in found), numbers(reached / 1e9)), mesh="16 x 24 bricks")
