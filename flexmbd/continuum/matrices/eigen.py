"""The lowest modes of K x = lambda M x by block Lanczos on K^-1 M.

Works on blocks throughout, because a factor solves many right-hand sides at once several times
faster than one by one, and because a block finds copies of a multiple eigenvalue together: a Krylov method
from a single start vector sees them by round-off alone, one after the other, and with a small basis leaves
some out.  (Golub & Underwood 1977; Grimes, Lewis & Simon 1994, doi:10.1137/S0895479888151111.)

What is known to be complete: from b generic start vectors the method finds min(m, b) copies of an
m-fold eigenvalue, and eigenvalues that differ by more than the tolerance do not converge before they
are told apart. Fewer than b equal eigenvalues are therefore all there are. Where b are found, fresh
start vectors are added before the process goes on. The other way to know is the inertia of K - sigma M
(`flexmbd.reduction.modes.sturm`), which takes a second factor: as long as the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.continuum.matrices.lanczos_basis import LanczosBasis
from flexmbd.errors import ConvergenceError
from flexmbd.round_off import ROUND_OFF, TEN_DIGITS

#: Relative residual to which every mode converges.
TOLERANCE = 1e-12

#: What multiplies a block (owned rows, k), by a matrix or its inverse; collective.
BlockOperator = Callable[[FloatArray], FloatArray]

# Number of directions that are added where there may be more copies than there were start vectors.
_FRESH = 8
# Of a basis this large the modes are looked for only when it has grown by so many vectors.
_LARGE, _SELDOM = 256, 16


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
    solve: BlockOperator,
    mass: PETSc.Mat,
    *,
    start: FloatArray,
    count: int,
    tolerance: float = TOLERANCE,
    limit: int | None = None,
) -> Modes:
    """The `count` lowest modes. Collective; arguments as of `BlockLanczos`.

    Raises:
        ConvergenceError: on all ranks: there are fewer modes, or the limit was reached first.
    """
    if count == 0:
        return Modes(np.zeros(0), np.zeros((len(start), 0)))
    limit = 10 * count + 100 if limit is None else limit
    process = BlockLanczos(solve, mass, start=start, tolerance=tolerance, limit=limit)
    process.find(count)
    return process.modes(count)


class BlockLanczos:
    """A block Lanczos process on K^-1 M, which finds the lowest modes one after the other.

    The basis is kept orthonormal in full and never restarted, so that the process can be continued
    when more modes are wanted: two to five vectors a mode, less memory than the factor takes.

    Attributes:
        eigenvalues: (k,) ascending, 1/s^2: the lowest, as many as have converged.
        exhausted: whether the basis spans all modes, so that there are no more.
    """

    def __init__(
        self,
        solve: BlockOperator,
        mass: PETSc.Mat,
        *,
        start: FloatArray,
        tolerance: float = TOLERANCE,
        limit: int,
    ) -> None:
        """Begin a process. Collective.

        Args:
            solve: K^-1 times a block, collective; K symmetric, definite where there is mass.
            mass: M, symmetric positive definite but for zero rows, as those of a pressure.
            start: (owned rows, b) start block.
            tolerance: relative residual of K^-1 M at which a mode has converged.
            limit: largest number of basis vectors.
        """
        self.eigenvalues: FloatArray = np.zeros(0)
        self.exhausted = False
        self._solve, self._mass, self._tolerance = solve, mass, tolerance
        self._comm = mass.comm.tompi4py()
        self._massless = _has_massless_rows(mass)
        self._limit = min(limit, mass.getSize()[0])
        self._basis = LanczosBasis(mass, len(start))
        self._projected: FloatArray = np.zeros((0, 0))
        # Ritz values and vectors of K^-1 M, descending, and their residuals
        self._values: FloatArray = np.zeros(0)
        self._vectors: FloatArray = np.zeros((0, 0))
        self._residuals: FloatArray = np.zeros(0)
        self._steps = self._wait = 0
        self._saturated = False
        self._pending, self._image, _, _ = self._basis.split(self._in_range(start), noise=0.0)
        self._width = self._pending.shape[1]

    def find(self, count: int, *, spare: int = 0) -> None:
        """Continue until the `count` lowest modes have converged. Collective.

        Args:
            count: at most the number of modes there are.
            spare: how many more shall converge, as far as there are more.

        Raises:
            ConvergenceError: on all ranks: there are fewer modes, or the limit was reached first.
        """
        while len(self.eigenvalues) < count + spare and not self.exhausted:
            if self._is_full:
                self._fail(count)
            self._advance()
        if len(self.eigenvalues) < count:
            self._fail(count)

    def find_beyond(self, eigenvalue: float, *, most: int) -> None:
        """Continue until all modes up to an eigenvalue, and one above it, have converged. Collective.

        Stops as well when there are no more modes, or when more than `most` lie below for sure
        (`count_below`), converged or not.

        Raises:
            ConvergenceError: on all ranks: the limit was reached first.
        """
        while not (self.exhausted or np.any(self.eigenvalues > eigenvalue)):
            if self.count_below(eigenvalue) > most:
                return
            if self._is_full:
                self._fail(len(self.eigenvalues) + 1)
            self._advance()

    def search_below(self, eigenvalue: float, number: int) -> None:
        """Continue with fresh directions until so many modes have converged below an eigenvalue. Collective.

        Raises:
            ConvergenceError: on all ranks: there are fewer, or the limit was reached first.
        """
        self._saturated = True
        while np.sum(self.eigenvalues < eigenvalue) < number:
            if self._is_full or self.exhausted:
                self._fail(number)
            self._advance()

    def search_again(self) -> None:
        """Continue with fresh directions until two more modes have converged, or there are no more. Collective.

        Raises:
            ConvergenceError: on all ranks: the limit was reached first.
        """
        self._saturated = True
        self.find(0, spare=len(self.eigenvalues) + 2)

    @property
    def is_definite(self) -> bool:
        """Whether K has shown no negative direction, which would be among the first to be seen if it is nearly none."""
        return bool(self._values.min(initial=0.0) >= -self._noise)

    def count_below(self, eigenvalue: float) -> int:
        """A lower bound on the number of eigenvalues below one; not collective.

        Ritz values are not below the eigenvalues they stand for (Cauchy).
        """
        return int(np.sum(self._values * eigenvalue > 1.0))

    def products(self, block: FloatArray, count: int) -> FloatArray:
        """Block^T times the shapes of the `count` lowest modes, without making those. Collective.

        Args:
            block: (owned rows, s).
            count: at most that of `eigenvalues`.

        Returns:
            (s, count), the same on every rank.
        """
        return self._basis.products(block)[:, : len(self._vectors)] @ self._vectors[:, :count]

    def modes(self, count: int) -> Modes:
        """The `count` lowest of those that have converged. Collective."""
        eigenvalues = self.eigenvalues[:count]
        shapes = self._basis.combine(self._vectors[:, :count])
        if self._massless:
            # Lanczos steps do not filter round-off at massless dofs (Nour-Omid et al. 1987)
            shapes = self._solve(multiply(self._mass, shapes)) * eigenvalues
        return Modes(eigenvalues, shapes)

    @property
    def _noise(self) -> float:
        """What is round-off beside K^-1 M."""
        return ROUND_OFF * float(self._values.max(initial=0.0))

    @property
    def _is_full(self) -> bool:
        return self._basis.size + self._pending.shape[1] > self._limit

    def _advance(self) -> None:
        """One step. Collective."""
        if self._saturated:
            self._widen()
        last = self._basis.size
        self._basis.append(self._pending, self._image)
        size = self._basis.size
        fresh = self._solve(self._image)
        self._pending, self._image, onto, rest = self._basis.split(fresh, noise=self._noise)
        projected = np.zeros((size, size))
        projected[:last, :last] = self._projected
        projected[:, last:] = onto
        projected[last:] = onto.T
        self._projected = projected
        self._steps += 1
        self._wait -= 1
        if self._pending.shape[1] == 0:
            self._widen()
        looked = len(self._values)
        due = self._is_full or (self._wait <= 0 and size >= looked + looked // _LARGE * _SELDOM)
        if self.exhausted or due:
            self._look(rest, last)

    def _look(self, rest: FloatArray, last: int) -> None:
        """Look for modes that have converged. Collective.

        Args:
            rest: (c, w) what K^-1 M times the last w basis vectors has outside of the basis.
            last: number of the basis vectors before those.
        """

        def ritz() -> tuple[FloatArray, FloatArray, FloatArray]:
            values, vectors = np.linalg.eigh(self._projected)
            values, vectors = values[::-1], vectors[:, ::-1]
            return values, vectors, np.linalg.norm(rest @ vectors[last:], axis=0) / abs(values)

        # rank 0's, so that all ranks take the same decisions
        self._values, self._vectors, self._residuals = parallel.on_root(self._comm, ritz)
        converged = (self._residuals <= self._tolerance) & (self._values > self._noise)
        found = int(np.sum(np.logical_and.accumulate(converged)))
        known = found if self.exhausted else _known(self._values[:found], self._width)
        self._saturated = known < found
        self.eigenvalues = np.reciprocal(self._values[:known])

    def _in_range(self, block: FloatArray) -> FloatArray:
        """K^-1 M times a block, which rids it of what carries no mass. Collective."""
        block = self._solve(multiply(self._mass, block))
        # what a constraint without compliance lets pass, as incompressibility, goes the second time
        return self._solve(multiply(self._mass, block)) if self._massless else block

    def _widen(self) -> None:
        """Put fresh directions beside the pending ones, or find that there are none. Collective."""
        rng = np.random.default_rng((self._basis.size, self._comm.rank))
        fresh = rng.normal(size=(_FRESH, len(self._pending))).T
        old = self._pending.shape[1]
        self._pending, self._image = self._basis.beside(self._pending, self._image, fresh)
        self._width += self._pending.shape[1] - old
        self.exhausted = self._pending.shape[1] == 0
        # they need as long as the others did to bring out further copies
        self._wait = self._steps
        self._saturated = False

    def _fail(self, count: int) -> None:
        worst = float(self._residuals[:count].max(initial=0.0))
        raise ConvergenceError(
            f"the eigensolver (block Lanczos) found {len(self.eigenvalues)} of {count} fixed-interface "
            f"modes to a relative residual of {self._tolerance:.0e} in {self._steps} steps and "
            f"{self._basis.size} vectors; the worst is at {worst:.1e}; ask for fewer modes"
        )


def _known(values: FloatArray, width: int) -> int:
    """How many of the lowest modes are known to be complete; `values` in order, of converged ones.

    After as many equal ones as there were start vectors there may be further copies.
    """
    ends = np.flatnonzero(abs(np.diff(values)) > TEN_DIGITS * abs(values[1:])) + 1
    edges = np.concatenate([[0], ends, [len(values)]])
    wide = np.flatnonzero(np.diff(edges) >= width)
    return int(edges[wide[0] + 1]) if len(wide) > 0 else len(values)


def _has_massless_rows(mass: PETSc.Mat) -> bool:
    """Whether some row of M is zero. Collective."""
    diagonal = mass.getDiagonal()
    here = bool(np.any(diagonal.getArray(readonly=True) == 0.0))
    diagonal.destroy()
    there: bool = mass.comm.tompi4py().allreduce(here, op=MPI.LOR)
    return there


# numpy would make the products row by row, against the order of the blocks


