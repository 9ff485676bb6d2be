"""Cook's membrane: a tapered panel, clamped on the left, with a shear force on its right end; lengths in mm."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.reduction.unit_loads import Traction, load_vectors


def raised(
    n: int,
    form: ModuleType,
    *,
    young: float,
    load: float,
    degree: int,
    grading: float = 1.0,
    held: Sequence[str] = ("z_min",),
    means: bool = False,
    nu: float = 1 / 3,
    **more: Any,
) -> np.ndarray:
    """Displacement up, mm, of the middle and of the upper corner of the free end, with n x n cells.

    Cells get smaller towards all four sides where `grading` is above 1. Plane stress, and
    plane strain where both faces of the panel, "z_min" and "z_max", are held.
    """
    mesh = meshes.block(48.0, 1.0, 1.0, divisions=(n, n, 1), comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    along, up = (s**grading / (s**grading + (1 - s) ** grading) for s in (x[:, 0] / 48.0, x[:, 1] + 0.5))
    x[:, 0], x[:, 1] = 48.0 * along, 44.0 * along + up * (44.0 - 28.0 * along)
    p = form.Parameters(E=young, nu=nu, rho=1.0, **more)
    body = NonlinearModel(mesh, form, p, degree=degree, cell_means=means)
    fixed = prescribed_dofs(body, {"x_min": "xy"} | dict.fromkeys(held, "z"))
    force = load / 16.0 * load_vectors(body, [Traction("shear", "x_max", (0.0, 1.0, 0.0))])[:, 0]
    follow(body, [1.0], prescribed=fixed, load=lambda t: t * force)
    places = (48.0, 52.0, -0.5), (48.0, 60.0, -0.5)
    found = [np.argmin(np.linalg.norm(body.layout.node_x - place, axis=1)) for place in places]
    return np.asarray(body.displacement[body.displacement_dofs[found, 1]])
