"""Solids that hardly change their volume.

A thick cylinder of radii 100 mm and 200 mm, plane strain, E = 210 GPa, nu = 0.4999: how far the outside moves per
pressure, by displacements and pressures, and by linear bricks with mean dilatation; and the pressure at which all of it
flows, yield stress 0.24 GPa, which does not depend on nu.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, PathError, follow, prescribed_dofs
from flexmbd.forms import j2_plasticity, solid_mixed
from flexmbd.reduction import Pressure, load_vectors
from verification.plasticity._pieces import places_of
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Lame's cylinder; Hill 1950, The Mathematical Theory of Plasticity")
E, NU, INNER, OUTER, STRENGTH = 210e9, 0.4999, 0.1, 0.2, 0.24e9
WAY = 2.0 * (1.0 - NU**2) * INNER**2 * OUTER / (E * (OUTER**2 - INNER**2))
LIMIT = 2.0 * STRENGTH / float(np.sqrt(3.0)) * float(np.log(OUTER / INNER))
FORMS = ((solid_mixed, 2, 1e-5), (j2_plasticity, 1, 5e-3))
REFERENCES = (
    *(
        Reference(
            f"way of the outside, {form.__name__.split('.')[-1]}", "mm/GPa", (1e12 * WAY,), within, Sureness.PRIMARY
        )
        for form, _, within in FORMS
    ),
    Reference("limit pressure, nu = 0.4999", "GPa", (1e-9 * LIMIT,), 5e-3, Sureness.PRIMARY),
)  # fmt: skip


def cylinder(form: ModuleType, degree: int) -> tuple[NonlinearModel, np.ndarray, np.ndarray]:
    """A quarter of it, what is held, and the forces of a pressure of 1 Pa."""
    mesh = meshes.quarter_ring(0.02, OUTER, INNER, divisions=(12, 18, 1), degree=degree, comm=MPI.COMM_SELF)
    given: dict[str, Any] = {"yield_stress": STRENGTH} if form is j2_plasticity else {}
    body = NonlinearModel(mesh, form, form.Parameters(E=E, nu=NU, rho=7800.0, **given), degree=degree)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"})
    return body, held, load_vectors(body, [Pressure("p", "inner")])[:, 0]


def way(form: ModuleType, degree: int) -> float:
    """mm/GPa, the mean of the outer nodes, at a pressure so small that the answer is linear."""
    body, held, force = cylinder(form, degree)
    pressure = 1e-6 * E
    follow(body, [1.0], prescribed=held, load=lambda t: t * pressure * force)
    outside = prescribed_dofs(body, {"outer": "xy"})
    x = places_of(body, outside)[:, :2]
    along = np.where(np.isin(outside, body.displacement_dofs[:, 0]), x[:, 0], x[:, 1]) / np.linalg.norm(x, axis=1)
    return 1e12 * 2.0 * float(body.displacement[outside] @ along) / len(outside) / pressure


def limit() -> float:
    """GPa."""
    body, held, force = cylinder(j2_plasticity, 1)
    try:
        path = follow(
            body, [0.14e9, 0.18e9, 0.19e9, 0.191e9, 1.1 * LIMIT], prescribed=held, load=lambda t: t * force,
            smallest=0.01,
        )  # fmt: skip
    except PathError as error:
        path = error.path
    return 1e-9 * path.steps[-1].t


def compute() -> Computed:
    """Each form, and the limit."""
    values = tuple(numbers(way(form, degree)) for form, degree, _ in FORMS)
    return Computed((*values, numbers(limit())), mesh="12 x 18 bricks, quadratic with pressures, else linear")
