"""Solid cylinder, taper and sphere that are heated (NAFEMS LE11).

A quarter of a solid of revolution: inside a sphere of 1 m up to 45 degrees and a cylinder above it, outside a sphere
of 1.4 m up to 30 degrees, a taper to 1 m at the height 1.39 m and a cylinder; 1.79 m high, held along its axis below
and on top, heated by r + z kelvin. E = 210 GPa, nu = 0.3, alpha = 2.3e-4 / K: stress along the axis at A, on the inner
sphere below.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Heating, NonlinearModel, follow, prescribed_dofs
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.forms import solid_linear, st_venant_kirchhoff
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("NAFEMS, The Standard NAFEMS Benchmarks, TNSB Rev. 3, 1990, test LE11")
REFERENCES = (Reference("stress zz at A", "MPa", (-105.0,), 1e-2, Sureness.SECONDARY),)

#: Between inner and outer face: corners (r, z) m of the profile above the spheres.
_INNER = np.array([[0.5**0.5, 0.5**0.5], [0.5**0.5, 0.5 * (0.5**0.5 + 1.79)], [0.5**0.5, 1.79]])
_OUTER = np.array([[1.4 * np.cos(np.pi / 6), 0.7], [1.1062, 1.045], [1.0, 1.39], [1.0, 1.79]])


def profile(s: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) m, r and z at the shares s from inside out and t from below, of four parts of equal share."""
    part, inner, outer = 4.0 * t, np.empty((len(t), 2)), np.empty((len(t), 2))
    angle = np.deg2rad(22.5) * np.minimum(part, 2.0)
    inner[:] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    angle = np.deg2rad(30.0) * np.minimum(part, 1.0)
    outer[:] = 1.4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for face, corners, first in ((inner, _INNER, 2.0), (outer, _OUTER, 1.0)):
        knots = first + np.arange(len(corners))
        above = part > first
        for i in (0, 1):
            face[above, i] = np.interp(part[above], knots, corners[:, i])
    return np.asarray(inner + s[:, None] * (outer - inner))


def stress(divisions: tuple[int, int, int]) -> float:
    """MPa, by curved quadratic bricks."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=divisions, degree=2, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    across = x[:, 0] - x[:, 0].min()
    r, z = profile(across * (0.4 + 0.6 * across), x[:, 2] - x[:, 2].min()).T  # finer inside
    angle = 0.5 * np.pi * (x[:, 1] - x[:, 1].min())
    x[:] = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    metal = solid_linear.Parameters(E=210e9, nu=0.3, rho=7800.0, alpha=2.3e-4)
    body = NonlinearModel(mesh, st_venant_kirchhoff, metal, degree=2, heated=True)
    held = prescribed_dofs(body, {"y_min": "y", "y_max": "x", "z_min": "z", "z_max": "z"})
    heat = Heating(lambda x: np.hypot(x[:, 0], x[:, 1]) + x[:, 2], lambda t: t)
    follow(body, [1.0], prescribed=held, loads=[heat])
    recovery = StressRecovery(ContinuumModel(mesh, solid_linear, metal, degree=2))
    at = int(np.argmin(np.linalg.norm(recovery.x - (1.0, 0.0, 0.0), axis=1)))
    expansion = metal.E * metal.alpha * 1.0 / (1.0 - 2.0 * metal.nu)  # of one kelvin, held
    return 1e-6 * float(recovery.nodal(body.displacement)[at, 2, 2] - expansion)


def compute() -> Computed:
    """One grid of the quarter."""
    return Computed((numbers(stress((4, 3, 24))),), mesh="4 x 3 x 24 quadratic bricks")

