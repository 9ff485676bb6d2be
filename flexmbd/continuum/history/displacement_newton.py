"""Newton's method for a body with history: one step's displacement, from residual and tangent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import DEFAULT_SOLVER, LinearSolver, TangentSolver
from flexmbd.continuum.history.trial_errors import InvertedCellError
from flexmbd.continuum.matrices.blocks import inner
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

# Line search: how much of the work that the residual does on the step may be left, and the tries.
_WORK_LEFT, _TRIES = 0.8, 6


@dataclass(frozen=True)
class Convergence:
    """When Newton's method ends.

    Attributes:
        tolerance: largest residual over the largest force at hand (loads, reactions, inertia), in the
            2-norm over all dofs.
        most_steps: it fails after so many.
        round_off: a residual below this that a step no longer halves is taken for round-off, and good.
    """

    tolerance: float = 1e-9
    most_steps: int = 25
    round_off: float = 1e-10


DEFAULT_CONVERGENCE = Convergence()


@dataclass(frozen=True, eq=False)
class Balance:
    """The forces at a displacement.

    Attributes:
        residual: (owned dofs,) N, what is not in balance: internal and inertia forces less loads.
        size: N, 2-norm of the largest of the forces that balance each other.
    """

    residual: FloatArray
    size: float


@dataclass(frozen=True, eq=False)
class Conditions:
    """Linear conditions on a step's displacement, kept by forces along their columns.

    Attributes:
        columns: (owned dofs, m), orthonormal over all ranks, zero at held dofs.
        missing: (m,) m, columns^T times the displacement that the first guess lacks.
    """

    columns: FloatArray
    missing: FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """A step's displacement.

    Attributes:
        increment: (local dofs including ghosts,) m, since the last accepted step.
        residuals: relative residuals of the held body, one more than there were steps.
        balance: the forces at the end; their residual on held dofs is the reactions.
    """

    increment: FloatArray
    residuals: tuple[float, ...]
    balance: Balance


class Newton:
    """Solves for one step after the other of one body. Constructing one is collective.

    Attributes:
        linear: solves the linear systems, keeping factors.
    """

    def __init__(
        self,
        body: NonlinearModel,
        held: NDArray[np.int32],
        *,
        solver: LinearSolver = DEFAULT_SOLVER,
        convergence: Convergence = DEFAULT_CONVERGENCE,
    ) -> None:
        """Allocate.

        Args:
            body: the body.
            held: owned dofs whose displacement is given.
            solver: of the linear systems.
            convergence: when to end.
        """
        self._body, self._held = body, np.asarray(held, dtype=np.int32)
        self._keeps_below, self._looseness = solver.keeps_below, solver.looseness
        self._convergence = convergence
        self._free = np.setdiff1d(np.arange(body.n_owned), self._held)
        self.linear = TangentSolver(body, self._held, solver)
        self._ghosted = body.vector()

    def solve(
        self,
        start: FloatArray,
        target: FloatArray,
        forces: Callable[[FloatArray], Balance],
        tangent: Callable[[FloatArray], PETSc.Mat],
        conditions: Conditions | None = None,
    ) -> Solution:
        """One step. Collective.

        Args:
            start: (local dofs including ghosts,) m, first guess.
            target: (held dofs,) m, their displacement since the last accepted step.
            forces: at a displacement.
            tangent: derivative of their residual; the matrix may be changed.
            conditions: on the displacement; the residual along their columns is the forces that keep them.

        Raises:
            ConvergenceError: on all ranks: it did not converge; the message has the residuals.
        """
        increment, residuals, rule = start.copy(), [], self._convergence
        missing = target - increment[self._held]
        unmet = conditions
        balance = forces(increment)
        for step in range(rule.most_steps + 1):
            left = self._unbalanced(balance.residual, conditions)
            residuals.append(self._norm(left[self._free]) / balance.size if balance.size else 0.0)
            unmoved = self._norm(missing) == 0.0 and not (unmet is not None and bool(unmet.missing.any()))
            jumps = step == 0 and not unmoved
            stalled = step > 1 and 0.5 * residuals[-2] < residuals[-1] <= rule.round_off
            if (residuals[-1] <= rule.tolerance or stalled) and not jumps:
                return Solution(increment, tuple(residuals), balance)
            if step == rule.most_steps:
                break
            if step < 2 or residuals[-1] > self._keeps_below * residuals[-2]:
                matrix, held = tangent(increment), False
            change = self._direction(matrix, left, missing, residuals, held=held, conditions=unmet)
            held = True
            missing = np.zeros_like(missing)
            if unmet is not None:
                unmet = replace(unmet, missing=np.zeros_like(unmet.missing))
            increment, balance = self._search(increment, change, balance, forces, full=jumps)
        raise ConvergenceError(
            f"Newton's method did not converge in {rule.most_steps} steps; the residuals were "
            + ", ".join(f"{residual:.1e}" for residual in residuals)
        )

    def solve_columns(
        self, matrix: PETSc.Mat, block: FloatArray, conditions: Conditions | None = None
    ) -> FloatArray:
        """The inverse of a tangent with held dofs, times columns. Collective.

        Args:
            matrix: the tangent, which is changed.
            block: (owned dofs, k); rows of held dofs are not read.
            conditions: that each of the solutions meets.

        Returns:
            (owned dofs, k), zero at held dofs.
        """
        return self.inverse(matrix, conditions)(block)

    def inverse(self, matrix: PETSc.Mat, conditions: Conditions | None = None) -> Callable[[FloatArray], FloatArray]:
        """As `solve_columns`, for one block after the other, until the next tangent is taken. Collective."""
        self.linear.hold(matrix)
        self.linear.renew()  # a factor of this matrix solves for all columns at once
        self.linear.take(matrix)
        if conditions is None:
            return self.linear.solve_block
        unmet, meeting = conditions, self.linear.solve_block(conditions.columns)

        def solve(block: FloatArray) -> FloatArray:
            solution = self.linear.solve_block(block)
            return np.asarray(solution - self._excess(solution, meeting, unmet))

        return solve

    def factorise_next(self) -> None:
        """Forget the factor, as at a checkpoint."""
        self.linear.renew()

    def _direction(
        self,
        matrix: PETSc.Mat,
        residual: FloatArray,
        missing: FloatArray,
        residuals: list[float],
        *,
        held: bool,
        conditions: Conditions | None,
    ) -> FloatArray:
        """Newton's step (local dofs including ghosts,); ``held``: of a matrix that was used before. Collective."""
        right, left = matrix.createVecLeft(), matrix.createVecRight()
        left.array[:] = 0.0
        left.array[self._held] = missing
        matrix.mult(left, right)
        right.array[:] = -residual if held else -residual - right.array
        right.array[self._held] = missing
        if not held:
            self.linear.hold(matrix)
            if conditions is not None:
                self.linear.renew()
        self.linear.take(matrix)
        loose = min(self._looseness, 0.1 * residuals[-1]) if len(residuals) > 1 else self._looseness
        step = self.linear.solve(right.array, loose)
        step[self._held] = missing  # exact, whatever Krylov's method left
        if conditions is not None:
            if not held:
                self._meeting = self.linear.solve_block(conditions.columns)
            step -= self._excess(step[:, None], self._meeting, conditions)[:, 0]
        self._ghosted.array[: self._body.n_owned] = step
        self._ghosted.scatter_forward()
        return self._ghosted.array.copy()

    def _excess(self, steps: FloatArray, meeting: FloatArray, conditions: Conditions) -> FloatArray:
        """What steps (owned dofs, k) that meet no conditions are too much, by the displacements of their forces."""
        m = len(conditions.missing)
        products = inner(self._body.comm, conditions.columns, np.hstack([meeting, steps]))
        shares = np.linalg.solve(products[:, :m], products[:, m:] - conditions.missing[:, None])
        return np.asarray(meeting @ shares)

    def _unbalanced(self, residual: FloatArray, conditions: Conditions | None) -> FloatArray:
        """The residual less the forces that keep the conditions. Collective."""
        if conditions is None:
            return residual
        along = self._body.comm.allreduce(conditions.columns.T @ residual, op=MPI.SUM)
        return np.asarray(residual - conditions.columns @ along)

    def _search(
        self,
        increment: FloatArray,
        change: FloatArray,
        before: Balance,
        forces: Callable[[FloatArray], Balance],
        *,
        full: bool,
    ) -> tuple[FloatArray, Balance]:
        """Go along a step until the residual does no more work on it. Collective.

        A step that turns cells inside out is halved; one that moves held dofs is taken in full.
        """
        work = self._work(change, before.residual)
        share, best, inverted = 1.0, None, InvertedCellError()
        for _ in range(_TRIES):
            try:
                balance = forces(increment + share * change)
            except InvertedCellError as error:
                if full:
                    raise
                share, inverted = 0.5 * share, error
                continue
            if full:
                return increment + change, balance
            left = self._work(change, balance.residual)
            if best is None or abs(left) < best[0]:
                best = abs(left), share, balance
            if abs(left) <= _WORK_LEFT * abs(work):
                break
            # where the work would vanish if it were linear in the share
            guess = share * work / (work - left) if work != left else 0.5 * share
            share = min(max(guess, 0.1 * share), 0.5 * share) if left * work < 0.0 else 0.5 * share
        if best is None:
            raise inverted
        return increment + best[1] * change, best[2]

    def _work(self, change: FloatArray, residual: FloatArray) -> float:
        mine = change[self._free] @ residual[self._free]
        return float(self._body.comm.allreduce(mine))

    def _norm(self, values: FloatArray) -> float:
        return float(np.sqrt(self._body.comm.allreduce(values @ values, op=MPI.SUM)))
