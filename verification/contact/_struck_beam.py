"""A steel ball that strikes the middle of a steel beam: the beam's mesh, its record, and the unreduced answer.

The unreduced beam goes by central differences of all of its nodes, with lumped masses. The ball's force is even over
one contact patch, and the dent under the ball is Hertz', in the place of what a half space gives under such a patch.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

from mpi4py import MPI

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, Patch, craig_bampton

E, NU, RHO = 2.1e11, 0.3, 7850.0
SIZES = (0.15, 0.015, 0.01)  # m
BALL = 0.01  # m, radius
MASS = 4.0 / 3.0 * np.pi * BALL**3 * RHO
SPEED = 0.3  # m/s
PLANE = E / (1.0 - NU**2)
#: How many patches would cover the top along x and y, nearly square.
ROWS = (31, 3)
PATCH = float(np.sqrt(SIZES[0] / ROWS[0] * SIZES[1] / ROWS[1])) * 1.0001  # m
HERTZ = 4.0 / 3.0 * 0.5 * PLANE * BALL**0.5  # N/m^1.5, ball and beam of one steel
#: Of a square of side 1 on a half space: mean displacement of an even load, times the modulus over the force.
SQUARE = (4.0 * np.log(1.0 + 2.0**0.5) - 4.0 / 3.0 * (2.0**0.5 - 1.0)) / np.pi


@dataclass(frozen=True)
class Struck:
    """Force over time (s, N), the ball's speed away from the beam afterwards (m/s), steps and their processor time."""

    t: np.ndarray
    force: np.ndarray
    rebound: float
    steps: int
    seconds: float

    @property
    def impulse(self) -> float:
        """N s."""
        return float(np.trapezoid(self.force, self.t))


@dataclass(frozen=True)
class Beam:
    """Along x about its middle; the ball strikes the middle of z = max.

    Attributes:
        clamped: at its ends, or free.
        fine: how many cells a patch has along each of its sides.
        deep: how many cells lie through the beam.
    """

    clamped: bool
    fine: int = 1
    deep: int = 2


@cache
def model(beam: Beam) -> ContinuumModel:
    """The mesh's, of bricks of degree 2."""
    divisions = (ROWS[0] * beam.fine, ROWS[1] * beam.fine, beam.deep)
    mesh = meshes.block(*SIZES, divisions=divisions, comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max")] if beam.clamped else []
    steel = solid_linear.Parameters(E=E, nu=NU, rho=RHO)
    return ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)


def record(beam: Beam, modes: int) -> fm.ReducedBody:
    """With three by three patches on the top, near the middle."""
    low, high = (end(model(beam).node_x, axis=0) for end in (np.min, np.max))
    middle, top, near = 0.5 * (low[0] + high[0]), high[2] - 1e-9, 1.51 * SIZES[0] / ROWS[0]
    spot = Patch("top", size=PATCH, facets=lambda x: (x[2] > top) & (abs(x[0] - middle) < near))
    frame = "x_min" if beam.clamped else None
    return craig_bampton(
        model(beam), modes=modes, frame=frame, geometric_stiffness=False, contact=[spot], keep=Keep(modes=True)
    )


def unreduced(beam: Beam, *, end: float) -> Struck:
    """Central differences of all nodes."""
    body = model(beam)
    pointers, columns, values = body.K.getValuesCSR()
    size, x = body.K.getSize()[0], body.node_x
    K = scipy.sparse.csr_array((values, columns, pointers), (size, size))
    pointers, columns, values = body.M.getValuesCSR()
    mass = np.asarray(scipy.sparse.csr_array((values, columns, pointers), (size, size)).sum(axis=1)).ravel()
    spot, free = _spot(x, beam.fine), np.ones(size)
    if beam.clamped:
        ends = (x[:, 0] < x[:, 0].min() + 1e-9) | (x[:, 0] > x[:, 0].max() - 1e-9)
        free = np.repeat(~ends, 3).astype(float)
    highest = scipy.sparse.linalg.eigsh(
        scipy.sparse.diags_array(mass**-0.5) @ K @ scipy.sparse.diags_array(mass**-0.5), 1, return_eigenvectors=False,
        tol=1e-2,
    )[0]  # fmt: skip
    h = 0.9 * 2.0 / np.sqrt(highest)
    u, v, place, speed = np.zeros(size), np.zeros(size), 0.0, SPEED
    own = SQUARE / (PATCH * PLANE)  # m/N, of the patch on a half space
    times, forces, began = [], [], time.process_time()
    for step in range(int(np.ceil(end / h))):
        force = _force(place + u @ spot, own)  # the ball comes along -z
        times.append(step * h)
        forces.append(force)
        v += h * free * (-force * spot - K @ u) / mass
        speed -= h * force / MASS
        u += h * v
        place += h * speed
    return Struck(np.array(times), np.array(forces), -speed, len(times), time.process_time() - began)


def _spot(x: np.ndarray, fine: int) -> np.ndarray:
    """(3 n,) nodal shares of an even load along z on the patch in the middle of the top: Simpson's rule."""
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    half = np.array([SIZES[0] / ROWS[0], SIZES[1] / ROWS[1]]) / 2.0
    away = (x[:, :2] - middle[:2]) / half
    on = (x[:, 2] > x[:, 2].max() - 1e-9) & (abs(away) < 1.0 + 1e-6).all(axis=1)
    rule = np.zeros(2 * fine + 1)
    for cell in range(fine):
        rule[2 * cell : 2 * cell + 3] += np.array([1.0, 4.0, 1.0]) / (6.0 * fine)
    along = np.rint((away[on] + 1.0) * fine).astype(int)
    shares = np.zeros((len(x), 3))
    shares[on, 2] = rule[along].prod(axis=1)
    return shares.ravel()


def _force(approach: float, own: float) -> float:
    """N, at which the dent of Hertz less that of the patch is the approach (m)."""
    if approach <= 0.0:
        return 0.0
    most = HERTZ * (4.0 * approach) ** 1.5 + approach / own
    return float(brentq(lambda f: (f / HERTZ) ** (2.0 / 3.0) - own * f - approach, 0.0, most, xtol=1e-9, rtol=1e-12))
