"""A path of equilibria from where it begins to where it ends, with what lies on it."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ConvergenceError, PathWarning, SceneError, warn
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.linear.balance import motion_sizes
from flexmbd.multibody.linear.path.corrector import PathDirection, PathPoint, PathSpace, until
from flexmbd.multibody.linear.path.critical import CriticalKind, PathCrossing, crossings
from flexmbd.multibody.linear.path.equilibrium_path import Continuation, CriticalPoint, EquilibriumPath
from flexmbd.multibody.linear.path.follow import Bounds, PathEnd, Station, Stretch, follow, station
from flexmbd.multibody.linear.path.loading import Inputs, TimeAsFactor
from flexmbd.multibody.linear.strain_predictor import strain_predictor
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_OFF = 1e-3  # rad, or of the extent: how far a given start may lie from its equilibrium
_HALVINGS = 12


def equilibrium_path(begin: WorkingPoint, path: Continuation, work: Work, inputs: Inputs) -> EquilibriumPath:
    """Follow the path that goes through an equilibrium, or the other one from a bifurcation.

    Args:
        begin: the equilibrium; its ``t`` is the load factor there.
        path: how far.
        work: scratch of its scene.
        inputs: brings ``work.time`` up to date.

    Raises:
        SceneError: the machine holds what has no paths, its loads do nothing, a motion is held by nothing, or the path
            cannot be followed.
    """
    scene = begin.scene
    _refuse_interiors_and_states(scene)
    bounds = _bounds(begin.t, path)
    width = abs(bounds.to - bounds.back_to)
    loading = TimeAsFactor(scene, inputs)
    strains, rest = strain_predictor(scene.plan, work, scene.nv), np.zeros(scene.nv)
    space = PathSpace(scene, work, strains, loading, width, rest, motion_sizes(scene, work, begin.x))
    loading.apply(work, begin.t)
    kept: list[WorkingPoint] = []
    critical: list[CriticalPoint] = []
    if isinstance(begin, CriticalPoint):
        kept.append(begin)
        first = _beside(space, begin, path)
        kept.append(_working_point(scene, first))
    else:
        first = _first(space, begin, bounds)
        kept.append(_working_point(scene, first))
    for stretch in follow(space, first, bounds):
        critical += [_critical_point(scene, one) for one in _found(space, stretch)]
        kept.append(_working_point(scene, stretch.after))
    end = _end(kept[-1].t, bounds)
    if end is not PathEnd.REACHED:
        warn(_told(kept, bounds, end), PathWarning)
    return EquilibriumPath(tuple(kept), tuple(critical), end)


def _bounds(begin: float, path: Continuation) -> Bounds:
    if path.to == begin:
        raise SceneError(f"the path ends at the load factor {path.to:g} at which it begins; give another one to go to")
    back_to = 2.0 * begin - path.to if path.back_to is None else path.back_to
    if (back_to - begin) * (path.to - begin) >= 0.0:
        raise SceneError(
            f"back_to = {back_to:g} does not lie on the other side of the start, {begin:g}, than to = {path.to:g}"
        )
    return Bounds(path.to, back_to, path.longest_step, path.most_points)


def _refuse_interiors_and_states(scene: CompiledScene) -> None:
    """Raise SceneError for what paths are not followed of."""
    if scene.interiors is not None:
        raise SceneError(
            "a path of equilibria is not followed of a scene with bodies with history; load such a body by itself "
            "(flexmbd.continuum.follow), or reduce it"
        )
    if scene.state_mask.any():
        raise SceneError(
            "a path of equilibria is not followed of a scene with states of users' equations; leave them out, or find "
            "single equilibria at one time after the other (t=, about=)"
        )


def _first(space: PathSpace, begin: WorkingPoint, bounds: Bounds) -> Station:
    """The first station, from which the factor goes towards ``to``."""
    scene, onwards = space.scene, space.along_factor(np.sign(bounds.to - begin.t))
    there = space.at(begin.x, begin.t)
    if not _does_anything(space, there, bounds.to):
        raise SceneError(
            "the loads do nothing as the factor grows: functions of time scale them, as in "
            "JointForce(joint, lambda t: 100.0 * t), and none acts on what can move"
        )
    found = space.spectrum(there)
    if found.idle.any():
        shape = np.abs(found.mode(int(np.argmax(found.idle))) / space.size)
        raise SceneError(
            f"nothing resists the motion of {scene.velocity_names[int(np.argmax(shape))]!r}: the machine is a "
            "mechanism there, without a path of single equilibria; hold it by a spring, a joint or a prescribed motion"
        )
    step = space.newton_step(there, onwards)
    if space.largest(step) > _OFF:
        raise SceneError(
            f"`about` is no equilibrium of this scene at the factor {begin.t:g}: a step of {space.largest(step):.3g} "
            "(rad, or of the machine's extent) leads to the nearest one; find it first (t=)"
        )
    point = space.correct(there, step, onwards) if space.largest(step) > 0.0 else there
    return station(space, point, onwards)


def _does_anything(space: PathSpace, there: PathPoint, to: float) -> bool:
    """Whether the factor changes a force along a motion that is free, a place, or what a motion meets (stiffness)."""
    by = there.at.by
    if by.Xu.any() or (by.Vz.T @ there.slopes.force).any():
        return True
    return not np.array_equal(there.at.stiffness(), space.at(there.x, to).at.stiffness())


def _beside(space: PathSpace, begin: CriticalPoint, path: Continuation) -> Station:
    """A station on the other path through a bifurcation, or on the same beyond a limit point."""
    # of length 1 in the range of factors that it was found in, not in this one
    there, tangent = space.at(begin.x, begin.t), space.unit(PathDirection(begin.tangent[:-1], float(begin.tangent[-1])))
    direction = across = tangent
    if begin.kind is CriticalKind.BIFURCATION:
        direction = space.other_path(there, PathDirection(begin.mode, 0.0), tangent)
        # no point of the first path lies in a plane along it
        across = space.unit(direction.plus(tangent.times(-space.product(direction, tangent))))
    direction, across = direction.times(float(path.side)), across.times(float(path.side))
    share = path.longest_step / space.largest(direction)
    for _ in range(_HALVINGS):
        point = until(partial(space.correct, there, direction.times(share), across))
        if point is not None:
            found = station(space, point, direction)
            if space.product(found.tangent, direction) > 0.5:
                return found
        share *= 0.5
    raise SceneError(
        f"no other path was found from the {begin.kind.value} at the factor {begin.t:.6g} along its mode; several "
        "modes may meet there: take a smaller longest_step, or disturb the machine by a small force"
    )


def _found(space: PathSpace, stretch: Stretch) -> list[PathCrossing]:
    try:
        return crossings(space, stretch)
    except ConvergenceError as reason:
        raise SceneError(
            f"a critical point of the path between the factors {stretch.before.point.factor:.6g} and "
            f"{stretch.after.point.factor:.6g} could not be located: {reason}; take a smaller longest_step"
        ) from reason


def _end(factor: float, bounds: Bounds) -> PathEnd:
    if factor == bounds.to:
        return PathEnd.REACHED
    return PathEnd.TURNED_BACK if factor == bounds.back_to else PathEnd.POINTS


def _told(kept: list[WorkingPoint], bounds: Bounds, end: PathEnd) -> str:
    factors = [one.t for one in kept]
    most = max(factors) if bounds.to > bounds.back_to else min(factors)
    if end is PathEnd.TURNED_BACK:
        return (
            f"the path of equilibria turned at the factor {most:.6g}, came back to {bounds.back_to:.6g} and ends "
            f"there: it never reached {bounds.to:.6g}; back_to= lets it go on"
        )
    return (
        f"the path of equilibria was broken off after {len(kept)} points at the factor {factors[-1]:.6g}, on the way "
        f"to {bounds.to:.6g}, of which it came as near as {most:.6g}; most_points= lets it go on"
    )


def _working_point(scene: CompiledScene, here: Station) -> WorkingPoint:
    point = here.point
    state = (point.factor, point.x, point.at.v, point.at.multipliers, NO_INTERIORS)
    return WorkingPoint(scene, *state, here.spectrum.unstable)


def _critical_point(scene: CompiledScene, one: PathCrossing) -> CriticalPoint:
    point = one.point
    state = (point.factor, point.x, point.at.v, point.at.multipliers, NO_INTERIORS)
    tangent = np.append(one.tangent.xi, one.tangent.factor)
    return CriticalPoint(scene, *state, one.unstable, one.kind, one.mode, tangent)
