"""Newton's method for a body with history: one step's displacement, from residual and tangent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, by_work, searched
from flexmbd.continuation.newton import Correction, newton
from flexmbd.continuum.history.cell_pass import LocalEquationError
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.residual_noise import NoiseForces, ResidualNoise
from flexmbd.continuum.history.tangent_solver import DEFAULT_SOLVER, LinearSolver, TangentSolver
from flexmbd.continuum.history.trial_errors import InvertedCellError
from flexmbd.continuum.matrices.blocks import inner
from flexmbd.errors import ConvergenceError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]

#: Line search: largest ratio of the work that the residual does on the step, at its end to at its begin; trials; and
#: what says that there are no forces at a place.
WORK_RATIO, TRIALS, NO_FORCES = 0.8, 6, (InvertedCellError, LocalEquationError)

# Relative residual of linear systems with predicted stresses.
_ACCURATE = 1e-10
#: Relative residual above which no rounding of displacements excuses it: they have run away, as beyond a limit load.
#: Of the body's displacement, as by energies: what a residual that is round-off of a law in F may still move it.
UNBALANCED = 1e-5


@checked()
@dataclass(frozen=True)
class Convergence:
    """When Newton's method has converged, and when it gives up.

    Attributes:
        tolerance: largest residual over the largest force at hand (loads, reactions, inertia), in the
            2-norm over all dofs.
        max_iterations: it fails after so many.
        round_off: a residual below this that a step no longer halves is taken for round-off, and good; so is one
            below what rounding of the displacements makes of the tangent's diagonal, in slender bodies more, up to
            1e-5; and one below what rounding of F = 1 + grad u makes of it, under small loads more than that, where
            the next step would be less than 1e-5 of the displacement.
    """

    tolerance: float = 1e-9
    max_iterations: int = 25
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
class LinearConstraints:
    """Linear constraints on a step's displacement, kept by forces along their columns.

    Attributes:
        columns: (owned dofs, m), orthonormal over all ranks, zero at prescribed dofs.
        gap: (m,) m, columns^T times the displacement that the first guess lacks.
    """

    columns: FloatArray
    gap: FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """A step's displacement.

    Attributes:
        increment: (local dofs including ghosts,) m, since the last accepted step.
        residuals: relative residuals on the dofs that are not prescribed, one more than there were iterations.
        balance: the forces at the end; their residual on prescribed dofs is the reactions.
    """

    increment: FloatArray
    residuals: tuple[float, ...]
    balance: Balance


@dataclass(frozen=True, eq=False)
class _TrialDisplacement:
    """A trial displacement (local dofs including ghosts,) m, the forces there, and what given dofs still lack, m."""

    increment: FloatArray
    balance: Balance
    gap: FloatArray


class Newton:
    """Solves for one step after the other of one body. Constructing one is collective.

    Attributes:
        body: it.
        prescribed: owned dofs whose displacement is given.
        convergence: when to end.
        reuse_below: ratio of residuals above which a tangent is not used again.
        linear: solves the linear systems, keeping factors.
        predicts: whether stresses are unknowns of their own by now: tangents are to be taken with predicted ones.
        noise: round-off of the forces on free dofs.
        still: whether tangents are without inertia.
    """

    def __init__(
        self,
        body: NonlinearModel,
        prescribed: NDArray[np.int32],
        *,
        solver: LinearSolver = DEFAULT_SOLVER,
        convergence: Convergence = DEFAULT_CONVERGENCE,
        predicts: bool = False,
        still: bool = False,
    ) -> None:
        """Allocate.

        Args:
            body: the body.
            prescribed: owned dofs whose displacement is given.
            solver: of the linear systems.
            convergence: when to end.
            predicts: whether stresses become unknowns of their own (`stress_predictor`) once a step creeps.
            still: whether tangents are the body's own, without inertia, so that they show the round-off of a law in F.
        """
        self.body, self.prescribed = body, np.asarray(prescribed, dtype=np.int32)
        self.reuse_below, self._forcing_term = solver.reuse_below, solver.forcing_term
        self.convergence = convergence
        self._free = np.setdiff1d(np.arange(body.n_owned), np.union1d(self.prescribed, body.held_dofs))
        self.linear = TangentSolver(body, self.prescribed, solver)
        self._ghosted = body.vector()
        self.predicts, self._may_predict = False, predicts and body.predicts_stress
        self.noise, self.still = ResidualNoise(body, self._free), still

    def solve(
        self,
        start: FloatArray,
        target: FloatArray,
        forces: Callable[[FloatArray], Balance],
        tangent: Callable[[FloatArray], PETSc.Mat],
        constraints: LinearConstraints | None = None,
    ) -> Solution:
        """One step. Collective.

        Args:
            start: (local dofs including ghosts,) m, first guess.
            target: (prescribed dofs,) m, their displacement since the last accepted step.
            forces: at a displacement.
            tangent: derivative of their residual; the matrix may be changed.
            constraints: on the displacement; the residual along their columns is the forces that keep them.

        Raises:
            ConvergenceError: on all ranks: it did not converge; the message has the residuals.
        """
        step = _StepProblem(self, forces, tangent, constraints)
        found = newton(step, step.begin(start, target), most=self.convergence.max_iterations, close=0.0)
        if found.is_solution:
            return Solution(found.place.increment, tuple(step.residuals), found.place.balance)
        raise ConvergenceError(
            f"Newton's method did not converge in {found.iterations} steps; the residuals were "
            + ", ".join(f"{residual:.1e}" for residual in step.residuals)
        )

    def solve_columns(
        self, matrix: PETSc.Mat, block: FloatArray, constraints: LinearConstraints | None = None
    ) -> FloatArray:
        """The inverse of a tangent with prescribed dofs, times columns. Collective.

        Args:
            matrix: the tangent, which is changed.
            block: (owned dofs, k); rows of prescribed dofs are not read.
            constraints: that each of the solutions meets.

        Returns:
            (owned dofs, k), zero at prescribed dofs.
        """
        return self.inverse(matrix, constraints)(block)

    def inverse(
        self, matrix: PETSc.Mat, constraints: LinearConstraints | None = None
    ) -> Callable[[FloatArray], FloatArray]:
        """As `solve_columns`, for one block after the other, until the next tangent is taken. Collective."""
        self.linear.constrain(matrix)
        self.linear.renew_preconditioner()  # a factor of this matrix solves for all columns at once
        self.linear.set_operator(matrix)
        if constraints is None:
            return self.linear.solve_block
        responses = self.linear.solve_block(constraints.columns)

        def solve(block: FloatArray) -> FloatArray:
            solution = self.linear.solve_block(block)
            return np.asarray(solution - self._constraint_correction(solution, responses, constraints))

        return solve

    def discard_factor(self) -> None:
        """Forget the factor, as at a checkpoint."""
        self.linear.discard_preconditioner()

    def direction(
        self,
        matrix: PETSc.Mat,
        residual: FloatArray,
        gap: FloatArray,
        residuals: list[float],
        *,
        reused: bool,
        constraints: LinearConstraints | None,
    ) -> FloatArray:
        """Newton's step (local dofs including ghosts,); ``reused``: the matrix was used before. Collective."""
        right, left = matrix.createVecLeft(), matrix.createVecRight()
        left.array[:] = 0.0
        left.array[self.prescribed] = gap
        matrix.mult(left, right)
        right.array[:] = -residual if reused else -residual - right.array
        right.array[self.body.held_dofs] = 0.0
        right.array[self.prescribed] = gap
        if not reused:
            self.linear.constrain(matrix)
            if constraints is not None or self.predicts:
                self.linear.renew_preconditioner()
        self.linear.set_operator(matrix)
        loose = min(self._forcing_term, 0.1 * residuals[-1]) if len(residuals) > 1 else self._forcing_term
        if self.predicts:
            loose = _ACCURATE  # beside forces that stretch a slender body those that bend it are small
        step = self.linear.solve(right.array, loose)
        step[self.body.held_dofs] = 0.0
        step[self.prescribed] = gap  # exact, whatever Krylov's method left
        if constraints is not None:
            if not reused:
                self._responses = self.linear.solve_block(constraints.columns)
            step -= self._constraint_correction(step[:, None], self._responses, constraints)[:, 0]
        self._ghosted.array[: self.body.n_owned] = step
        self._ghosted.scatter_forward()
        return self.body.complete(self._ghosted.array.copy())

    def _constraint_correction(
        self, steps: FloatArray, responses: FloatArray, constraints: LinearConstraints
    ) -> FloatArray:
        """What unconstrained steps (owned dofs, k) violate of the constraints, as displacements by their forces.

        ``responses``: (owned dofs, m) the displacements by unit forces along the constraints' columns.
        """
        m = len(constraints.gap)
        products = inner(self.body.comm, constraints.columns, np.hstack([responses, steps]))
        shares = np.linalg.solve(products[:, :m], products[:, m:] - constraints.gap[:, None])
        return np.asarray(responses @ shares)

    def without_constraint_forces(self, residual: FloatArray, constraints: LinearConstraints | None) -> FloatArray:
        """The residual less the forces that keep the constraints. Collective."""
        if constraints is None:
            return residual
        along = self.body.comm.allreduce(constraints.columns.T @ residual, op=MPI.SUM)
        return np.asarray(residual - constraints.columns @ along)

    def search(
        self,
        here: _TrialDisplacement,
        change: FloatArray,
        forces: Callable[[FloatArray], Balance],
        *,
        full: bool,
    ) -> tuple[FloatArray, Balance]:
        """Go along a step until the residual does no more work on it. Collective.

        A step that turns cells inside out, or for which the equations at a point are not solved, is halved; one that
        moves prescribed dofs is taken in full.
        """
        increment = here.increment
        if full:
            balance = forces(increment + change)
            if self.predicts:
                self.body.predict_stress(increment, increment + change)
            return increment + change, balance
        before, tried = self.work(change, here.balance.residual), 1.0

        def trial(share: float) -> ShareTrial[Balance]:
            nonlocal tried
            tried = share
            balance = forces(increment + share * change)
            left = self.work(change, balance.residual)
            if self._may_predict and abs(left) > WORK_RATIO * abs(before):
                self.predicts, self._may_predict = True, False
            if self.predicts:
                excess = self.body.predict_stress(increment, increment + share * change)
                left = self.work(change, balance.residual + excess)
            return by_work(balance, share, work=left, before=before, ratio=WORK_RATIO)

        best = searched(trial, most=TRIALS, fails=NO_FORCES)
        if self.predicts and best.share != tried:
            self.body.predict_stress(increment, increment + best.share * change)
        return increment + best.share * change, best.place

    def work(self, change: FloatArray, residual: FloatArray) -> float:
        """J, of a residual on a change of free dofs. Collective."""
        mine = change[self._free] @ residual[self._free]
        return float(self.body.comm.allreduce(mine))

    def energy(self, matrix: PETSc.Mat, increment: FloatArray) -> float:
        """J, twice that of an increment (local dofs including ghosts,) by a tangent. Collective."""
        right, left = matrix.createVecRight(), matrix.createVecLeft()
        right.array[:] = increment[: self.body.n_owned]
        right.array[self.body.held_dofs] = 0.0  # of which a tangent has a diagonal alone
        matrix.mult(right, left)
        return abs(float(right.dot(left)))

    def free_norm(self, values: FloatArray) -> float:
        """2-norm on the dofs that are not prescribed. Collective."""
        return self._norm(values[self._free])

    def lacks(self, gap: FloatArray) -> bool:
        """Whether prescribed dofs (prescribed,) are still to be moved on any rank. Collective."""
        return self._norm(gap) != 0.0

    def _norm(self, values: FloatArray) -> float:
        return float(np.sqrt(self.body.comm.allreduce(values @ values, op=MPI.SUM)))


class _StepProblem:
    """One step as a problem for Newton's method; ``residuals``: on the dofs that are not prescribed, relative."""

    def __init__(
        self,
        method: Newton,
        forces: Callable[[FloatArray], Balance],
        tangent: Callable[[FloatArray], PETSc.Mat],
        constraints: LinearConstraints | None,
    ) -> None:
        self.residuals: list[float] = []
        self._method, self._forces, self._tangent = method, forces, tangent
        self._constraints = self._open = constraints
        self._noise = NoiseForces(0.0, 0.0)
        self._energy = self._moves = 0.0  # of the increment by the tangent, and of the last correction
        self._left: FloatArray = np.zeros(0)
        self._matrix = PETSc.Mat()  # no handle before the first

    def begin(self, start: FloatArray, target: FloatArray) -> _TrialDisplacement:
        method, increment = self._method, start.copy()
        balance = self._forces(increment)
        if method.predicts:
            method.body.predict_stress(np.zeros_like(increment), increment)
        return _TrialDisplacement(increment, balance, target - increment[method.prescribed])

    def is_solved(self, here: _TrialDisplacement, *, close: bool) -> bool:
        """Whether the residual is small, or stays where it is and is round-off."""
        method, rule, size, residuals = self._method, self._method.convergence, here.balance.size, self.residuals
        self._left = method.without_constraint_forces(here.balance.residual, self._constraints)
        residuals.append(method.free_norm(self._left) / size if size else 0.0)
        noise = max(rule.round_off, min(self._noise.of_displacement / size, UNBALANCED) if size else 0.0)
        if size and method.still and self._moves <= UNBALANCED**2 * self._energy:
            noise = max(noise, self._noise.of_gradient / size)
        stalled = len(residuals) > 2 and 0.5 * residuals[-2] < residuals[-1] <= noise
        return (residuals[-1] <= rule.tolerance or stalled) and not self._jumps(here)

    def correction(self, here: _TrialDisplacement) -> Correction[FloatArray]:
        """The linear solution, by the tangent there or, as long as it serves, by the one before."""
        method, residuals, reused = self._method, self.residuals, True
        if len(residuals) < 3 or residuals[-1] > method.reuse_below * residuals[-2]:
            self._matrix, reused = self._tangent(here.increment), False
            self._noise = method.noise.of(self._matrix, here.increment)
            self._energy = method.energy(self._matrix, here.increment)
        change = method.direction(
            self._matrix, self._left, here.gap, residuals, reused=reused, constraints=self._open
        )
        self._moves = abs(method.work(change, self._left))
        return Correction(change, residuals[-1])

    def moved(self, here: _TrialDisplacement, correction: Correction[FloatArray], *, close: bool) -> _TrialDisplacement:
        full = self._jumps(here)
        if self._open is not None:
            self._open = replace(self._open, gap=np.zeros_like(self._open.gap))
        found = self._method.search(here, correction.change, self._forces, full=full)
        return _TrialDisplacement(*found, np.zeros_like(here.gap))

    def _jumps(self, here: _TrialDisplacement) -> bool:
        """Whether prescribed dofs or constraints still have to be moved where they are wanted. Collective."""
        if len(self.residuals) > 1:
            return False
        closed = self._open is None or not self._open.gap.any()
        return not closed or self._method.lacks(here.gap)
