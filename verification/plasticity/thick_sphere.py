"""Thick sphere under pressure.

Radii 100 mm and 200 mm, E = 210 GPa, nu = 0.3, yield stress 0.24 GPa without hardening: how far the outside moves
while the inside flows.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import j2_plasticity
from flexmbd.meshes import from_arrays
from flexmbd.reduction import Pressure, load_vectors
from verification.plasticity._pieces import node_at
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source(
    "Hill 1950, The Mathematical Theory of Plasticity: u = s c^3 (1 - nu) / (E b^2), "
    "p = 2 s ln(c / a) + 2 s (1 - c^3 / b^3) / 3"
)
TABLE = {0.15e9: 0.02148893, 0.20e9: 0.03121218, 0.25e9: 0.04712232, 0.30e9: 0.07823254}
REFERENCES = tuple(
    Reference(f"way of the outside at {p / 1e9:g} GPa", "mm", (u,), 3e-3, Sureness.PRIMARY) for p, u in TABLE.items()
)
INNER, OUTER, AROUND, THROUGH = 0.1, 0.2, 12, 20


def octant() -> tuple[np.ndarray, np.ndarray]:
    """Points and bricks of three blocks about the axes, which meet along the diagonals."""
    radius = np.geomspace(INNER, OUTER, THROUGH + 1)
    slope = np.tan(np.linspace(0.0, np.pi / 4, AROUND + 1))
    points, cells = [], []
    number = np.arange((THROUGH + 1) * (AROUND + 1) ** 2).reshape(THROUGH + 1, AROUND + 1, AROUND + 1)
    corner = [
        number[i : i + THROUGH, j : j + AROUND, k : k + AROUND].ravel() for k in (0, 1) for j in (0, 1) for i in (0, 1)
    ]
    for axis in range(3):
        a, b = np.meshgrid(slope, slope, indexing="ij")
        way = np.stack([np.ones_like(a), a, b], axis=-1)
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        block = (radius[:, None, None, None] * way).reshape(-1, 3)
        cells.append(np.column_stack(corner) + len(number.ravel()) * axis)
        points.append(np.roll(block, axis, axis=1))
    whole = np.concatenate(points)
    _, first, inverse = np.unique(np.round(whole / INNER, 9), axis=0, return_index=True, return_inverse=True)
    return whole[first], np.asarray(inverse).ravel()[np.concatenate(cells)]


def compute() -> Computed:
    """An octant of it."""
    points, cells = octant()
    near = 1e-6 * INNER
    mesh = from_arrays(
        MPI.COMM_SELF, points, cells, cell="hexahedron", degree=1,
        facet_groups={
            **{f"{name}_min": lambda x, k=k: abs(x[k]) < near for k, name in enumerate("xyz")},
            "inner": lambda x: np.linalg.norm(x, axis=0) < INNER + near,
        },
    )  # fmt: skip
    steel = j2_plasticity.Parameters(E=210e9, nu=0.3, rho=7800.0, yield_stress=0.24e9)
    body = NonlinearModel(mesh, j2_plasticity, steel, degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z"})
    force = load_vectors(body, [Pressure("p", "inner")])[:, 0]
    node = node_at(body, (OUTER, 0.0, 0.0))
    found = []

    def read(_: float) -> None:
        found.append(numbers(1e3 * body.displacement[body.displacement_dofs[node, 0]]))

    follow(body, list(TABLE), prescribed=held, load=lambda t: t * force, accepted=read)
    return Computed(tuple(found), mesh=f"3 x {AROUND} x {AROUND} x {THROUGH} bricks")
