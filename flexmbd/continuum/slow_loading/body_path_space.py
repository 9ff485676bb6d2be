"""A body under slow loads as a space of paths: points along the arc by Newton's method on displacement and factor.

A change of the configuration is (owned dofs,): m, rad, or of pressures.  In the product displacements count in the
body's extent and rotations in rad, each as a mean over the nodes, so that a finer mesh measures alike; what is neither
does not count.

With the tangent K, forces r out of balance and their slopes by the factor the step is a + b df, with K a = -r and
K b = -dr/df at free dofs and at given ones what they still lack and their slopes; df keeps it in the plane across the
path (Riks 1979, doi:10.1016/0020-7683(79)90081-7).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.newton import corrected
from flexmbd.continuation.request import looked_at
from flexmbd.continuation.space import ALIKE, APART, LOAD_DIFFERENCE, PathDirection, unit
from flexmbd.continuum.history.displacement_newton import UNBALANCED, Balance, Convergence
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot
from flexmbd.continuum.history.residual_noise import NoiseForces, ResidualNoise
from flexmbd.continuum.history.tangent_solver import LinearSolver, TangentSolver, is_symmetric
from flexmbd.continuum.matrices.blocks import inner
from flexmbd.continuum.slow_loading.body_point import BodyPoint, BodySpectrum
from flexmbd.continuum.slow_loading.loading import SlowLoads
from flexmbd.continuum.slow_loading.motion_metric import motion_metric
from flexmbd.continuum.slow_loading.stiffness_spectrum import NearZero, smallest_eigenvalues, smallest_vibrations
from flexmbd.errors import ConvergenceError
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]



class BodyPathSpace:
    """A body under loads that follow one factor. All of it is collective.

    Attributes:
        width: of the range of factors.
        typical: of the sizes of motions, what counts as much as the range of factors in the product.
        solver: of the linear equations; it counts its factors.
    """

    def __init__(self, loads: SlowLoads, width: float, convergence: Convergence) -> None:
        """Weigh the dofs.

        Args:
            loads: on the body.
            width: of the range of factors.
            convergence: when Newton's method has converged, and when it gives up.
        """
        self.width, self._rule = width, convergence
        self._loads, self._body = loads, loads.body
        body, prescribed = loads.body, loads.prescribed
        self.solver = TangentSolver(body, prescribed, LinearSolver(0), counts=True)
        self._free = np.setdiff1d(np.arange(body.n_owned), np.union1d(prescribed, body.held_dofs))
        self._ghosted = body.vector()
        self._noises, self._noise = ResidualNoise(body, self._free), NoiseForces(0.0, 0.0)
        self._size, self._weights = motion_metric(body)
        self.typical, self._round_off = 1.0, 0.0
        self._factored: BodyPoint | None = None
        self._predicts = body.predicts_stress

    def product(self, a: PathDirection, b: PathDirection) -> float:
        """<a, b>."""
        along = self._body.comm.allreduce(float((self._weights * a.xi) @ b.xi))
        return along / self.typical**2 + a.factor * b.factor / self.width**2

    def largest(self, a: PathDirection) -> float:
        """Largest part: rad, of the extent, or of the range of factors."""
        mine = float(np.abs(a.xi / self._size).max(initial=0.0))
        return max(self._body.comm.allreduce(mine, op=MPI.MAX), abs(a.factor) / self.width)

    def along_factor(self, sign: float) -> PathDirection:
        """The factor's own direction."""
        return PathDirection(np.zeros(self._body.n_owned), sign * self.width)

    def sized(self, mode: FloatArray) -> FloatArray:
        """(owned dofs,) a mode whose largest part is 1 rad, or the extent."""
        parts = mode / self._size
        k = int(np.argmax(np.abs(parts))) if parts.size else 0
        mine = float(parts[k]) if parts.size else 0.0
        every = self._body.comm.allgather(mine)
        return np.asarray(mode / max(every, key=abs))

    def tangent(self, here: BodyPoint, onwards: PathDirection) -> PathDirection:
        """Unit tangent of the path at a point, on the side of a direction."""
        along = unit(self, PathDirection(here.response * self.width, self.width))
        return along.times(-1.0 if self.product(along, onwards) < 0.0 else 1.0)

    def difference(self, before: BodyPoint, after: BodyPoint) -> PathDirection:
        """The change from one point to another."""
        n = self._body.n_owned
        return PathDirection((after.displacement - before.displacement)[:n], after.factor - before.factor)

    def remember_alike(self, one: BodyPoint, other: BodyPoint) -> bool:
        """Whether the histories are the same, each of their components over the largest that the body has of it."""
        comm, alike = self._body.comm, True
        shapes = [part.shape for part in self._body.history()]
        for shape, *pair in zip(shapes, one.state.history, other.state.history, strict=True):
            first, second = (part.reshape(shape) for part in pair)
            largest = comm.allreduce(np.abs(first).max(axis=0, initial=0.0), op=MPI.MAX)
            alike &= bool((np.abs(second - first) <= ALIKE * largest).all())
        return bool(comm.allreduce(alike, op=MPI.LAND))

    def spectrum(self, here: BodyPoint) -> BodySpectrum:
        """Of its stiffness."""
        return BodySpectrum(here, partial(self._near_zero, here))

    def other_path(self, here: BodyPoint, mode: PathDirection, tangent: PathDirection) -> PathDirection:
        """Unit direction of the path that crosses another one at a bifurcation.

        It is m + s t of the mode m and the other path's tangent t, with 2 s m.K'(t)m + m.K'(m)m = 0 (Seydel 2010,
        section 5.6.2); without a potential m alone.
        """
        if here.negative is None:
            return unit(self, mode)
        by_path = self._stiffening(here, tangent, mode.xi)
        share = -0.5 * self._stiffening(here, mode, mode.xi) / by_path if by_path != 0.0 else 0.0
        return unit(self, mode.plus(tangent.times(share)))

    def correct(
        self, start: BodyPoint, step: PathDirection, across: PathDirection, *, undetermined: int = 0
    ) -> BodyPoint:
        """The equilibrium in the plane through the end of a step that is normal to ``across``; as of `PathSpace`.

        Stresses of slender bodies are unknowns of their own (`stress_predictor`).

        Raises:
            ConvergenceError: Newton's method does not converge.
        """
        before = start.state
        self._stand(before)
        increment: FloatArray = start.increment if start.after is None else np.zeros_like(start.increment)
        factor = start.factor

        def iterate(change: PathDirection, iteration: int, close: bool) -> BodyPoint | PathDirection:
            nonlocal increment, factor
            factor += change.factor
            moved = self._moved(increment, change.xi, factor)
            if self._predicts:
                self._body.predict_stress(increment, moved)
            increment = moved
            balance = self._balance(increment, factor)
            left = self._body.norm(balance.residual[self._free]) / balance.size if balance.size else 0.0
            if left <= self._rule.tolerance or (close and left <= self._round_off_at(balance, change, increment)):
                self._body.check_increment(increment)
                return self._point(before, increment, factor, iteration, balance)
            responses = self._responses(increment, factor, balance, predicted=self._predicts)
            return self._in_plane(responses, across, undetermined)

        return corrected(self, step, iterate, most=self._rule.max_iterations)

    def _round_off_at(self, balance: Balance, change: PathDirection, increment: FloatArray) -> float:
        """The relative residual that is round-off behind a close correction; more where that moves nothing."""
        moved = (self._body.displacement + increment)[: self._body.n_owned]
        whole, last = (self.largest(PathDirection(part, 0.0)) for part in (moved, change.xi))
        least = self._noise.of_gradient / balance.size if last <= UNBALANCED * whole else 0.0
        return max(UNBALANCED, least)

    def standing(self, factor: float) -> BodyPoint:
        """The point at which the body stands, in balance under a factor, and accepted."""
        before = self._body.snapshot()
        rest: FloatArray = np.zeros(self._body.layout.n_local)
        found = self._point(before, rest, factor, 0, self._balance(rest, factor))
        return replace(found, after=before)

    def standing_where_it_gives_way(self, factor: float) -> BodyPoint:
        """The same at a critical point, without the tangent of the path: the stiffness may be singular."""
        before = self._body.snapshot()
        rest: FloatArray = np.zeros(self._body.layout.n_local)
        reactions = self._balance(rest, factor).residual[self._loads.prescribed]
        matrix = self._loads.tangent(self._loads.outer(factor), rest)
        self.solver.constrain(matrix)
        negative = 0 if is_symmetric(matrix) else None
        return BodyPoint(before, rest, factor, 0, np.zeros(self._body.n_owned), reactions, negative, 0.0, before)

    def remembered(self, here: BodyPoint, factor: float) -> BodyPoint:
        """The point, accepted by the body, its factor rounded to the given one.

        Raises:
            ConvergenceError: a history is not finite.
        """
        self._loads.accept(here.before, here.increment, factor)
        accepted = replace(here, factor=factor, after=self._body.snapshot())
        if self._factored is here:
            self._factored = accepted
        return accepted

    def does_anything(self, here: BodyPoint, to: float) -> bool:
        """Whether the factor, on its way to another one, changes a force or a given displacement."""
        rest: FloatArray = np.zeros(self._body.layout.n_local)

        def loads(factor: float) -> FloatArray:
            outer = self._loads.outer(factor)
            return np.concatenate([outer.force(rest), self._loads.given(factor), outer.given_fields])

        if self._body.comm.allreduce(bool(here.response.any()), op=MPI.LOR):
            return True
        begun = loads(here.factor)
        found = [not np.array_equal(loads(factor), begun) for factor in looked_at(here.factor, to)]
        return bool(self._body.comm.allreduce(any(found), op=MPI.LOR))

    def _stand(self, state: HistorySnapshot) -> None:
        self._body.restore(state)

    def _moved(self, increment: FloatArray, xi: FloatArray, factor: float) -> FloatArray:
        """(local dofs,) an increment after a change, with given dofs where they are to be at a factor."""
        n, prescribed = self._body.n_owned, self._loads.prescribed
        own = self._ghosted.array[:n]
        own[:] = increment[:n] + xi
        own[prescribed] = self._loads.given(factor) - self._body.displacement[prescribed]
        self._ghosted.scatter_forward()
        return self._body.complete(self._ghosted.array.copy())

    def _balance(self, increment: FloatArray, factor: float) -> Balance:
        return self._loads.balance(self._loads.outer(factor), increment, least=self.load_size(increment, factor))

    def load_size(self, increment: FloatArray, factor: float) -> float:
        """N, what the loads change by over the range of factors: forces at hand, where the factor is zero as well."""
        return self._body.norm(self._load_slope(increment, factor)) * self.width

    def _load_slope(self, increment: FloatArray, factor: float) -> FloatArray:
        """(owned dofs,) N, of the loads by the factor, and of what the temperature takes from the internal forces."""
        low, high = (
            self._loads.net_load(self._loads.outer(factor + side * LOAD_DIFFERENCE * self.width), increment)
            for side in (-1.0, 1.0)
        )
        return np.asarray((high - low) / (2.0 * LOAD_DIFFERENCE * self.width))

    def _given_slope(self, factor: float) -> FloatArray:
        """(prescribed dofs,) m, by the factor."""
        low, high = (self._loads.given(factor + side * LOAD_DIFFERENCE * self.width) for side in (-1.0, 1.0))
        return np.asarray((high - low) / (2.0 * LOAD_DIFFERENCE * self.width))

    def _responses(
        self, increment: FloatArray, factor: float, balance: Balance, *, predicted: bool = False
    ) -> FloatArray:
        """(owned dofs, 2): the changes a and b of the module's text; the tangent is factorised anew."""
        prescribed = self._loads.prescribed
        matrix = self._loads.tangent(self._loads.outer(factor), increment, predicted=predicted)
        self._noise = self._noises.of(matrix, increment)
        slope = self._given_slope(factor)
        right, left = matrix.createVecLeft(), matrix.createVecRight()
        left.array[:] = 0.0
        left.array[prescribed] = slope
        matrix.mult(left, right)
        block = np.stack([-balance.residual, self._load_slope(increment, factor) - right.array], axis=1)
        block[self._body.held_dofs] = 0.0
        self._factored = None
        self.solver.constrain(matrix)
        self.solver.set_operator(matrix)
        self._round_off = self._zero_up_to(matrix)
        found = self.solver.solve_block(block)
        found[prescribed, 1] = slope
        return self._body.complete(found)

    def _zero_up_to(self, matrix: PETSc.Mat) -> float:
        """What the factor of a matrix leaves of an eigenvalue that is zero."""
        weights = self._free_weights
        if not self.solver.is_symmetric and self._inertia is not None:
            weights = np.zeros_like(weights)
            weights[self._free] = self._inertia.getDiagonal().array_r[self._free]
        counted = weights > 0.0
        own = np.abs(matrix.getDiagonal().array_r[counted]) / weights[counted]
        return ROUND_OFF * float(self._body.comm.allreduce(float(own.max(initial=0.0)), op=MPI.MAX))

    def _in_plane(self, responses: FloatArray, across: PathDirection, undetermined: int) -> PathDirection:
        """The step a + b df that stays in the plane normal to a direction."""
        if undetermined:
            shape = self._modes_next_to_zero(undetermined)
            shares = inner(self._body.comm, self._free_weights[:, None] * shape, responses)
            gram = inner(self._body.comm, self._free_weights[:, None] * shape, shape)
            responses = responses - shape @ np.linalg.solve(gram, shares)
        lacking, by_factor = (PathDirection(responses[:, k], float(k)) for k in range(2))
        along = self.product(across, by_factor)
        if along == 0.0:
            raise ConvergenceError("the tangent of the path is not defined there")
        return lacking.plus(by_factor.times(-self.product(across, lacking) / along))

    def _modes_next_to_zero(self, count: int) -> FloatArray:
        """(owned dofs, count) modes next to zero of the tangent that was factorised last."""
        return smallest_eigenvalues(self.solver, self._free_weights, count, symmetric=self.solver.is_symmetric)[1]

    def _point(
        self, before: HistorySnapshot, increment: FloatArray, factor: float, iterations: int, balance: Balance
    ) -> BodyPoint:
        """A point in balance, with what its own tangent tells."""
        responses = self._responses(increment, factor, balance)
        if not self._body.comm.allreduce(bool(np.isfinite(responses).all()), op=MPI.LAND):
            raise ConvergenceError("the tangent stiffness is singular")
        negative = self.solver.negative_pivots_but_of(self._others) if self.solver.is_symmetric else None
        reactions = balance.residual[self._loads.prescribed]
        sign = self.solver.sign
        found = BodyPoint(before, increment, factor, iterations, responses[:, 1], reactions, negative, sign)
        self._factored = found
        return found

    def _factorise_at(self, here: BodyPoint) -> None:
        """Make the factor that of a point's tangent."""
        if self._factored is here:
            return
        self._stand(here.before)
        self._responses(here.increment, here.factor, self._balance(here.increment, here.factor))
        self._factored = here

    def _near_zero(self, here: BodyPoint, count: int) -> NearZero:
        """Eigenvalues of a point's stiffness next to zero; without a potential those of its vibrations."""
        self._factorise_at(here)
        counted = int(self._body.comm.allreduce(int(np.count_nonzero(self._weights[self._free]))))
        count = min(count, counted)
        if here.negative is None and self._inertia is not None:
            values, modes = smallest_vibrations(self.solver, self._inertia, count)
        else:
            symmetric = here.negative is not None
            values, modes = smallest_eigenvalues(self.solver, self._free_weights, count, symmetric=symmetric)
        return NearZero(values, self._body.complete(modes), self._round_off)

    def _stiffening(self, here: BodyPoint, along: PathDirection, mode: FloatArray) -> float:
        """m.K'(t)m by a difference of tangents."""
        length = APART / self.largest(along)
        work = []
        for side in (-length, length):
            self._stand(here.before)
            factor = here.factor + side * along.factor
            increment = self._moved(here.increment, side * along.xi, factor)
            matrix = self._loads.tangent(self._loads.outer(factor), increment)
            right, left = matrix.createVecRight(), matrix.createVecLeft()
            right.array[:] = mode
            matrix.mult(right, left)
            work.append(self._body.comm.allreduce(float(mode[self._free] @ left.array_r[self._free])))
        return (work[1] - work[0]) / (2.0 * length)

    @cached_property
    def _free_weights(self) -> FloatArray:
        weights = np.zeros_like(self._weights)
        weights[self._free] = self._weights[self._free]
        return weights

    @cached_property
    def _inertia(self) -> PETSc.Mat | None:
        """The mass matrix, where the unknowns that move are displacements: it is the same in every shape."""
        layout, n = self._body.layout, self._body.n_owned
        displaced = np.zeros(layout.n_local, dtype=bool)
        displaced[layout.displacement_dofs] = True
        turns = bool((layout.kinematic[:n] & ~displaced[:n]).any())
        return None if self._body.comm.allreduce(turns, op=MPI.LOR) else self._body.mass()

    @cached_property
    def _others(self) -> NDArray[np.bool_]:
        """(owned dofs,) which are neither displacement nor rotation."""
        others: NDArray[np.bool_] = np.zeros(self._body.n_owned, dtype=bool)
        others[self._free] = ~self._body.layout.kinematic[: self._body.n_owned][self._free]
        return others
