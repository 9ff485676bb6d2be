"""The inverse of a stiffness whose factor would not fit in memory: conjugate gradients on blocks, by multigrid."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, multiply, total
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.errors import ConvergenceError
from flexmbd.reduction.static_shapes.multigrid import Multigrid, multigrid
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, round_off

# Residual, relative to the load and in the norm of the multigrid cycle, about that of the strain energy: at which the
# iteration stops, and which the solution must fulfil where round-off does not let the first be true.
_TOLERANCE, _BOUND = 1e-12, 1e-10
# The same of a correction of what the solution left.
_REFINED = 1e-3
# The same of a trial, and within how many iterations it is to be reached: a third of those of a solution.
_TRIED, _QUICK = 1e-4, 15
# Most iterations, and most times that one starts again from the residual that is there.
_ITERATIONS, _STARTS = 400, 4
# Iterations after which one looks whether the most will do at the rate of these.
_PATIENCE = 60
# Columns that are solved for together: more are no quicker, and need more memory.
_TOGETHER = 8


class ConjugateGradients:
    """K^-1 by conjugate gradients with a positive definite preconditioner, column by column of a block at once.

    Attributes:
        product: K times a block.
        precondition: nearly K^-1 times a block: a multigrid cycle, or a compressed factor.
        noise: what round-off makes of K times a block, in size.
        comm: the ranks.
    """

    def __init__(
        self, product: BlockOperator, precondition: BlockOperator, noise: BlockOperator, *, comm: MPI.Comm
    ) -> None:
        """Put together what is there already; not collective."""
        self.product, self.precondition, self.noise, self.comm = product, precondition, noise, comm

    def solve(self, block: FloatArray) -> FloatArray:
        """K^-1 times a block (rows of this rank, k). Collective.

        Raises:
            ConvergenceError: on all ranks: a column does not converge.
        """
        return _by_panels(self._solve, block)

    def refine(self, block: FloatArray) -> FloatArray:
        """K^-1 times what a solution left of its load, to a few digits. Collective."""
        return _by_panels(self._refine, block)

    def is_quick(self, load: FloatArray) -> bool:
        """Whether a generic load (rows of this rank, 1) converges as good preconditioners let it. Collective."""
        image = self.precondition(load)
        return self._iterate(load, _TRIED**2 * self._dots(load, image), image, most=_QUICK)[1] < _QUICK

    def _refine(self, loads: FloatArray) -> FloatArray:
        image = self.precondition(loads)
        return self._iterate(loads, _REFINED**2 * self._dots(loads, image), image)[0]

    def _solve(self, loads: FloatArray) -> FloatArray:
        image = self.precondition(loads)
        size = self._dots(loads, image)
        x: FloatArray = np.zeros_like(loads)
        rest, iterations, worst = loads, 0, np.inf
        goal = _TOLERANCE**2 * size
        for _ in range(_STARTS):
            correction, more = self._iterate(rest, goal, image)
            x += correction
            iterations += more
            rest = loads - self.product(x)
            image = self.precondition(rest)
            left = self._dots(rest, image)
            last, worst = worst, _largest(left, size)
            if worst <= _BOUND:
                return x
            noise = self._round_off(x)
            if np.all(left <= np.maximum(_BOUND**2 * size, MARGIN**2 * noise)):
                return x
            goal = np.maximum(goal, noise)
            # from recurrences that round-off ended one starts again, and not where they did not come far
            if not worst < min(0.5 * last, np.sqrt(_BOUND)):
                break
        raise ConvergenceError(
            f"conjugate gradients left a residual of {worst:.1e} of a load after "
            f"{iterations} iterations, bound {_BOUND:.0e} or what round-off makes of it: a part of the body is "
            "connected to no interface or not to the rest, or its cells are very thin or its stiffness jumps; look at "
            "the mesh, or take solver=Solver.DIRECT"
        )

    def _round_off(self, x: FloatArray) -> FloatArray:
        """(k,) squares of the norms of residuals that are round-off alone, of any signs. Collective."""
        signs = np.random.default_rng(self.comm.rank).choice([-1.0, 1.0], size=x.shape)
        noise = self.noise(x)
        noise *= signs
        return self._dots(noise, self.precondition(noise))

    def _iterate(
        self,
        loads: FloatArray,
        goal: FloatArray,
        image: FloatArray,
        *,
        most: int | None = None,
    ) -> tuple[FloatArray, int]:
        """A solution by recurrences, and the number of iterations (Hestenes & Stiefel 1952). Collective.

        Args:
            loads: (rows of this rank, k).
            goal: (k,) squares of the norms of residuals at which it ends.
            image: (rows of this rank, k), preconditioned loads.
            most: iterations; default: `_ITERATIONS`. It ends earlier where it is too slow for them to do.
        """
        most = _ITERATIONS if most is None else most
        x: FloatArray = np.zeros_like(loads)
        rest = loads.copy(order="K")
        direction = image.copy(order="K")
        size = left = self._dots(rest, image)
        for iteration in range(most):
            if np.all(left <= goal):
                return x, iteration
            if iteration > 0 and iteration % _PATIENCE == 0:
                if np.any(left > np.maximum(goal, _TOLERANCE ** (2.0 * _PATIENCE / _ITERATIONS) * size)):
                    return x, iteration
                size = left
            force = self.product(direction)
            step = _ratio(left, self._dots(direction, force))
            x += direction * step
            force *= step
            rest -= force
            image = self.precondition(rest)
            last, left = left, self._dots(rest, image)
            direction *= _ratio(left, last)
            direction += image
        return x, most

    def _dots(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """(k,) products of the columns of two blocks. Collective."""
        return total(self.comm, np.einsum("ij,ij->j", left, right))


def _by_panels(solve: BlockOperator, block: FloatArray) -> FloatArray:
    """Some columns after the others. Collective."""
    result = np.empty(block.shape, order="F")
    for first in range(0, block.shape[1], _TOGETHER):
        some = slice(first, first + _TOGETHER)
        result[:, some] = solve(np.asfortranarray(block[:, some]))
    return result


class MultigridInverse:
    """K_II^-1 by conjugate gradients with a multigrid cycle, over all dofs, with unit rows for those that are held.

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
        self._mask, self._scale = mask, scale[mask]
        self._iteration = ConjugateGradients(
            partial(multiply, matrix), hierarchy.cycle, partial(_round_off, matrix), comm=matrix.comm.tompi4py()
        )

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block (rows of the mask, k). Collective.

        Raises:
            ConvergenceError: on all ranks: a column does not converge.
        """
        return self._scaled(self._iteration.solve, block)

    def refine(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._scaled(self._iteration.refine, block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """One multigrid cycle in the place of K_II^-1. Collective."""
        return self._scaled(self._iteration.precondition, block)

    def _scaled(self, operator: BlockOperator, block: FloatArray) -> FloatArray:
        loads = np.zeros((len(self._mask), block.shape[1]), order="F")
        loads[self._mask] = self._scale * block
        return np.asfortranarray(self._scale * operator(loads)[self._mask])


@contextmanager
def conjugate_gradients(
    stiffness: PETSc.Mat, mask: NDArray[np.bool_], *, motions: FloatArray, block_size: int
) -> Iterator[MultigridInverse]:
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
            yield MultigridInverse(matrix, hierarchy, scale=np.reciprocal(root), mask=mask)
    finally:
        matrix.destroy()


def _round_off(matrix: PETSc.Mat, x: FloatArray) -> FloatArray:
    """(rows of this rank, k) sizes of the round-off of the matrix times a block. Collective."""
    with round_off(matrix) as measure:
        return measure.forces(x)


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
