"""An M-orthonormal basis for block Lanczos: vectors spread over ranks, appended and orthogonalised block by block."""

from __future__ import annotations

from collections.abc import Iterator

from petsc4py import PETSc

import numpy as np
from scipy.linalg.blas import dgemm

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, total
from flexmbd.round_off import EQUAL, SQUARED, WORTHLESS_PIVOT

# Where a fresh direction, of which all is new in a large space, is this small, there is no more space.
_NOISE_OF_FRESH = SQUARED
# A column is projected again if this part of its square was along the basis; no more often than so.
_LEFT, _PASSES = 1e-4, 3
# Columns of the basis that are stored together.
_PANEL = 128


class LanczosBasis:
    """M-orthonormal vectors, of which each rank holds its rows."""

    def __init__(self, mass: PETSc.Mat, rows: int) -> None:
        self.mass = mass
        self.comm = mass.comm.tompi4py()
        self.size = 0
        self._rows = rows
        self._panels: list[FloatArray] = []
        # of the last two blocks: their place, vectors, and images under M
        self._recent: list[tuple[slice, FloatArray, FloatArray]] = []

    def append(self, block: FloatArray, image: FloatArray) -> None:
        """Add a block that is orthonormal, also to the others; `image` is M times it."""
        end = self.size + block.shape[1]
        self._recent = [*self._recent[-1:], (slice(self.size, end), block, image)]
        done = 0
        while done < block.shape[1]:
            place = (self.size + done) % _PANEL
            if place == 0:
                self._panels.append(np.empty((self._rows, _PANEL), order="F"))
            some = min(block.shape[1] - done, _PANEL - place)
            self._panels[-1][:, place : place + some] = block[:, done : done + some]
            done += some
        self.size = end

    def combine(self, coefficients: FloatArray) -> FloatArray:
        """The first vectors times coefficients (number of them, k); not collective."""
        result: FloatArray = np.zeros((self._rows, coefficients.shape[1]), order="F")
        for place, panel in self._filled(len(coefficients)):
            result = _plus_product(result, panel, coefficients[place])
        return result

    def term_sizes(self, coefficients: FloatArray) -> FloatArray:
        """Sums of the sizes of the terms of `combine`, of which its round-off is a share; not collective."""
        result: FloatArray = np.zeros((self._rows, coefficients.shape[1]), order="F")
        for place, panel in self._filled(len(coefficients)):
            result = _plus_product(result, np.asfortranarray(abs(panel)), abs(coefficients[place]))
        return result

    def products(self, block: FloatArray) -> FloatArray:
        """Block^T times the vectors, (columns, size). Collective."""
        local: FloatArray = np.zeros((block.shape[1], self.size))
        for place, panel in self._filled(self.size):
            local[:, place] = block.T @ panel
        return total(self.comm, local)

    def split(
        self, block: FloatArray, *, noise: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Split K^-1 M times the last block into what the basis spans and the rest. Collective.

        Args:
            block: (n, b).
            noise: size of a rest that is round-off.

        Returns:
            q, M q, a, r with block = basis a + q r; q is (n, c), c <= b the rank of the rest.
        """
        image = multiply(self.mass, block)
        onto: FloatArray = np.zeros((self.size, block.shape[1]))
        for place, vectors, images in self._recent:
            onto[place] = inner(self.comm, vectors, image)
            block = _plus_product(block, vectors, -onto[place])
            image = _plus_product(image, images, -onto[place])
        taken = np.sum(onto**2, axis=0)
        block, image, rest = self._orthonormalise(block, image, taken=taken, noise=noise)
        # in exact arithmetic that was all; what round-off leaves of the other vectors would grow
        weakest = np.sum(rest**2, axis=1).min(initial=np.inf)
        again = bool(weakest < SQUARED * taken.max(initial=0.0))
        for _ in range(_PASSES):
            part, block = self._project(block, image)
            image = multiply(self.mass, block)
            block, image, turn = self._orthonormalise(block, image, taken=np.sum(part**2, axis=0))
            onto, rest = onto + part @ rest, turn @ rest
            if not self.comm.bcast(again or np.any(np.sum(part**2, axis=0) > _LEFT)):
                break
            again = False
        kept = self.comm.bcast(np.linalg.norm(rest, axis=1) > noise)
        if not kept.all():
            block, image, rest = block[:, kept], image[:, kept], rest[kept]
        return block, image, onto, rest

    def beside(
        self, block: FloatArray, image: FloatArray, fresh: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """A block and its image, widened by what is new in fresh directions. Collective."""
        images = multiply(self.mass, fresh)
        taken = np.diag(inner(self.comm, fresh, images))
        # twice is enough (Giraud, Langou & Rozloznik 2005)
        for _ in range(2):
            _, fresh = self._project(fresh, images)
            fresh = _plus_product(fresh, block, -inner(self.comm, image, fresh))
            images = multiply(self.mass, fresh)
            noise = _NOISE_OF_FRESH * float(np.sqrt(taken.max(initial=0.0)))
            fresh, images, _ = self._orthonormalise(fresh, images, taken=taken, noise=noise)
            taken = np.zeros(fresh.shape[1])
        return np.hstack([block, fresh]), np.hstack([image, images])

    def _filled(self, size: int) -> Iterator[tuple[slice, FloatArray]]:
        """The first vectors, panel by panel, and their places."""
        for first in range(0, size, _PANEL):
            place = slice(first, min(first + _PANEL, size))
            yield place, self._panels[first // _PANEL][:, : place.stop - first]

    def _project(self, block: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the basis spans of a block, as coefficients, and the rest. Collective."""
        onto = self.products(image).T
        for place, panel in self._filled(self.size):
            block = _plus_product(block, panel, -onto[place])
        return onto, block

    def _orthonormalise(
        self, block: FloatArray, image: FloatArray, *, taken: FloatArray, noise: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Orthonormal columns q, M q, and r with block = q r but for noise. Collective.

        By the eigenvectors of the scaled Gram matrix (Stathopoulos & Wu 2002), which stand a block of
        deficient rank; `taken` is the square of what was taken off each column before.
        """
        gram = inner(self.comm, block, image)

        def factor() -> tuple[FloatArray, FloatArray]:
            squares = np.diag(gram)
            large = squares > np.maximum(EQUAL**2 * (squares + taken), noise**2)
            norms = np.sqrt(squares[large])
            values, vectors = np.linalg.eigh(gram[np.ix_(large, large)] / np.outer(norms, norms))
            kept = values > WORTHLESS_PIVOT
            roots = np.sqrt(values[kept])
            forward = np.zeros((len(gram), len(roots)))
            forward[large] = vectors[:, kept] / roots / norms[:, None]
            backward = np.zeros((len(roots), len(gram)))
            backward[:, large] = roots[:, None] * vectors[:, kept].T * norms
            return forward, backward

        forward, backward = self.comm.bcast(factor())
        return _product(block, forward), _product(image, forward), backward


def _product(block: FloatArray, factor: FloatArray) -> FloatArray:
    if 0 in (*block.shape, *factor.shape):
        return np.zeros((len(block), factor.shape[1]), order="F")
    product: FloatArray = dgemm(1.0, block, factor)
    return product


def _plus_product(result: FloatArray, block: FloatArray, factor: FloatArray) -> FloatArray:
    """result + block @ factor; overwrites the result where that is in Fortran's order."""
    if 0 in (*block.shape, *factor.shape):
        return result
    summed: FloatArray = dgemm(1.0, block, factor, beta=1.0, c=result, overwrite_c=True)
    return summed
