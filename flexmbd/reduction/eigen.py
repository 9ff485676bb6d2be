"""The lowest modes of K x = lambda M x by block Lanczos on K^-1 M.

Works on blocks throughout, because a factor solves many right-hand sides at once several times
faster than one by one, and because a block finds all copies of a multiple eigenvalue: a Krylov method
from a single start vector, SLEPc's Krylov-Schur for one, leaves copies out on symmetric parts without
a word.  The basis is kept orthonormal in full and never restarted.  (Golub & Underwood 1977; Grimes,
Lewis & Simon 1994, doi:10.1137/S0895479888151111.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from flexmbd.continuum.blocks import FloatArray, inner, multiply
from flexmbd.errors import ConvergenceError

#: Relative residual to which every mode converges.
TOLERANCE = 1e-12

# A direction that is this small after the projection is noise.
_NOISE = 1e-12
# Smallest eigenvalue of a scaled Gram matrix that is not noise.
_DEPENDENT = 1e-13


@dataclass(frozen=True, eq=False)
class Modes:
    """The lowest eigenpairs.

    Attributes:
        eigenvalues: (k,) ascending, 1/s^2.
        shapes: (owned rows, k) with shapes^T M shapes = 1, this rank's rows.
    """

    eigenvalues: FloatArray
    shapes: FloatArray


def lowest_modes(
    solve: Callable[[FloatArray], FloatArray],
    mass: PETSc.Mat,
    *,
    start: FloatArray,
    count: int,
    tolerance: float = TOLERANCE,
    limit: int | None = None,
) -> Modes:
    """The `count` lowest modes. Collective.

    Args:
        solve: K^-1 times a block, collective.
        mass: M, symmetric positive definite.
        start: (owned rows, b) start block; b is the largest multiplicity that is found for sure.
        count: at most the size of M.
        tolerance: relative residual of K^-1 M at which a mode has converged.
        limit: largest number of basis vectors; default: 10 count + 100.

    Raises:
        ConvergenceError: on all ranks: the limit was reached first.
    """
    if count == 0:
        return Modes(np.zeros(0), np.zeros((len(start), 0)))
    limit = min(10 * count + 100 if limit is None else limit, mass.getSize()[0])
    basis = _Basis(mass, len(start), limit)
    projected = np.zeros((limit, limit))
    fresh = solve(multiply(mass, start))
    last = steps = 0
    while True:
        size = basis.size
        block, image, onto, rest = basis.split(fresh)
        if size > 0:
            projected[:size, last:size] = onto
            projected[last:size, :size] = onto.T
            values, vectors = basis.eigh(projected[:size, :size])
            values, vectors = values[::-1], vectors[:, ::-1]
            residuals = np.linalg.norm(rest @ vectors[last:], axis=0) / abs(values)
            good = int(np.sum(residuals[:count] <= tolerance))
            if good == count:
                return Modes(np.reciprocal(values[:count]), basis.combine(vectors[:, :count]))
            if size + block.shape[1] > limit or block.shape[1] == 0:
                _fail(good, count=count, residuals=residuals, steps=steps, tolerance=tolerance)
        last = size
        steps += 1
        basis.append(block, image)
        fresh = solve(image)


class _Basis:
    """M-orthonormal vectors and their products with M."""

    def __init__(self, mass: PETSc.Mat, rows: int, limit: int) -> None:
        self.mass = mass
        self.comm = mass.comm.tompi4py()
        self.size = 0
        # the system gives memory to the columns that are written
        self._vectors = np.empty((rows, limit), order="F")
        self._images = np.empty((rows, limit), order="F")

    def append(self, block: FloatArray, image: FloatArray) -> None:
        columns = slice(self.size, self.size + block.shape[1])
        self._vectors[:, columns], self._images[:, columns] = block, image
        self.size = columns.stop

    def combine(self, coefficients: FloatArray) -> FloatArray:
        """The vectors times coefficients (size, k)."""
        return np.asfortranarray(self._vectors[:, : self.size] @ coefficients)

    def eigh(self, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rank 0's eigenpairs of a small matrix, so that all ranks take the same decisions."""
        pairs: tuple[FloatArray, FloatArray] = self.comm.bcast(tuple(np.linalg.eigh(matrix)))
        return pairs

    def split(self, block: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Split a block (n, b) into what the basis spans and orthonormal columns for the rest.

        Collective.

        Returns:
            q, M q, a, r with block = basis a + q r; q is (n, c), c <= b the rank of the rest.
        """
        vectors, images = self._vectors[:, : self.size], self._images[:, : self.size]
        onto = inner(self.comm, images, block)
        block = block - vectors @ onto
        image = multiply(self.mass, block)
        spanned = np.sum(onto**2, axis=0)
        block, image, rest = self._orthonormalise(block, image, spanned=spanned)
        # twice is enough (Giraud, Langou & Rozloznik 2005)
        part = inner(self.comm, images, block)
        block, image = block - vectors @ part, image - images @ part
        block, image, turn = self._orthonormalise(block, image, spanned=np.zeros(len(rest)))
        onto = onto + part @ rest
        return np.asfortranarray(block), np.asfortranarray(image), onto, turn @ rest

    def _orthonormalise(
        self, block: FloatArray, image: FloatArray, *, spanned: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Orthonormal columns q, M q, and r with block = q r but for noise. Collective.

        By the eigenvectors of the scaled Gram matrix (Stathopoulos & Wu 2002), which stand a block of
        deficient rank; `spanned` is the square of what was taken off each column before.
        """
        gram = inner(self.comm, block, image)
        squares = np.diag(gram)
        large = squares > _NOISE**2 * (squares + spanned)
        norms = np.sqrt(squares[large])
        values, vectors = self.eigh(gram[np.ix_(large, large)] / np.outer(norms, norms))
        kept = values > _DEPENDENT
        roots = np.sqrt(values[kept])
        forward = vectors[:, kept] / roots / norms[:, None]
        backward = np.zeros((len(roots), len(gram)))
        backward[:, large] = roots[:, None] * vectors[:, kept].T * norms
        return block[:, large] @ forward, image[:, large] @ forward, backward


def _fail(good: int, *, count: int, residuals: FloatArray, steps: int, tolerance: float) -> None:
    worst = float(residuals[:count].max())
    raise ConvergenceError(
        f"the eigensolver (block Lanczos) found {good} of {count} fixed-interface modes to a relative "
        f"residual of {tolerance:.0e} in {steps} steps and {len(residuals)} vectors; the worst is at "
        f"{worst:.1e}; ask for fewer modes"
    )
