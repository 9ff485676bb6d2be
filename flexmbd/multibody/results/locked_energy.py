"""How much strain energy of a body with nonlinear stiffness is locked under loads that it was not reduced for.

A body that bends shortens; without a shape that does so it stretches, and this energy grows with the fourth power of
the bending. Elastic forces f = dV/dq that are the work of loads give the linear displacement s = K^-1 f. To the fourth
degree the loads' complementary energy is s K s / 2 - V3(s) - Q(s), Q = V4(s) - dV3(s) K^-1 dV3(s) / 2: the membrane
energy of bending that no shape relieves. What Q has by the part of s under loads beside the compared ones is locked.
Loads along the axis may be beside them as well; they give small displacements s, so that they lock nothing.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.record.reduced_body import NonlinearStiffness, ReducedBody
from flexmbd.record.strain_polynomial import StrainPolynomial
from flexmbd.round_off import SQUARED

FloatArray = NDArray[np.float64]

# Looked at together: a megabyte or so of products of coordinates.
_ROWS = 256


class LockedEnergy:
    """The strain energy that a reduced body locks.

    Attributes:
        tolerance: of the relative error at the states at which the body was compared with its full model.
    """

    def __init__(self, record: ReducedBody, stiffness: NonlinearStiffness) -> None:
        """Of a record and its nonlinear stiffness."""
        self.tolerance = float(stiffness.tolerance[0])
        n, self._K = record.n_modes, record.stiffness
        self._cubic = StrainPolynomial(np.zeros(n), stiffness.cubic, np.zeros_like(stiffness.quartic))
        self._quartic = StrainPolynomial(np.zeros(n), np.zeros_like(stiffness.cubic), stiffness.quartic)
        root = np.sqrt(self._K)[:, None]
        compared = stiffness.compared / root
        faces = np.hstack([one.modes.T for one in record.interfaces]) / root
        units = compared / np.maximum(np.linalg.norm(compared, axis=0), np.finfo(float).tiny)
        known = scipy.linalg.orth(units, rcond=SQUARED)
        size = np.linalg.norm(faces, axis=0)
        faces = faces[:, size > 0.0] / size[size > 0.0]
        beside = scipy.linalg.orth(faces - known @ (known.T @ faces), rcond=SQUARED) if faces.size else faces
        #: (n, a) orthonormal, in coordinates whose strain energy is half their square: loads beside the compared ones.
        self._beside = beside / root

    def share(self, force: FloatArray, energy: FloatArray) -> FloatArray:
        """(k,) locked energy over the strain energy (k,), J, at elastic forces (k, n)."""
        share = np.zeros(len(force))
        beside = force @ self._beside
        # a body that is locked altogether lacks the energy of the linear displacement, and none lacks more
        most = 0.5 * np.sum(beside**2, axis=1)
        # a Taylor polynomial may be negative far from rest; of such a state no share can be told
        rows = np.flatnonzero((most > self.tolerance * energy) & (energy > 0.0))
        for i in range(0, len(rows), _ROWS):
            own = rows[i : i + _ROWS]
            aside = beside[own] @ self._beside.T
            rest = force[own] / self._K - aside
            locked = 0.5 * (self._unrelieved(rest + aside) + self._unrelieved(rest - aside)) - self._unrelieved(rest)
            share[own] = np.minimum(locked, most[own]) / energy[own]
        return share

    def _unrelieved(self, s: FloatArray) -> FloatArray:
        """Q (k,), J, of linear displacements (k, n)."""
        force = self._cubic.force(s)
        return np.asarray(self._quartic.energy(s) - 0.5 * np.sum(force**2 / self._K, axis=1))
