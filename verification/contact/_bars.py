"""Bars that strain along themselves alone, with a contact patch on one end."""

from __future__ import annotations

from mpi4py import MPI

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, SymmetryPlane
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, Patch, craig_bampton

#: m; N, of EA with 1 kg/m, so that waves go at 30 m/s; m, so slender that no mode is one of the section.
LENGTH, STIFFNESS, SIDE = 10.0, 900.0, 0.1


def bar(modes: int, end: str) -> fm.ReducedBody:
    """Along x, with patches on "x_min" or "x_max", the body frame on the other end."""
    mesh = meshes.block(LENGTH, SIDE, SIDE, divisions=(200, 1, 1), comm=MPI.COMM_SELF)
    sides = {"y_min": (0, 1, 0), "y_max": (0, 1, 0), "z_min": (0, 0, 1), "z_max": (0, 0, 1)}
    other = "x_max" if end == "x_min" else "x_min"
    model = ContinuumModel(
        mesh, solid_linear, solid_linear.Parameters(E=STIFFNESS / SIDE**2, nu=0.0, rho=1.0 / SIDE**2), degree=2,
        interfaces=[Interface(other)], supports=[SymmetryPlane(name, along) for name, along in sides.items()],
    )  # fmt: skip
    touched = Patch("end", size=SIDE, facets=end)
    return craig_bampton(
        model, modes=modes, frame=other, geometric_stiffness=False, contact=[touched], keep=Keep(modes=True)
    )
