"""A path of equilibria from where it begins to where it ends, with what lies on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.branch import beside
from flexmbd.continuation.critical import crossings
from flexmbd.continuation.crossing import PathCrossing
from flexmbd.continuation.follow import PathEnd, follow, found_end
from flexmbd.continuation.request import Bounds, Continuation, bounds_of, looked_at
from flexmbd.continuation.space import PathDirection, typical_motion
from flexmbd.continuation.station import Station, station
from flexmbd.errors import ConvergenceError, PathError, SceneError
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.linear.balance import motion_sizes
from flexmbd.multibody.linear.path.corrector import MachinePoint, MachineSpace
from flexmbd.multibody.linear.path.equilibrium_path import CriticalPoint, EquilibriumPath
from flexmbd.multibody.linear.path.loading import Inputs, TimeAsFactor
from flexmbd.multibody.linear.strain_predictor import strain_predictor
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.sides import refuse_other_sides

FloatArray = NDArray[np.float64]

_OFF = 1e-3  # rad, or of the extent: how far a given start may lie from its equilibrium


def equilibrium_path(begin: WorkingPoint, path: Continuation, work: Work, inputs: Inputs) -> EquilibriumPath:
    """Follow the path that goes through an equilibrium, or the other one from a bifurcation.

    Args:
        begin: the equilibrium; its ``t`` is the load factor there.
        path: how far.
        work: scratch of its scene.
        inputs: brings ``work.time`` up to date.

    Raises:
        SceneError: the machine holds what has no paths, its loads do nothing, a motion is held by nothing, or the path
            cannot begin.
        PathError: it cannot be followed to its end; the error has what was found.
    """
    scene = begin.scene
    _refuse_interiors_and_states(scene)
    bounds = bounds_of(path, begin=begin.t)
    loading = TimeAsFactor(scene, inputs)
    strains, rest = strain_predictor(scene.plan, work, scene.nv), np.zeros(scene.nv)
    space = MachineSpace(scene, work, strains, loading, bounds.width, rest, motion_sizes(scene, work, begin.x))
    loading.apply(work, begin.t)
    kept: list[WorkingPoint] = []
    critical: list[CriticalPoint] = []
    if isinstance(begin, CriticalPoint):
        kept.append(begin)
        met = PathDirection(begin.tangent[:-1], float(begin.tangent[-1]))
        space = replace(space, typical=begin.typical)
        there = space.at(begin.x, begin.t)
        first = beside(space, there, path, kind=begin.kind, mode=begin.mode, tangent=met)
    else:
        space, first = _first(space, begin, bounds, side=path.side)
    kept.append(_working_point(scene, first))
    closes = False
    try:
        for stretch in follow(space, first, bounds, locate=crossings):
            critical += [_critical_point(scene, one, space.typical) for one in stretch.met]
            kept.append(_working_point(scene, stretch.after))
            closes = stretch.closes
    except (ConvergenceError, SceneError) as reason:
        raise PathError(str(reason), EquilibriumPath(tuple(kept), tuple(critical), PathEnd.LOST)) from reason
    end = found_end([one.t for one in kept], [one.t for one in critical], bounds, closes=closes)
    return EquilibriumPath(tuple(kept), tuple(critical), end)


def _refuse_interiors_and_states(scene: CompiledScene) -> None:
    """Raise SceneError for what paths are not followed of."""
    if scene.interiors is not None:
        raise SceneError(
            "a path of equilibria is not followed of a scene with bodies with history; load such a body by itself "
            "(flexmbd.continuum.equilibrium_path), or reduce it"
        )
    if scene.state_mask.any():
        raise SceneError(
            "a path of equilibria is not followed of a scene with states of users' equations; leave them out, or find "
            "single equilibria at one time after the other (t=, about=)"
        )


def _first(
    space: MachineSpace, begin: WorkingPoint, bounds: Bounds, *, side: int
) -> tuple[MachineSpace, Station[MachinePoint]]:
    """The space by what is typical there, and the first station, from which the factor goes towards ``to`` or away."""
    scene, onwards = space.scene, space.along_factor(side * np.sign(bounds.to - begin.t))
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
    space = replace(space, typical=typical_motion(space, space.tangent(point, onwards)))
    return space, station(space, point, onwards)


def _does_anything(space: MachineSpace, there: MachinePoint, to: float) -> bool:
    """Whether the factor changes a force along a motion that is free, a place, or what a motion meets (stiffness)."""
    at, by = there.at, there.at.by
    if by.Xu.any() or (by.Vz.T @ there.slopes.force).any():
        return True
    others = [space.at(there.x, place).at for place in looked_at(there.factor, to)]
    return any(
        one.by.Xu.any()
        or not np.array_equal(one.lacking, at.lacking)
        or not np.array_equal(one.stiffness(), at.stiffness())
        for one in others
    )


def _working_point(scene: CompiledScene, here: Station[MachinePoint]) -> WorkingPoint:
    point = here.point
    refuse_other_sides(scene, point.factor, point.x, point.at.v)
    state = (point.factor, point.x, point.at.v, point.at.multipliers, NO_INTERIORS)
    return WorkingPoint(scene, *state, here.spectrum.unstable)


def _critical_point(scene: CompiledScene, one: PathCrossing[MachinePoint], typical: float) -> CriticalPoint:
    point = one.point
    state = (point.factor, point.x, point.at.v, point.at.multipliers, NO_INTERIORS)
    tangent = np.append(one.tangent.xi, one.tangent.factor)
    return CriticalPoint(scene, *state, one.unstable, one.kind, one.mode, tangent, typical)
