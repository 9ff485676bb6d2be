"""The inverse of a stiffness whose factor would not fit in memory: conjugate gradients on blocks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, multiply, total
from flexmbd.errors import ConvergenceError
from flexmbd.reduction.static_shapes.multigrid import Multigrid, multigrid
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, round_off

# Residual, relative to the load and in the norm of the multigrid cycle, about that of the strain energy: at which the
# iteration stops, and which the solution must fulfil where round-off does not let the first be true.
_TOLERANCE, _BOUND = 1e-12, 1e-10
# Most iterations, and most times that one starts again from the residual that is there.
_ITERATIONS, _STARTS = 400, 4
# Columns that are solved for together: more are no quicker, and need more memory.
_TOGETHER = 8


class ConjugateGradients:
    """K^-1 by conjugate gradients with a multigrid cycle as preconditioner, column by column of a block at once.

    Attributes:
        name: of the method, for the record's provenance.
    """

    name = "conjugate gradients, multigrid"

    def __init__(
        self, matrix: PETSc.Mat, hierarchy: Multigrid, *, scale: FloatArray, mask: NDArray[np.bool_]
    ) -> None:
        """Put together what is there already; not collective.

        Args:
            matrix: S K S over all dofs, with rows and columns of the unit matrix for those that are held.
            hierarchy: of the matrix.
            scale: (rows of this rank, 1), S, with which the matrix has a unit diagonal.
            mask: (rows of this rank,) whether a dof is not held.
        """
        self._matrix, self._hierarchy = matrix, hierarchy
        self._mask, self._scale = mask, scale[mask]
        self._comm = matrix.comm.tompi4py()

    def solve(self, block: FloatArray) -> FloatArray:
        """K^-1 times a block (rows of `mask`, k). Collective.

        Raises:
            ConvergenceError: on all ranks: a column does not converge.
        """
        result = np.empty(block.shape, order="F")
        for first in range(0, block.shape[1], _TOGETHER):
            some = slice(first, first + _TOGETHER)
            loads = np.zeros((len(self._mask), result[:, some].shape[1]), order="F")
            loads[self._mask] = self._scale * block[:, some]
            result[:, some] = self._scale * self._solve(loads)[self._mask]
        return result

    def _solve(self, loads: FloatArray) -> FloatArray:
        size = self._dots(loads, self._hierarchy.cycle(loads))
        x: FloatArray = np.zeros(loads.shape, order="F")
        rest, iterations, worst = loads, 0, np.inf
        goal = _TOLERANCE**2 * size
        for _ in range(_STARTS):
            correction, more = self._iterate(rest, goal)
            x += correction
            iterations += more
            rest = loads - multiply(self._matrix, x)
            left = self._dots(rest, self._hierarchy.cycle(rest))
            last, worst = worst, _largest(left, size)
            if worst <= _BOUND:
                return x
            noise = self._round_off(x)
            if np.all(left <= np.maximum(_BOUND**2 * size, MARGIN**2 * noise)):
                return x
            goal = np.maximum(goal, noise)
            if not worst < 0.5 * last:
                break
        raise ConvergenceError(
            f"conjugate gradients with algebraic multigrid left a residual of {worst:.1e} of a load after "
            f"{iterations} iterations, bound {_BOUND:.0e} or what round-off makes of it: a part of the body is "
            "connected to no interface or not to the rest, or its cells are very thin or its stiffness jumps; look at "
            "the mesh, or take solver=Solver.DIRECT"
        )

    def _round_off(self, x: FloatArray) -> FloatArray:
        """(k,) squares of the norms of residuals that are round-off alone, of any signs. Collective."""
        signs = np.random.default_rng(self._comm.rank).choice([-1.0, 1.0], size=x.shape)
        with round_off(self._matrix) as measure:
            noise = np.asfortranarray(signs * measure.forces(x))
        return self._dots(noise, self._hierarchy.cycle(noise))

    def _iterate(self, loads: FloatArray, goal: FloatArray) -> tuple[FloatArray, int]:
        """A solution by recurrences, and the number of iterations (Hestenes & Stiefel 1952). Collective.

        Args:
            loads: (rows of this rank, k).
            goal: (k,) squares of the norms of residuals at which it ends.
        """
        x: FloatArray = np.zeros(loads.shape, order="F")
        rest = loads.copy(order="F")
        image = self._hierarchy.cycle(rest)
        direction = image.copy(order="F")
        left = self._dots(rest, image)
        for iteration in range(_ITERATIONS):
            if np.all(left <= goal):
                return x, iteration
            force = multiply(self._matrix, direction)
            step = _ratio(left, self._dots(direction, force))
            x += direction * step
            force *= step
            rest -= force
            image = self._hierarchy.cycle(rest)
            last, left = left, self._dots(rest, image)
            direction *= _ratio(left, last)
            direction += image
        return x, _ITERATIONS

    def _dots(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """(k,) products of the columns of two blocks. Collective."""
        return total(self._comm, np.einsum("ij,ij->j", left, right))


@contextmanager
def conjugate_gradients(
    stiffness: PETSc.Mat, mask: NDArray[np.bool_], *, motions: FloatArray, block_size: int
) -> Iterator[ConjugateGradients]:
    """K_II^-1 for a `with` block. Collective.

    Args:
        stiffness: positive semidefinite, definite once the dofs outside of `mask` are held.
        mask: (rows of this rank,) the dofs that are not held.
        motions: (rows of this rank, 6) rigid motions.
        block_size: number of dofs of a node.

    Raises:
        ReductionError: on all ranks: the stiffness is singular.
    """
    matrix, root = _held(stiffness, mask, block_size=block_size)
    try:
        with multigrid(matrix, root * motions) as hierarchy:
            yield ConjugateGradients(matrix, hierarchy, scale=np.reciprocal(root), mask=mask)
    finally:
        matrix.destroy()


def _held(stiffness: PETSc.Mat, mask: NDArray[np.bool_], *, block_size: int) -> tuple[PETSc.Mat, FloatArray]:
    """A copy scaled to a unit diagonal, with unit rows for the dofs that are held, and the scale's inverse. Collective.

    These dofs stay in it because the aggregates of multigrid are made of whole nodes.
    """
    matrix = stiffness.copy()
    matrix.setBlockSize(block_size)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    diagonal = matrix.getDiagonal()
    diagonal.sqrtabs()
    root: FloatArray = diagonal.getArray(readonly=True).copy()[:, None]
    diagonal.reciprocal()
    matrix.diagonalScale(diagonal, diagonal)
    diagonal.destroy()
    first = matrix.getOwnershipRange()[0]
    matrix.zeroRowsColumns(np.flatnonzero(~mask).astype(PETSc.IntType) + first, diag=1.0)
    return matrix, root


def _largest(squares: FloatArray, size: FloatArray) -> float:
    """Largest of the ratios of norms, of which squares are given; not a number where there is none."""
    return float(np.sqrt(abs(_ratio(squares, size))).max(initial=0.0))


def _ratio(left: FloatArray, right: FloatArray) -> FloatArray:
    """Left by right, and zero where both are, as for a load of nothing."""
    return np.divide(left, right, out=np.zeros_like(left), where=(left != 0.0) | (right != 0.0))
