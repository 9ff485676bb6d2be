"""A clamped strip of bricks in plane strain whose free end is a rigid frame with a moment on it."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse
from scipy.integrate import solve_bvp
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq

from flexmbd import meshes
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.slow_loading.static_path import prescribed_dofs

LENGTH, E = 10.0, 1e6


class Strip:
    """n cells of degree 2 along x, in layers; Poisson's ratio is zero, so that plane strain is plane stress.

    The unknowns are the free nodes and the end frame's displacement along x and y and its angle.
    """

    def __init__(self, n: int, form: ModuleType, *, height: float, layers: int = 1, **more: Any) -> None:
        degree = 2 if form.REFERENCE == "UPDATED" else 1
        mesh = meshes.block(LENGTH, height, 0.1, divisions=(n, layers, 1), degree=degree, comm=MPI.COMM_SELF)
        self.body = NonlinearModel(mesh, form, form.Parameters(E=E, nu=0.0, rho=1.0, **more), degree=2)
        self.stiffness = E * 0.1 * height**3 / 12
        self.x = self.body.layout.node_x.copy()
        dofs = self.body.displacement_dofs
        end = self.body.layout.nodes_on(2, mesh.facets("x_max"))
        self._arm, self._end = self.x[end, :2] - [LENGTH, 0.0], dofs[end, :2]
        held = np.union1d(prescribed_dofs(self.body, {"x_min": "xy"}), dofs[:, 2])
        self._free = np.setdiff1d(np.arange(self.body.n_owned), np.union1d(held, self._end))
        self.frame = np.zeros(3)

    def guess(self, coarse: Strip) -> np.ndarray:
        """The shape of a strip with fewer cells, as an increment from rest."""
        x, u = coarse.x.round(9), coarse.body.displacement.reshape(-1, 3)
        start = np.zeros_like(self.x)
        (places, along), (levels, up) = (np.unique(x[:, axis], return_inverse=True) for axis in (0, 1))
        for axis in (0, 1):
            values = np.empty((len(places), len(levels)))
            values[along, up] = u[:, axis]
            spline = RectBivariateSpline(places, levels, values, ky=2)
            start[:, axis] = spline(self.x[:, 0], self.x[:, 1], grid=False)
        self.frame = coarse.frame.copy()
        return start.ravel()

    def bend(self, moment: float, start: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """Equilibrium with a moment on the end frame, N m; it is accepted, and its increment returned."""
        body, end, increment, n = self.body, self._end, start.copy(), len(self._free)
        for _ in range(40):
            c, s = np.cos(frame[2]), np.sin(frame[2])
            turned, once, twice = (self._arm @ np.array(m).T for m in (
                [[c - 1, -s], [s, c - 1]], [[-s, -c], [c, -s]], [[-c, s], [-s, -c]],
            ))
            increment[end] = frame[:2] + turned - body.displacement[end]
            force = body.force(increment)
            lack = np.concatenate([force[self._free], force[end].sum(axis=0), [(force[end] * once).sum() - moment]])
            if np.linalg.norm(lack) < 1e-9 * np.linalg.norm(force[end]):
                body.commit(increment)
                self.frame = frame
                return increment
            rows = np.concatenate([self._free, *end.T, *end.T])
            columns = np.concatenate([np.arange(n), n + np.repeat([0, 1, 2, 2], len(end))])
            values = np.concatenate([np.ones(n + 2 * len(end)), *once.T])
            moves = scipy.sparse.csr_matrix((values, (rows, columns)), shape=(body.n_owned, n + 3))
            begin, across, entries = body.tangent(increment).getValuesCSR()
            matrix = (moves.T @ scipy.sparse.csr_matrix((entries, across, begin)) @ moves).tolil()
            matrix[n + 2, n + 2] += (force[end] * twice).sum()
            change = scipy.sparse.linalg.spsolve(matrix.tocsc(), -lack)
            increment[self._free] += change[:n]
            frame = frame + change[n:]
        raise AssertionError(f"no equilibrium with a moment of {moment} N m")

    def roll(self, moment: float, *, steps: int) -> None:
        """From rest, by equal steps of the moment."""
        last, turn = np.zeros(self.body.layout.n_local), np.zeros(3)
        for k in range(1, steps + 1):
            before = self.frame
            last = self.bend(k * moment / steps, last, before + turn)
            turn = self.frame - before

    @property
    def tip(self) -> np.ndarray:
        """Of the end frame's origin, m."""
        return np.asarray(self.frame[:2] + np.array([LENGTH, 0.0]))


def flexure(moment: float, *, height: float, stress: Any, slope: Any) -> tuple[float, float]:
    """Curvature, 1/m, and stretch of the middle, of a strip of unit width bent to a circle by moments alone.

    A section at the height Y goes to the radius r(Y). With principal stretches kappa r and r', and an energy w(kappa r)
    + w(r') whose derivative is `stress`, equilibrium is (w'(r'))' = kappa w'(kappa r), without stress at the faces.
    """

    def shape(kappa: float) -> Any:
        begin = np.linspace(-height / 2, height / 2, 41)
        return solve_bvp(
            lambda _, r: np.vstack([r[1], kappa * stress(kappa * r[0]) / slope(r[1])]),
            lambda a, b: np.array([stress(a[1]), stress(b[1])]),
            begin, np.vstack([1 / kappa + begin, np.ones_like(begin)]), tol=1e-10,
        ).sol

    def lack(kappa: float) -> float:
        points, weights = np.polynomial.legendre.leggauss(20)
        r = shape(kappa)(points * height / 2)[0]
        return float(height / 2 * (weights * stress(kappa * r) * r).sum() - moment)

    straight = 12 * moment / (slope(1.0) * height**3)
    kappa = float(brentq(lack, 0.9 * straight, 1.2 * straight))
    return kappa, kappa * float(shape(kappa)(0.0)[0])
