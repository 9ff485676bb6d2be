"""Strain energy of degree four in the modal coordinates: its value, force, tangent stiffness and equilibria, in numpy.

For the reduction and for tests; machines have compiled kernels of the same polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from flexmbd.errors import ConvergenceError
from flexmbd.record.groups import FloatArray, IntArray

# Energy of the last Newton step over that of the state.
_CONVERGED = 1e-20
# Of the largest eigenvalue of the tangent stiffness: what is round-off.
_ROUND_OFF = 1e-14
_ITERATIONS = 200
_HALVINGS = 40


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
    def _terms(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        n = len(self.stiffness)
        return (monomials(n, 3), self.cubic), (monomials(n, 4), self.quartic)

    def first(self, count: int) -> StrainPolynomial:
        """That of the first coordinates, the others at zero."""
        terms = [coefficients[: len(monomials(count, index.shape[1]))] for index, coefficients in self._terms]
        return StrainPolynomial(self.stiffness[:count], *terms)

    def energy(self, q: FloatArray) -> float:
        """V, J, at q (n,)."""
        higher = sum(float(coefficients @ q[index].prod(axis=1)) for index, coefficients in self._terms)
        return 0.5 * float(self.stiffness @ q**2) + higher

    def force(self, q: FloatArray) -> FloatArray:
        """(n,) dV/dq."""
        total = self.stiffness * q
        for index, coefficients in self._terms:
            for i in range(index.shape[1]):
                others = np.delete(index, i, axis=1)
                total += np.bincount(index[:, i], coefficients * q[others].prod(axis=1), minlength=len(q))
        return total

    def tangent(self, q: FloatArray) -> FloatArray:
        """(n, n) second derivative of V."""
        n = len(q)
        total = np.diag(self.stiffness)
        for index, coefficients in self._terms:
            degree = index.shape[1]
            for i in range(degree):
                for j in range(i):
                    others = np.delete(index, [i, j], axis=1)
                    at = index[:, i] * n + index[:, j]
                    half = np.bincount(at, coefficients * q[others].prod(axis=1), minlength=n * n).reshape(n, n)
                    total += half + half.T
        return total

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
        free = np.eye(len(force)) if directions is None else directions
        for _ in range(_ITERATIONS):
            residual = self.force(q) - force
            step, stable = self._step(q, residual, free)
            decrease = -float(residual @ step)
            q = self._searched(q, step, force, decrease)
            if stable and decrease <= _CONVERGED * (self.energy(q) + abs(float(force @ q))):
                return q
        raise ConvergenceError("no stable equilibrium of the reduced body was found")

    def _step(self, q: FloatArray, residual: FloatArray, free: FloatArray) -> tuple[FloatArray, bool]:
        """Newton's step, of a stiffness made positive where it is not."""
        tangent = free.T @ self.tangent(q) @ free
        scale = 1.0 / np.sqrt(np.einsum("im,i,im->m", free, self.stiffness, free))
        values, vectors = scipy.linalg.eigh(tangent * np.outer(scale, scale))
        positive = np.maximum(np.abs(values), _ROUND_OFF * np.abs(values).max())
        step = -scale * (vectors @ ((vectors.T @ (scale * (free.T @ residual))) / positive))
        return free @ step, bool(values[0] > 0.0)

    def _searched(self, q: FloatArray, step: FloatArray, force: FloatArray, decrease: float) -> FloatArray:
        before, share = self.energy(q) - float(force @ q), 1.0
        for _ in range(_HALVINGS):
            after = q + share * step
            change = self.energy(after) - float(force @ after) - before
            # of terms that cancel, as the linear energy of a bent body's membrane does
            noise = _ROUND_OFF * (float(self.stiffness @ after**2) + abs(before))
            if change <= noise - 1e-4 * share * decrease:
                return after
            share *= 0.5
        return q + share * step
