"""A multigrid cycle for elastic bodies, by algebraic coarsening that knows the rigid motions.

PETSc's smoothed aggregation (GAMG; Vanek, Mandel & Brezina 1996, doi:10.1007/BF02238511) makes the coarser
levels.  The cycle itself is here, because PETSc's takes right-hand sides one by one, and many at once are three
times cheaper.  Smoothing is by Chebyshev polynomials in the scaled matrix (Adams, Brezina, Hu & Tuminaro 2003),
before and after the coarser levels' correction, so that the cycle is a symmetric positive definite operator.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.linalg

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.continuum.matrices.near_null_space import near_null_space
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.factor import Factor

# Couplings weaker than this, relative to the diagonal, do not join two nodes to one aggregate: fewer iterations
# than without, and a hierarchy that is a little larger.
_THRESHOLD = 0.05
_PREFIX = "flexmbd_coarsen_"
# The smoother damps eigenvalues from this part of the largest on.
_DAMPED = 0.1
# Steps of the estimate of the largest eigenvalue.
_STEPS = 12
#: What is added to that.
MARGIN = 1.1
# Size of a direction, beside the eigenvalue, that is round-off.
_NOISE = 1e-10


@dataclass(frozen=True, eq=False)
class Level:
    """A level of the hierarchy but the coarsest.

    Attributes:
        matrix: A, of unit diagonal.
        smoother: (a, b) of the approximate inverse a + b A.
        interpolation: from the next coarser level.
        restriction: its transpose.
    """

    matrix: PETSc.Mat
    smoother: tuple[float, float]
    interpolation: PETSc.Mat
    restriction: PETSc.Mat

    def smoothed(self, block: FloatArray) -> FloatArray:
        """The approximate inverse times a block of loads. Collective."""
        a, b = self.smoother
        result = multiply(self.matrix, block)
        result *= b
        result += a * block
        return result


@dataclass(frozen=True, eq=False)
class Multigrid:
    """A hierarchy of levels.

    Attributes:
        levels: the finest first, without the coarsest.
        coarsest: its factor.
    """

    levels: tuple[Level, ...]
    coarsest: Factor

    def cycle(self, block: FloatArray, *, start: int = 0) -> FloatArray:
        """One V-cycle for a block of loads (rows of this rank, k), from a level on. Collective."""
        if start == len(self.levels):
            return self.coarsest.solve(block)
        level = self.levels[start]
        result = level.smoothed(block)
        rest = block - multiply(level.matrix, result)
        correction = self.cycle(multiply(level.restriction, rest), start=start + 1)
        result += multiply(level.interpolation, correction)
        result += level.smoothed(block - multiply(level.matrix, result))
        return result


@contextmanager
def multigrid(matrix: PETSc.Mat, motions: FloatArray) -> Iterator[Multigrid]:
    """Coarsen a matrix for a `with` block. Collective.

    Args:
        matrix: positive definite, of unit diagonal and of the block size of its nodes.
        motions: (rows of this rank, k) rigid motions, what costs next to no energy.

    Raises:
        ReductionError: on all ranks: it cannot be coarsened, or the coarsest level is singular.
    """
    solver = PETSc.KSP().create(matrix.comm)
    near, vectors = near_null_space(matrix, motions)
    matrix.setNearNullSpace(near)
    solver.setOperators(matrix)
    made: list[PETSc.Mat | Factor] = []
    try:
        _coarsen(solver)
        pc = solver.getPC()
        # the finest first
        matrices = [pc.getMGSmoother(i).getOperators()[0] for i in reversed(range(pc.getMGLevels()))]
        interpolations = [pc.getMGInterpolation(i) for i in reversed(range(1, pc.getMGLevels()))]
        _scale(matrices, interpolations)
        levels, comm = [], matrix.comm.tompi4py()
        for operator, interpolation in zip(matrices[:-1], interpolations, strict=True):
            made.append(interpolation.transpose(PETSc.Mat()))
            (rows, _), (size, _) = operator.getLocalSize(), operator.getSize()
            largest = largest_eigenvalue(comm, partial(multiply, operator), rows=rows, size=size)
            smoother = smoothing_polynomial(MARGIN * largest)
            levels.append(Level(operator, smoother, interpolation, made[-1]))
        coarsest = Factor(matrices[-1], definite=True)
        made.append(coarsest)
        yield Multigrid(tuple(levels), coarsest)
    finally:
        matrix.setNearNullSpace(PETSc.NullSpace())
        for item in (*made, solver, near, *vectors):
            item.destroy()


def _scale(matrices: list[PETSc.Mat], interpolations: list[PETSc.Mat]) -> None:
    """Bring the levels between the finest and the coarsest to a unit diagonal, in place. Collective."""
    for i in range(1, len(matrices) - 1):
        root = matrices[i].getDiagonal()
        root.sqrtabs()
        # its rows first, for these are scaled by the other way round
        interpolations[i].diagonalScale(root, None)
        root.reciprocal()
        matrices[i].diagonalScale(root, root)
        interpolations[i - 1].diagonalScale(None, root)
        root.destroy()


def smoothing_polynomial(largest: float) -> tuple[float, float]:
    """(a, b): 1 - x (a + b x) is Chebyshev's polynomial that is small from a part of the largest eigenvalue on."""
    radius = 0.5 * (1.0 - _DAMPED) * largest
    centre = 0.5 * (1.0 + _DAMPED) * largest / radius
    size = 2.0 * centre**2 - 1.0
    return 4.0 * centre / (radius * size), -2.0 / (radius**2 * size)


def _coarsen(solver: PETSc.KSP) -> None:
    """Make the hierarchy. Collective."""
    # PETSc sets this by its options alone
    options = PETSc.Options(_PREFIX)
    options["pc_gamg_threshold"] = _THRESHOLD
    solver.setOptionsPrefix(_PREFIX)
    solver.setType(PETSc.KSP.Type.CG)
    solver.getPC().setType(PETSc.PC.Type.GAMG)
    solver.setFromOptions()
    options.delValue("pc_gamg_threshold")
    try:
        solver.setUp()
    except PETSc.Error as error:
        raise ReductionError(
            f"the stiffness could not be coarsened for multigrid (PETSc error {error.ierr}); take solver=Solver.DIRECT"
        ) from error


def largest_eigenvalue(comm: MPI.Comm, product: BlockOperator, *, rows: int, size: int) -> float:
    """Estimate of the largest eigenvalue of a symmetric matrix, by Lanczos' process. Collective.

    Args:
        comm: the ranks.
        product: the matrix times a column (rows, 1).
        rows: of this rank.
        size: rows of all ranks.
    """
    rest: FloatArray = np.random.default_rng(comm.rank).normal(size=(rows, 1))
    vector: FloatArray = np.zeros_like(rest)
    diagonal: list[float] = []
    beside = [_norm(comm, rest)]
    for _ in range(min(_STEPS, size)):
        before, vector = vector, rest
        vector /= beside[-1]
        rest = product(vector)
        if diagonal:
            rest -= beside[-1] * before
        diagonal.append(float(inner(comm, vector, rest)[0, 0]))
        rest -= diagonal[-1] * vector
        beside.append(_norm(comm, rest))
        if not beside[-1] > _NOISE * max(diagonal):
            break
    return float(scipy.linalg.eigvalsh_tridiagonal(diagonal, beside[1:-1])[-1])


def _norm(comm: MPI.Comm, vector: FloatArray) -> float:
    return float(np.sqrt(inner(comm, vector, vector)[0, 0]))
