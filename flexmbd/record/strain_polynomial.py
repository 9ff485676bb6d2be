"""Strain energy of degree four in the modal coordinates: its value, force, tangent stiffness and equilibria, in numpy.

For the reduction and for tests; machines have compiled kernels of the same polynomial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from flexmbd.continuation.line_search import ShareTrial, searched
from flexmbd.continuation.newton import Correction, newton
from flexmbd.errors import ConvergenceError
from flexmbd.record.groups import FloatArray, IntArray
from flexmbd.round_off import ROUND_OFF

# Root of the last Newton step's energy over that of the state's.
_CONVERGED = 1e-10
_ITERATIONS = 200
_TRIALS = 41
# Of the fall of energy that a step promises: what it is to keep of it.
_PROMISED = 1e-4


def monomials(n: int, degree: int) -> IntArray:
    """(count, degree) indices i >= j >= ... of the coefficients of one degree, in the record's order."""
    found = np.arange(n, dtype=np.int64)[:, None]
    for _ in range(degree - 1):
        # each row is followed by 0 .. its last index
        counts = found[:, -1] + 1
        starts = np.repeat(np.cumsum(counts) - counts, counts)
        last = np.arange(counts.sum()) - starts
        found = np.column_stack([np.repeat(found, counts, axis=0), last])
    return found


def places(indices: IntArray) -> IntArray:
    """(count,) where the coefficients of monomials stand, by their indices (count, 3 or 4) in any order."""
    i = -np.sort(-indices, axis=1)
    if i.shape[1] == 3:
        found = (i[:, 0] + 2) * (i[:, 0] + 1) * i[:, 0] // 6 + (i[:, 1] + 1) * i[:, 1] // 2 + i[:, 2]
        return np.asarray(found)
    outer = (i[:, 0] + 3) * (i[:, 0] + 2) * (i[:, 0] + 1) * i[:, 0] // 24
    return np.asarray(outer + places(i[:, 1:]))


@dataclass(frozen=True, eq=False)
class StrainPolynomial:
    """V = q^T K q / 2 + the sums of `NonlinearStiffness`.

    Attributes:
        stiffness: (n,) diagonal of K.
        cubic: as in `NonlinearStiffness`.
        quartic: likewise.
    """

    stiffness: FloatArray
    cubic: FloatArray
    quartic: FloatArray

    @cached_property
    def _pairs(self) -> IntArray:
        """(m, 2) of the products p = q_i q_j, i >= j."""
        return monomials(len(self.stiffness), 2)

    @cached_property
    def _by_pairs(self) -> tuple[FloatArray, FloatArray]:
        """L (n, m) and G (m, m), symmetric, with which V = q^T K q / 2 + q^T L p + p^T G p / 2."""
        n, m = len(self.stiffness), len(self._pairs)
        linear, square = np.zeros((n, m)), np.zeros((m, m))
        i, j, k = monomials(n, 3).T
        linear[i, j * (j + 1) // 2 + k] = self.cubic
        i, j, k, last = monomials(n, 4).T
        square[i * (i + 1) // 2 + j, k * (k + 1) // 2 + last] = self.quartic
        return linear, square + square.T

    def first(self, count: int) -> StrainPolynomial:
        """That of the first coordinates, the others at zero."""
        cubic, quartic = (len(monomials(count, degree)) for degree in (3, 4))
        return StrainPolynomial(self.stiffness[:count], self.cubic[:cubic], self.quartic[:quartic])

    def energy(self, q: FloatArray) -> FloatArray:
        """V (...), J, at q (..., n)."""
        linear, square = self._by_pairs
        p = q[..., self._pairs].prod(axis=-1)
        return np.asarray(0.5 * q**2 @ self.stiffness + np.sum(p * (q @ linear + 0.5 * p @ square), axis=-1))

    def force(self, q: FloatArray) -> FloatArray:
        """dV/dq (..., n) at q (..., n)."""
        (linear, square), (i, j) = self._by_pairs, self._pairs.T
        p = q[..., self._pairs].prod(axis=-1)
        by_pairs = q @ linear + p @ square
        slopes = np.zeros((*q.shape, q.shape[-1]))
        slopes[..., i, j] = by_pairs
        slopes[..., j, i] += by_pairs
        return np.asarray(self.stiffness * q + p @ linear.T + np.einsum("...ij,...j->...i", slopes, q))

    def tangent(self, q: FloatArray) -> FloatArray:
        """(n, n) second derivative of V."""
        (linear, square), slopes = self._by_pairs, self._slopes(q)
        once = linear @ slopes
        total = np.diag(self.stiffness) + once + once.T + slopes.T @ (square @ slopes)
        i, j = self._pairs.T
        # of the products themselves
        forces = linear.T @ q + square @ q[self._pairs].prod(axis=1)
        total[i, j] += forces
        total[j, i] += forces
        return total

    def _slopes(self, q: FloatArray) -> FloatArray:
        """(m, n) derivatives of the products."""
        i, j = self._pairs.T
        rows, slopes = np.arange(len(i)), np.zeros((len(i), len(q)))
        slopes[rows, i] += q[j]
        slopes[rows, j] += q[i]
        return slopes

    def equilibrium(
        self, force: FloatArray, *, start: FloatArray | None = None, directions: FloatArray | None = None
    ) -> FloatArray:
        """A stable equilibrium by Newton's method, with a search along its lines for less potential energy.

        Args:
            force: (n,) constant.
            start: (n,) coordinates to begin from; default: zero.
            directions: (n, m) orthonormal, along which the coordinates may change from there; default: all.

        Returns:
            (n,) coordinates.

        Raises:
            ConvergenceError: there is none that the search finds.
        """
        q = np.zeros(len(force)) if start is None else np.array(start)
        problem = _LoadedPolynomial(self, force, np.eye(len(force)) if directions is None else directions)
        found = newton(problem, q, most=_ITERATIONS, close=_CONVERGED)
        if not found.is_solution:
            raise ConvergenceError("no stable equilibrium of the reduced body was found")
        return found.place


@dataclass(frozen=True, eq=False)
class _LoadedPolynomial:
    """Its equilibrium under a constant force (n,) as a problem for Newton's method, along free directions (n, m)."""

    polynomial: StrainPolynomial
    force: FloatArray
    free: FloatArray

    def is_solved(self, here: FloatArray, *, close: bool) -> bool:
        return close

    def correction(self, here: FloatArray) -> Correction[FloatArray]:
        """Newton's step, of a stiffness made positive where it is not; its size is the root of its energy."""
        residual = self.polynomial.force(here) - self.force
        step, stable = self._step(here, residual)
        scale = float(self.polynomial.energy(here)) + abs(float(self.force @ here))
        return Correction(step, math.sqrt(max(-float(residual @ step), 0.0)), scale=math.sqrt(scale), ends=stable)

    def _step(self, here: FloatArray, residual: FloatArray) -> tuple[FloatArray, bool]:
        """A step downhill (n,), and whether the stiffness is positive."""
        free, stiffness = self.free, self.polynomial.stiffness
        tangent = free.T @ self.polynomial.tangent(here) @ free
        scale = 1.0 / np.sqrt(np.einsum("im,i,im->m", free, stiffness, free))
        values, vectors = scipy.linalg.eigh(tangent * np.outer(scale, scale))
        positive = np.maximum(np.abs(values), ROUND_OFF * np.abs(values).max())
        step = -scale * (vectors @ ((vectors.T @ (scale * (free.T @ residual))) / positive))
        return free @ step, bool(values[0] > 0.0)

    def moved(self, here: FloatArray, correction: Correction[FloatArray], *, close: bool) -> FloatArray:
        """Less of the step until the potential energy falls as much as the step promises (Armijo)."""
        step, decrease, body = correction.change, correction.size**2, self.polynomial
        before = float(body.energy(here) - self.force @ here)

        def trial(share: float) -> ShareTrial[FloatArray]:
            after = here + share * step
            change = float(body.energy(after) - self.force @ after) - before
            # of terms that cancel, as the linear energy of a bent body's membrane does
            noise = ROUND_OFF * (float(body.stiffness @ after**2) + abs(before))
            return ShareTrial(after, share, change - noise + _PROMISED * share * decrease)

        return searched(trial, most=_TRIALS).place
