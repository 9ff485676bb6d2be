"""A slender beam of solids, as far as it bends in one plane, unreduced and reduced."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear

LENGTH, WIDTH, HEIGHT = 1.0, 0.016, 0.01
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.0, rho=7800.0)


def slender_beam(comm=MPI.COMM_WORLD):
    """Forty bricks of degree 2 in a row, both ends rigid."""
    mesh = meshes.block(LENGTH, WIDTH, HEIGHT, divisions=(40, 1, 1), cell="hexahedron", comm=comm)
    ends = [Interface("x_min"), Interface("x_max")]
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ends)


class UnreducedBeam:
    """Frequencies of the unreduced beam with rigid ends, by scipy; collective to make."""

    def __init__(self, model):
        full = FullModel(model)
        ends = [(abs(full.x[:, 0] - one.p[0]) < 1e-9, one.p) for one in model.interfaces]
        self._t = full.bound(ends)
        self._k, self._m = self._t.T @ full.K @ self._t, self._t.T @ full.M @ self._t
        self._full = full

    def modes(self, count, *, clamped=()):
        """Lowest elastic eigenvalues, 1/s^2, and the share of the kinetic energy that goes along z.

        clamped: numbers of the ends.
        """
        keep = np.ones(self._k.shape[0], dtype=bool)
        for end in clamped:
            keep[6 * end : 6 * end + 6] = False
        k, m = self._k[keep][:, keep], self._m[keep][:, keep]
        rigid = 0 if clamped else 6
        values, vectors = scipy.sparse.linalg.eigsh(k, count + rigid, m, sigma=-1e4)
        order = np.argsort(values)[rigid:]
        # quotients, since the shift costs digits
        shapes = vectors[:, order]
        values = np.sum(shapes * (k @ shapes), axis=0) / np.sum(shapes * (m @ shapes), axis=0)
        u = self._t[:, keep] @ shapes
        lifted = u.copy()
        lifted[np.arange(len(u)) % 3 != 2] = 0.0
        share = np.sum(lifted * (self._full.M @ lifted), axis=0) / np.sum(u * (self._full.M @ u), axis=0)
        return values, share


def bending(body, *, clamped):
    """Frequencies, Hz, of a reduced beam that bends along z alone, free or with the frame's end clamped."""
    along = np.array([np.diag(body.gram)[4 + 3 * i : 7 + 3 * i] for i in range(body.n_modes)])
    bent = 6 + np.flatnonzero(along[:, 2] > 0.8 * along.sum(axis=1))
    coordinates = bent if clamped else np.concatenate([[2, 4], bent])
    k = np.diag(np.concatenate([np.zeros(6), body.stiffness]))[np.ix_(coordinates, coordinates)]
    m = body.mass_matrix()[np.ix_(coordinates, coordinates)]
    values = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(values[0 if clamped else 2 :]) / (2 * np.pi)
