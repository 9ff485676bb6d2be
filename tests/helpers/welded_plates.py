"""Plates that are welded, along a seam, to a tee and at spots; and such a plate in one piece."""

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import Interface, NonlinearModel, Weld
from flexmbd.forms import solid_linear, solid_shell, st_venant_kirchhoff

E, NU, RHO = 2.1e9, 0.3, 7850.0
SOFT = st_venant_kirchhoff.Parameters(E, NU, RHO)
SHELL = solid_shell.Parameters(E, NU, RHO)
STEEL = solid_linear.Parameters(E, NU, RHO)
LENGTH, WIDTH, DEPTH = 0.2, 0.1, 0.02


def plate(length=LENGTH, *, divisions=(4, 2), p=(0.0, 0.0, 0.0), R=None, thickness=DEPTH, comm=MPI.COMM_WORLD):
    sheet = meshes.sheet(length, WIDTH, divisions=divisions, comm=comm)
    return meshes.placed(meshes.wall(sheet, thickness), p=p, R=R)


def halves(first=(4, 2), second=(4, 2), **told):
    one = plate(divisions=first, **told)
    return meshes.join({"a": one, "b": plate(divisions=second, p=(LENGTH, 0.0, 0.0), **told)})


SEAM = [Weld("b.x_min", "a.x_max")]


def butted(**told):
    """A plate of two halves that are welded, and the same in one piece; the names of root, end and the top."""
    return (
        (halves(**told), SEAM, ("a.x_min", "b.x_max")),
        (plate(2 * LENGTH, divisions=(8, 2), **told), [], ("x_min", "x_max")),
    )


def tee(gap=0.0):
    """A web on two flanges that are welded with a gap between them; meshes unlike each other."""
    turned = Rotation.from_euler("y", -90, degrees=True).as_matrix()
    web = plate(0.05, divisions=(2, 5), p=(0.1, 0.0, DEPTH / 2 + gap), R=turned)
    return (
        meshes.join({"a": plate(divisions=(5, 4)), "b": plate(divisions=(4, 3), p=(LENGTH + gap, 0.0, 0.0)), "w": web}),
        [Weld("a.x_max", "b.x_min"), Weld("w.x_min", "a.top")],
    )


def grid_of(cells, size):
    """Points and bricks of a set of cells (i, j, k) of a regular grid with the edges ``size`` (3,)."""
    corners = np.array([(a, b, c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    every = (np.array(sorted(cells))[:, None] + corners).reshape(-1, 3)
    points, rows = np.unique(every, axis=0, return_inverse=True)
    return points * size, rows.reshape(-1, 8)


def strap(**told):
    """Two sheets that overlap by half of their length, 1 mm apart, on spots or all over."""
    thickness = 2e-3
    low = plate(divisions=(12, 8), thickness=thickness)
    high = plate(divisions=(10, 6), p=(LENGTH / 2, 0.0, thickness + 1e-3), thickness=thickness)
    return NonlinearModel(
        meshes.join({"low": low, "high": high}), solid_shell, SHELL, degree=1,
        welds=[Weld("high.bottom", "low.top", within=0.5, **told)],
        interfaces=[Interface("low.x_min"), Interface("high.x_max")],
    )  # fmt: skip


SPOTS = [(0.125, -0.03, 1e-3), (0.125, 0.03, 1e-3), (0.18, 0.0, 1e-3)]


def made(mesh, welds, kind=NonlinearModel, **told):
    return kind(mesh, solid_shell, SHELL, degree=1, welds=welds, **told)
