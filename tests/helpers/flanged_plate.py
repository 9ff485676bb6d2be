"""A plate that is bolted at many places, each a patch of one cell on its lower face."""

from mpi4py import MPI

import numpy as np

from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.forms import solid_linear

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
PITCH, THICKNESS = 0.05, 0.012


def flanged_plate(rows, columns, *, comm=MPI.COMM_WORLD, degree=2):
    """Every second cell along x and y is a patch: `flange_1` to `flange_{rows * columns}`; row by row."""
    nx, ny = 2 * columns + 1, 2 * rows + 1
    grid = np.meshgrid(np.arange(2), np.arange(ny + 1), np.arange(nx + 1), indexing="ij")
    z, y, x = (part.reshape(-1) for part in grid)
    points = np.column_stack([x * PITCH, y * PITCH, z * THICKNESS]).astype(float)

    def number(i, j, k):
        return (k * (ny + 1) + j) * (nx + 1) + i

    corners = [(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    cells = [[number(i + a, j + b, c) for a, b, c in corners] for j in range(ny) for i in range(nx)]

    def patch(i, j):
        low = np.array([i, j]) * PITCH
        return lambda p: (abs(p[2]) < 1e-9) & (abs(p[:2].T - low - PITCH / 2) < 0.6 * PITCH).all(axis=1)

    groups = {
        f"flange_{r * columns + c + 1}": patch(2 * c + 1, 2 * r + 1) for r in range(rows) for c in range(columns)
    }
    mesh = from_arrays(comm, points, np.array(cells), cell="hexahedron", degree=1, facet_groups=groups)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=degree, interfaces=[Interface(name) for name in groups])
