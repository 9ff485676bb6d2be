"""Paths of equilibria of one body with history, along their arc, through limit points and bifurcations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.continuation.branch import beside
from flexmbd.continuation.critical import crossings
from flexmbd.continuation.crossing import CriticalKind, PathCrossing
from flexmbd.continuation.follow import PathEnd, follow, found_end
from flexmbd.continuation.found_path import FoundPath, told
from flexmbd.continuation.request import Bounds, Continuation, bounds_of
from flexmbd.continuation.space import PathDirection, typical_motion
from flexmbd.continuation.station import Station, station
from flexmbd.continuum import parallel
from flexmbd.continuum.history.applied_loads import AppliedLoads
from flexmbd.continuum.history.displacement_newton import DEFAULT_CONVERGENCE, Convergence, Newton
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.locking_bodies import tell_locking_body
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot, NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.matrices.blocks import inner
from flexmbd.continuum.slow_loading.body_path_space import BodyPathSpace
from flexmbd.continuum.slow_loading.body_point import BodyPoint
from flexmbd.continuum.slow_loading.loading import LoadPath, SlowLoads
from flexmbd.continuum.slow_loading.static_path import equilibrium
from flexmbd.errors import ConvergenceError, FormulationError, PathError, SceneError
from flexmbd.given import checked
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]



@dataclass(frozen=True, eq=False)
class BodyEquilibrium:
    """An equilibrium of a body on a path.

    Attributes:
        t: its load factor.
        displacement: (local dofs including ghosts,) m, from the undeformed body.
        reactions: (prescribed dofs of this rank,) N.
        unstable: how many independent motions grow from it: with none it is stable.
        iterations: of Newton's method.
    """

    t: float
    displacement: FloatArray
    reactions: FloatArray
    unstable: int
    iterations: int

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class BodyCriticalPoint:
    """An equilibrium of a body at which a path turns, branches or begins to flutter; ``about=`` goes on from it.

    Attributes:
        t: its load factor.
        kind: which of these it is.
        mode: (owned dofs,) in which the body gives way; the largest is 1 rad or the body's extent.
        tangent: (owned dofs + 1,) of the path that it was found on: changes of the dofs, last that of the factor.
        unstable: how many motions are unstable behind it.
        state: the body's state there, for ``NonlinearModel.restore``.
        typical: of the extent, what counted as much on the path as its range of factors.
    """

    t: float
    kind: CriticalKind
    mode: FloatArray
    tangent: FloatArray
    unstable: int
    state: HistorySnapshot
    typical: float

    def __repr__(self) -> str:
        """Its kind and factor."""
        return told(self)


@dataclass(frozen=True, eq=False, repr=False)
class BodyPath(FoundPath[BodyEquilibrium, BodyCriticalPoint]):
    """Equilibria of a body one after the other, as its loads grow and fall.

    Attributes:
        points: the equilibria; the body stands at the last of them.
        critical: limit points, bifurcations and onsets of flutter among them, in their order; located to 1e-7 of the
            step in which they lie, or as exactly as round-off lets them be.
        end: why the path ends.
        factorisations: of tangents, that it took.
    """

    factorisations: int


@checked(but=("prescribed",), error=FormulationError, agree=parallel.told_to_all)
def equilibrium_path(
    body: NonlinearModel,
    path: Continuation,
    *,
    prescribed: NDArray[np.int32],
    displacement: LoadPath | None = None,
    load: LoadPath | None = None,
    loads: Sequence[BodyLoad] = (),
    convergence: Convergence = DEFAULT_CONVERGENCE,
    accepted: Callable[[float], None] | None = None,
    reached: float = 0.0,
    about: BodyCriticalPoint | None = None,
) -> BodyPath:
    """Follow the equilibria of a body as a load factor grows and falls, along the arc of their path. Collective.

    Where the load has a maximum, as when a panel snaps through, the factor turns and the path goes on; where the
    stiffness becomes singular another path may cross.  Both are located, as are onsets of flutter where loads have no
    potential; of a body with rotations, as of a beam, flutter is not seen.  A closed path is gone round once.

    Args:
        body: the body, which stands at the last point of the path afterwards.
        path: how far the factor goes, and how long steps may be.
        prescribed: owned dofs whose displacement is given (`prescribed_dofs`).
        displacement: (prescribed dofs,) m, from the undeformed body, at a factor; zero if None.
        load: (owned dofs,) N, dead loads in body axes, at a factor; none if None.
        loads: further ones, dead or following the surface; their factors are functions of the load factor.
        convergence: of Newton's method.
        accepted: is called after each further point, with its load factor; the body stands there.
        reached: load factor at which the body stands.
        about: a critical point of a path of this body under these loads: from a bifurcation the path that crosses.

    Returns:
        The path.

    Raises:
        FormulationError: on all ranks: as `SlowLoads`; forces depend on rates.
        SceneError, MeshError: on all ranks: as `AppliedLoads`; a factor is not finite; the bounds have no sense; the
            loads do not change; the body is not held; no other path was found.
        PathError: on all ranks: no equilibrium at the start, or the path cannot be followed to its end; it has what was
            found, and the body stands at the last point of it.

    Warns:
        PathWarning: the path is closed, turned back, or was broken off, before the factor that was asked for.
    """
    _refuse_rates(body)
    whole = SlowLoads(body, prescribed, displacement, load, AppliedLoads(body, loads))
    _refuse_unheld(body, prescribed)
    tell_locking_body(body, whole.is_held)
    begin = reached if about is None else about.t
    bounds, sign = bounds_of(path, begin=begin), path.side * float(np.sign(path.to - begin))
    found = _GrowingPath(body, BodyPathSpace(whole, bounds.width, convergence))
    try:
        if about is None:
            first = _first(found.space, whole, convergence, bounds, begin=begin, sign=sign)
        else:
            first = found.beside(about, path)
        return found.along(first, bounds, accepted)
    except ConvergenceError as reason:
        raise PathError(str(reason), found.path(PathEnd.LOST)) from reason
    finally:  # of whatever was tried, as when it is interrupted
        body.restore(found.last)


class _GrowingPath:
    """What is found of a path, and the state at its end so far."""

    def __init__(self, body: NonlinearModel, space: BodyPathSpace) -> None:
        self._body, self.space = body, space
        self.points: list[BodyEquilibrium] = []
        self.critical: list[BodyCriticalPoint] = []
        self.last = body.snapshot()

    def beside(self, about: BodyCriticalPoint, path: Continuation) -> Station[BodyPoint]:
        """The station beside a critical point, which is kept."""
        self._body.restore(about.state)
        self.space.typical = about.typical
        there = self.space.standing_where_it_gives_way(about.t)
        self.keep(there, about.unstable)  # of an eigenvalue that is zero round-off chooses the sign
        met = PathDirection(about.tangent[:-1], float(about.tangent[-1]))
        return beside(self.space, there, path, kind=about.kind, mode=about.mode, tangent=met)

    def keep(self, here: BodyPoint, unstable: int) -> None:
        self.last = here.state
        place = self.last.displacement.copy()
        self.points.append(BodyEquilibrium(float(here.factor), place, here.reactions, unstable, here.iterations))

    def along(self, first: Station[BodyPoint], bounds: Bounds, accepted: Callable[[float], None] | None) -> BodyPath:
        """Follow the path from its first station on; the body stands at each point when it is ``accepted``."""
        self.keep(first.point, first.spectrum.unstable)
        closes = False
        for stretch in follow(self.space, first, bounds, locate=crossings):
            self.critical += [self._critical_point(one) for one in stretch.met]
            self.keep(stretch.after.point, stretch.after.spectrum.unstable)
            self._body.restore(self.last)
            closes = stretch.closes
            if accepted is not None:
                accepted(stretch.after.point.factor)
        factors, met = ([one.t for one in some] for some in (self.points, self.critical))
        return self.path(found_end(factors, met, bounds, closes=closes))

    def _critical_point(self, one: PathCrossing[BodyPoint]) -> BodyCriticalPoint:
        """With the state that the body would have there."""
        state = self.space.remembered(one.point, one.point.factor).state
        tangent = np.append(one.tangent.xi, one.tangent.factor)
        return BodyCriticalPoint(
            one.point.factor, one.kind, one.mode, tangent, one.unstable, state, self.space.typical
        )

    def path(self, end: PathEnd) -> BodyPath:
        return BodyPath(tuple(self.points), tuple(self.critical), end, self.space.solver.factorisations)


def _first(
    space: BodyPathSpace,
    loads: SlowLoads,
    convergence: Convergence,
    bounds: Bounds,
    *,
    begin: float,
    sign: float,
) -> Station[BodyPoint]:
    """The station where the body stands, in balance, from which the factor grows or falls."""
    body = loads.body
    solver = LinearSolver(0)
    newton = Newton(body, loads.prescribed, solver=solver, convergence=convergence, predicts=True, still=True)
    try:
        still: FloatArray = np.zeros(body.layout.n_local)
        least = space.load_size(still, begin)
        rest = equilibrium(newton, loads, begin, still, dt=0.0, least=least)
        body.commit(rest.increment, dt=0.0)
    except ConvergenceError as reason:
        raise ConvergenceError(
            f"the body finds no equilibrium at the factor {begin:g} at which the path begins: {reason}; load it there "
            "first (flexmbd.continuum.follow)"
        ) from reason
    here = space.standing(begin)
    if not space.does_anything(here, bounds.to):
        raise SceneError(
            "the loads do not change with the load factor: make load=, displacement= or the factors of loads= "
            "functions of it"
        )
    onwards = space.along_factor(sign)
    space.typical = typical_motion(space, space.tangent(here, onwards))
    return station(space, here, onwards)


def _refuse_rates(body: NonlinearModel) -> None:
    """Raise FormulationError where forces depend on rates."""
    if body.needs_step:
        raise FormulationError(
            f"the forces of {body.form_name} depend on rates, and a path that turns back has no time; follow the "
            "loading itself (flexmbd.continuum.follow, seconds=)"
        )


def _refuse_unheld(body: NonlinearModel, prescribed: NDArray[np.int32]) -> None:
    """Raise SceneError where the given dofs leave the body a motion as a whole. Collective."""
    if body.springs is not None:  # which hold it as well
        return
    columns = body.layout.rigid_columns(np.zeros(3), np.eye(3))[: body.n_owned]
    held, given = np.zeros_like(columns), np.union1d(prescribed, body.held_dofs).astype(np.int32)
    if body.ties is not None:  # what follows holds nothing by itself
        given = np.setdiff1d(given, body.ties.dofs)
    held[given] = columns[given]
    whole, left = (inner(body.comm, part, part) for part in (columns, held))
    # of each motion, what the given dofs take part in
    if scipy.linalg.eigh(left, whole, eigvals_only=True)[0] <= ROUND_OFF:
        raise SceneError(
            "the body can move as a whole, so that its equilibria are not isolated: give prescribed= dofs that hold it "
            "(prescribed_dofs, clamped_dofs)"
        )
