"""Slow loading of a body with history: a sequence of equilibria, with a step that follows Newton's success."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.continuation.strides import stride_along
from flexmbd.continuum import parallel
from flexmbd.continuum.history.applied_loads import AppliedLoads
from flexmbd.continuum.history.displacement_newton import (
    DEFAULT_CONVERGENCE,
    Balance,
    Convergence,
    Newton,
    Solution,
)
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.locking_bodies import tell_locking_body
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import DEFAULT_SOLVER, LinearSolver
from flexmbd.continuum.history.trial_errors import LargeIncrementError
from flexmbd.continuum.slow_loading.loading import LoadPath, SlowLoads
from flexmbd.errors import ConvergenceError, FormulationError, MeshError, PathError
from flexmbd.given import checked

FloatArray = NDArray[np.float64]

_FEW = 10  # residuals: a step that takes fewer makes the next one longer
_LONGER, _LARGER = 1.5, 1.1  # by how much, and by how much the largest step grows back with each


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An accepted step.

    Attributes:
        t: its load parameter.
        residuals: of Newton's method, relative.
        reactions: (prescribed dofs of this rank,) N.
    """

    t: float
    residuals: tuple[float, ...]
    reactions: FloatArray

    __repr__ = brief


@dataclass(eq=False)
class StaticPath:
    """The equilibria of a slow loading, and the iterations that they took.

    Attributes:
        steps: the accepted ones.
        cuts: how often a step was halved.
        factorisations: of tangents.
        iterations: of Krylov's method.
    """

    steps: list[Equilibrium] = field(default_factory=list)
    cuts: int = 0
    factorisations: int = 0
    iterations: int = 0


@checked(error=MeshError, agree=parallel.told_to_all)
def prescribed_dofs(body: NonlinearModel, groups: Mapping[str, str]) -> NDArray[np.int32]:
    """Owned dofs of facet groups whose displacement is prescribed along axes. Collective.

    Args:
        body: the body.
        groups: by the name of a facet group the axes along which it is prescribed, as "x" or "xyz".

    Raises:
        MeshError: on all ranks: no such facet group, or other axes.
    """
    found = [np.empty(0, dtype=np.int32)]
    for name, axes in groups.items():
        wrong = set(axes) - set("xyz")
        if wrong or not axes:
            raise MeshError(f"facet group {name!r} is prescribed along {axes!r}; give axes out of 'xyz'")
        nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(name))
        found += [body.displacement_dofs[nodes, "xyz".index(axis)] for axis in axes]
    dofs = np.unique(np.concatenate(found)).astype(np.int32)
    return dofs[dofs < body.n_owned]


@checked(error=MeshError, agree=parallel.told_to_all)
def clamped_dofs(body: NonlinearModel, groups: Iterable[str]) -> NDArray[np.int32]:
    """Owned dofs of facet groups that do not move at all, nor turn where there are rotations. Collective.

    Raises:
        MeshError: on all ranks: no such facet group.
    """
    found: list[NDArray[np.int32]] = [np.empty(0, dtype=np.int32)]
    for name in groups:
        found.append(body.layout.kinematic_dofs_on(body.mesh.dim - 1, body.mesh.facets(name)))
    dofs = np.unique(np.concatenate(found)).astype(np.int32)
    return dofs[dofs < body.n_owned]


@checked(but=("prescribed",), error=FormulationError, agree=parallel.told_to_all)
def follow(
    body: NonlinearModel,
    times: Sequence[float],
    *,
    prescribed: NDArray[np.int32],
    displacement: LoadPath | None = None,
    load: LoadPath | None = None,
    loads: Sequence[BodyLoad] = (),
    solver: LinearSolver = DEFAULT_SOLVER,
    convergence: Convergence = DEFAULT_CONVERGENCE,
    smallest: float = 1e-4,
    accepted: Callable[[float], None] | None = None,
    reached: float = 0.0,
    seconds: float | None = None,
) -> StaticPath:
    """Load a body slowly. Collective; it starts from the last accepted step.

    Args:
        body: the body, which stands at the last of `times` afterwards.
        times: ascending load parameters of the equilibria that are wanted; the first is a step of its own.
        prescribed: owned dofs whose displacement is given (`prescribed_dofs`).
        displacement: (prescribed dofs,) m, from the undeformed body, at a load parameter; zero if None.
        load: (owned dofs,) N, dead loads in body axes; none if None.
        loads: further ones, dead or following the surface; their factors are functions of the load parameter.
        solver: of the linear systems.
        convergence: of Newton's method.
        smallest: the smallest part of a step between two of `times` that is tried.
        accepted: is called after each of `times`.
        reached: load parameter at which the body stands, as one that `load_body` has brought back.
        seconds: s, that the load parameter takes to grow by one; needed where forces depend on rates, and of no matter
            elsewhere.

    Raises:
        FormulationError: on all ranks: as `SlowLoads`; forces depend on rates, and `seconds` is not given; it is not
            positive.
        SceneError, MeshError: on all ranks: as `AppliedLoads`, or a factor is not finite.
        PathError: on all ranks: Newton's method failed with the smallest step, or a formulation does not integrate
            it well; says where, and why. Or `times` do not ascend from above `reached`.
    """
    pace = _pace(body, seconds)
    whole = SlowLoads(body, prescribed, displacement, load, AppliedLoads(body, loads))
    tell_locking_body(body, whole.is_held)
    newton = Newton(body, prescribed, solver=solver, convergence=convergence, predicts=True, still=True)
    path = StaticPath()
    if not all(np.diff([reached, *times]) > 0.0):
        raise PathError(f"times must ascend from above {reached:g}, got {list(times)}", path)
    loading = _Loading(newton, whole, path, pace)
    for target in times:
        loading.largest = interval = target - reached
        reached = stride_along(loading.attempt, reached, target, first=interval, least=smallest * interval)
        path.factorisations, path.iterations = newton.linear.factorisations, newton.linear.iterations
        if reached < target:
            raise PathError(
                f"the loading stopped at the load parameter {reached:.6g} on its way to {target:.6g}, and the "
                f"body keeps the state there: {loading.failure}",
                path,
            ) from loading.failure
        if accepted is not None:
            accepted(target)
    return path


class _Loading:
    """Strides of a slow loading: each is one step of the body. All of it is collective.

    Attributes:
        largest: stride that is taken at present.
        failure: of the last stride that failed.
    """

    def __init__(self, newton: Newton, loads: SlowLoads, path: StaticPath, pace: float) -> None:
        self._newton, self._loads, self._path, self._pace = newton, loads, path, pace
        self._guess: FloatArray = np.zeros(loads.body.layout.n_local)
        self._before = 0.0
        self.largest = 0.0
        self.failure = ConvergenceError()

    def attempt(self, reached: float, t: float) -> float | None:
        """One step of the body, which is accepted if it succeeds; see `strides`."""
        body, stride, dt = self._loads.body, t - reached, self._pace * (t - reached)
        try:
            start = self._guess * (stride / self._before) if self._before else self._guess
            solution = equilibrium(self._newton, self._loads, t, start, dt=dt)
            body.check_increment(solution.increment)
            body.commit(solution.increment, dt=dt)
        except ConvergenceError as reason:
            body.revert()
            self._newton.discard_factor()
            self._path.cuts += 1
            self._guess, self.failure = np.zeros_like(self._guess), reason
            if isinstance(reason, LargeIncrementError):  # which does not pass, as a bad first guess does
                self.largest = 0.5 * stride
            return None
        self._before, self._guess = stride, solution.increment
        reactions = solution.balance.residual[self._loads.prescribed]
        self._path.steps.append(Equilibrium(t, solution.residuals, reactions))
        longer = min(_LONGER, self.largest / stride) if len(solution.residuals) < _FEW else 1.0
        self.largest *= _LARGER
        return longer


def _pace(body: NonlinearModel, seconds: float | None) -> float:
    """Seconds that the load parameter takes to grow by one; 0 where time is of no matter."""
    if seconds is None and body.needs_step:
        raise FormulationError(
            f"the forces of {body.form_name} depend on rates, and a loading has no time of its own; give follow "
            "seconds=, the time (s) in which the load parameter grows by one: 1.0 where times are seconds"
        )
    if seconds is not None and not 0.0 < seconds < float("inf"):
        raise FormulationError(f"seconds must be positive and finite, got {seconds!r}")
    return 0.0 if seconds is None else float(seconds)


def equilibrium(
    newton: Newton, loads: SlowLoads, t: float, start: FloatArray, *, dt: float, least: float = 0.0
) -> Solution:
    """Newton's solution of one step, which takes dt (s). Collective.

    Args:
        newton: of the body.
        loads: on it.
        t: load parameter at the step's end.
        start: (local dofs including ghosts,) m, first guess.
        dt: s.
        least: N, that the forces at hand are taken to have at least.

    Raises:
        ConvergenceError: on all ranks: it does not converge.
    """
    outer = loads.outer(t)
    goal = loads.given(t) - loads.body.displacement[loads.prescribed]

    def tangent(increment: FloatArray) -> PETSc.Mat:
        return loads.tangent(outer, increment, dt=dt, predicted=newton.predicts)

    def forces(increment: FloatArray) -> Balance:
        return loads.balance(outer, increment, dt=dt, least=least)

    return newton.solve(start, goal, forces, tangent)
