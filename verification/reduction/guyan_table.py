"""Guyan's frequencies of a cantilever.

A beam of Euler and Bernoulli is reduced by static shapes alone to m frames, equally far apart, whose rotations are
condensed in the same way: relative errors of the lowest frequencies against the mesh's, which fall with m. What acts on
the frames is exact whatever m is: a force at the tip moves it by P L^3 / 3 EI.
"""

from __future__ import annotations

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import scipy.linalg

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton, guyan
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Guyan 1965, AIAA Journal 3; errors by 40 elements of Hermite", "10.2514/3.2874")
TABLE = {
    1: (1.465e-2,), 2: (1.695e-3, 1.110e-2), 4: (7.603e-5, 2.729e-3, 2.063e-2, 2.186e-2),
    8: (3.515e-6, 1.341e-4, 1.076e-3, 4.446e-3, 1.350e-2), 20: (6.73e-8, 2.55e-6, 2.01e-5, 7.83e-5, 2.19e-4),
}  # fmt: skip
REFERENCES = (
    *(Reference(f"{m} masters: errors", "", row, 1e-2, Sureness.OWN) for m, row in TABLE.items()),
    Reference("force at the tip, 1 master: way over P L^3 / 3 EI", "", (1.0,), 2e-5, Sureness.PRIMARY),
)
BEND = 1e-7


def cantilever(masters: int) -> ContinuumModel:
    """Of unit length, 40 elements, soft in one plane."""
    section = beam_timoshenko.Parameters(
        E=1.0, nu=0.0, rho=1.0, A=1.0, Iy=BEND, Iz=10.0, J=10.0, ky=1.0, kz=1.0, orientation=(0.0, 1.0, 0.0)
    )
    names = [f"p{k}" for k in range(masters + 1)]
    points = {name: (k / masters, 0.0, 0.0) for k, name in enumerate(names)}
    beams = {"beam": list(pairwise(names))}
    mesh = meshes.frame(points, beams, divisions=40 // masters, comm=MPI.COMM_SELF)
    return ContinuumModel(mesh, beam_timoshenko, section, degree=2, interfaces=[Interface(name) for name in names])


def condensed(masters: int) -> tuple[np.ndarray, float]:
    """rad/s of the beam by its frames' ways across alone; and the tip's way under a unit force."""
    record = guyan(cantilever(masters), frame="p0", geometric_stiffness=False)
    by_modes = np.vstack([record.interface(f"p{k}").modes for k in range(1, masters + 1)])
    modes = np.linalg.inv(by_modes)
    stiffness, mass = modes.T @ (record.stiffness[:, None] * modes), modes.T @ modes
    across, turns = np.arange(2, 6 * masters, 6), np.arange(4, 6 * masters, 6)
    shape = np.zeros((6 * masters, masters))
    shape[across] = np.eye(masters)
    shape[turns] = -np.linalg.solve(stiffness[np.ix_(turns, turns)], stiffness[np.ix_(turns, across)])
    k, m = shape.T @ stiffness @ shape, shape.T @ mass @ shape
    return np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)), float(np.linalg.inv(k)[-1, -1])


def compute() -> Computed:
    """Against the mesh with all of its modes."""
    record = craig_bampton(cantilever(4), modes=60, frame="p0", geometric_stiffness=False)
    whole = 2.0 * np.pi * record.frequencies(["p0"])
    found = {m: condensed(m) for m in TABLE}
    values = [numbers(found[m][0][: len(row)] / whole[: len(row)] - 1.0) for m, row in TABLE.items()]
    return Computed((*values, numbers(found[1][1] * 3.0 * BEND)), mesh="40 quadratic beam elements")
