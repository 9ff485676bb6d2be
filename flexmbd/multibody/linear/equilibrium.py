"""Equilibria and steady motions by Newton's method, downhill where the machine is unstable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuation.follow import follow
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.station import station
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS, InteriorSnapshot
from flexmbd.multibody.interiors.steady import steady
from flexmbd.multibody.kernels.base.arrays import Work, memories_end
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.linear.balance import ForceBalance, balance, motion_sizes, moved, step_size
from flexmbd.multibody.linear.path.corrector import MachineSpace
from flexmbd.multibody.linear.path.loading import LackingTakenAway
from flexmbd.multibody.linear.stability import has_potential, spectrum
from flexmbd.multibody.linear.steadiness import refuse_changing, refuse_unsteady, start_moving
from flexmbd.multibody.linear.steady_motion import SteadyMotion
from flexmbd.multibody.linear.strain_predictor import StrainPredictor, strain_predictor
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.sides import refuse_other_sides
from flexmbd.overflow import refuse_overflow

FloatArray = NDArray[np.float64]

_ITERATIONS = 200
_STEP = 0.3  # rad, or of the machine's extent: the longest step
_CONVERGED = 1e-9  # a step of this size (rad, or of the extent) is Newton's last but one
_NOTHING = 1e-9  # of the forces at play: what counts as balanced along motions that nothing resists
_HALVINGS = 8
_SLOPE = 0.9  # of the work that forces do along a step at its beginning: what they may do against it at its end
_LEAVE = 0.01  # rad, or of the extent: by how much an unstable equilibrium that was met on the way is left


@dataclass(frozen=True, eq=False)
class _Machine:
    """The scene, scratch with its functions of time, strains of its bodies, and what is a large motion (nv,)."""

    scene: CompiledScene
    work: Work
    strains: StrainPredictor
    sizes: FloatArray


@dataclass(frozen=True, eq=False)
class _Step:
    """A step (nv,), how many motions are unstable about its start, and the most unstable or softest of them (nv,)."""

    along: FloatArray
    unstable: int
    softest: FloatArray


@refuse_overflow("an equilibrium")
def find_equilibrium(start: Start, work: Work) -> WorkingPoint:
    """The equilibrium, or the steady motion with the start's velocities, that lies downhill of the start.

    With states of users' equations it is where these rest as well, found by Newton's steps alone, for what they do has
    no energy: it may be unstable, and what is unstable is not counted.

    Near it these are Newton's steps, in which the strains of slender bodies are unknowns of their own
    (`strain_predictor`); a step is cut where at its end the forces would push back, for beyond it energy rises. Where
    the machine is unstable, directions of negative stiffness are taken downhill, so that not the nearest equilibrium is
    found but one that the machine would settle in. An unstable one that is met on the way is left along its most
    unstable motion; a start that is one is kept.

    Forces that follow what they act on have no potential.  What the symmetric part of the stiffness calls downhill
    leads to an equilibrium where they are small; where it does not, the forces that the start lacks are let go along a
    path of equilibria (Newton's homotopy), whose end may be unstable.  What grows is counted by the whole stiffness.

    Args:
        start: the consistent start.
        work: scratch; ``work.time`` holds the functions of time.

    Raises:
        SceneError: nothing balances; the message names the coordinate where most is lacking; or what does is no steady
            motion.
    """
    if not start.v.any():
        return _search(start, work, SteadyMotion(start.scene))
    motion, v = start_moving(start, work)
    try:
        found = _search(replace(start, v=v), work, motion)
    except (SceneError, np.linalg.LinAlgError) as reason:
        if start.scene.interiors is None:  # which tell by themselves that they turn
            refuse_changing(start, v, work, motion, reason)
        raise
    found = replace(found, steady_accelerations=motion.accelerations(work, found.x))
    refuse_unsteady(found, work, motion, balance(found.scene, work, found.x, found.v, motion=motion).of)
    return found


def _search(start: Start, work: Work, motion: SteadyMotion) -> WorkingPoint:
    """As ``find_equilibrium``, whether or not the motion is steady."""
    scene = start.scene
    sizes = motion_sizes(scene, work, start.x)
    machine = _Machine(scene, work, strain_predictor(scene.plan, work, scene.nv), sizes)
    here = balance(scene, work, start.x, start.v, motion=motion)
    plain = scene.interiors is None and not scene.state_mask.any() and not start.v.any()
    if not plain or has_potential(scene, here):
        return _downhill(machine, here)
    try:
        found = _downhill(machine, here)
    except SceneError:
        return _without_potential(machine, here)
    return replace(found, unstable=spectrum(scene, balance(scene, work, found.x, found.v)).unstable)


def _downhill(machine: _Machine, here: ForceBalance) -> WorkingPoint:
    """The equilibrium downhill of a state, as ``find_equilibrium`` says."""
    scene, work = machine.scene, machine.work
    predicted = machine.strains.at(here.x)
    for i in range(_ITERATIONS):
        step = _newton_step(scene, here, machine.strains.stiffness(here.x, predicted - machine.strains.at(here.x)))
        size = step_size(machine.sizes, step.along)
        longest = step_size(machine.sizes, np.where(scene.state_mask, 0.0, step.along))
        if size <= _CONVERGED and (step.unstable == 0 or i == 0):
            if step.unstable == 0:
                here, _ = _take_step(machine, here, step.along, predicted, searches=False)
            t, kept = float(work.time[-1, 0]), _committed(scene)
            x = here.x.copy()
            if memories_end(scene.plan):
                remember(scene.plan, work, x, here.v, t)
            unstable = None if scene.state_mask.any() else step.unstable
            refuse_other_sides(scene, t, x, here.v)
            return WorkingPoint(scene, t, x, here.v, here.multipliers, kept, unstable)
        if size <= _CONVERGED:
            along = step.softest * (_LEAVE / step_size(machine.sizes, step.softest))
        else:
            along = step.along * min(1.0, _STEP / max(longest, 1e-300))
        searches = step.unstable == 0 and not scene.state_mask.any()
        here, predicted = _take_step(machine, here, along, predicted, searches=searches)
    worst = int(np.argmax(np.abs(here.lacking) / np.sqrt(np.diag(here.mass))))
    name = scene.velocity_names[here.by.z[worst]]
    raise SceneError(
        f"no equilibrium found in {_ITERATIONS} steps: at {name!r} a force of {-here.lacking[worst]:.6g} (N, N m, or "
        "modal) stays unbalanced; check that something carries this load, or start nearer to the equilibrium, as from "
        "one under a part of the load (about=)"
    )


def equilibrium_at_rest(start: Start, work: Work) -> WorkingPoint:
    """As ``find_equilibrium``, with prescribed motions held still where they are."""
    work.time[:-1, 1:] = 0.0
    return find_equilibrium(replace(start, v=np.zeros_like(start.v)), work)


def _take_step(
    machine: _Machine, here: ForceBalance, step: FloatArray, predicted: FloatArray, *, searches: bool
) -> tuple[ForceBalance, FloatArray]:
    """Where a step leads, and the strains there by the step's linear equations.

    It is halved until interiors find their balance there and, if it searches, the forces no longer push back.
    """
    scene, strains = machine.scene, machine.strains
    along = step[here.by.z]
    linear = strains.at(here.x) + strains.change(here.x, step)
    failure: SceneError | None = None
    for halvings in range(_HALVINGS + 1):
        part = 0.5**halvings
        change = step * part
        x = moved(scene, machine.work, here.x, np.where(scene.state_mask, 0.0, change))
        try:
            v = here.v + np.where(scene.state_mask, change, 0.0)
            there = balance(scene, machine.work, x, v, motion=here.motion)
        except SceneError as reason:
            if scene.interiors is None:
                raise
            failure = reason
            continue
        failure, then = None, predicted + part * (linear - predicted)
        # other coordinates are the independent ones there: no work along the step to be compared
        if not searches or not np.array_equal(there.by.z, here.by.z):
            break
        open_forces = there.lacking + there.by.Vz.T @ strains.force(there.x, then - strains.at(there.x))
        if open_forces @ along <= _SLOPE * abs(here.lacking @ along):
            break
    if failure is not None:
        raise SceneError(f"no equilibrium found: on the way to it {failure}") from failure
    return there, then


def _committed(scene: CompiledScene) -> InteriorSnapshot:
    """The memories of bodies with history in balance: those of their last trial."""
    if scene.interiors is None:
        return NO_INTERIORS
    for body in scene.interiors.bodies:
        steady(body).commit()
    return scene.interiors.snapshot(scene.plan)


def _without_potential(machine: _Machine, start: ForceBalance) -> WorkingPoint:
    """The equilibrium that a path leads to on which the forces that a start lacks are let go."""
    scene, work, strains = machine.scene, machine.work, machine.strains
    space = MachineSpace(scene, work, strains, LackingTakenAway(start.open_force()), 1.0, start.v, machine.sizes)
    bounds = Bounds(to=1.0, back_to=-1.0, longest=_STEP, points=_ITERATIONS)
    onwards = space.along_factor(1.0)
    here = station(space, space.at(start.x, 0.0), onwards)
    try:
        for stretch in follow(space, here, bounds):
            here = stretch.after
    except ConvergenceError as reason:
        raise SceneError(str(reason)) from reason
    if here.point.factor != 1.0:
        raise SceneError(
            f"no equilibrium found: as the loads grow, on a path of {_ITERATIONS} points at most, they come to "
            f"{here.point.factor:.3g} of their size and no further; look at the path by "
            "scene.equilibrium(path=fm.Continuation(...))"
        )
    point = here.point
    t = float(work.time[-1, 0])
    refuse_other_sides(scene, t, point.x, point.at.v)
    return WorkingPoint(scene, t, point.x, point.at.v, point.at.multipliers, NO_INTERIORS, here.spectrum.unstable)


def _newton_step(scene: CompiledScene, here: ForceBalance, more: FloatArray) -> _Step:
    """Newton's own step where nothing is unstable.

    Along vibrations of negative stiffness it goes the other way, and along those without any it goes nowhere if they
    are balanced.

    Args:
        scene: the machine.
        here: the unbalanced forces.
        more: (nv, nv) stiffness beside that of the state.
    """
    if scene.state_mask.any():
        return _Step(_full_newton_step(scene, here, more), 0, np.zeros(scene.nv))
    Vz = here.by.Vz
    stiffness = Vz.T @ (here.of.stiffness + more) @ Vz
    if not len(stiffness):
        return _Step(np.zeros(scene.nv), 0, np.zeros(scene.nv))
    rates, shapes = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), here.mass)
    floor = len(rates) * 1e-15 * float(np.abs(rates).max())
    unstable = int((rates < -floor).sum())
    idle = np.abs(rates) <= floor
    pull, parts = shapes.T @ here.lacking, np.abs(shapes).T @ here.parts
    pull[idle & (np.abs(pull) <= _NOTHING * parts)] = 0.0
    if unstable == 0 and not idle.any():
        step = -np.linalg.solve(stiffness, here.lacking)
    else:
        step = -shapes @ (pull / np.maximum(np.abs(rates), max(floor, 1e-300)))
    return _Step(Vz @ step, unstable, Vz @ shapes[:, 0])


def _full_newton_step(scene: CompiledScene, here: ForceBalance, more: FloatArray) -> FloatArray:
    """Newton's own step (nv,) of places and of states, the shortest where nothing tells some of them."""
    slopes, states = here.of.stiffness + more, scene.state_mask
    slopes[:, states] = here.of.damping[:, states]
    size = coordinate_sizes(scene)
    Vz = here.by.Vz
    matrix = Vz.T @ slopes @ Vz * size[here.by.z]
    rows = np.abs(matrix).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    found = np.linalg.lstsq(matrix / rows[:, None], here.lacking / rows, rcond=None)[0]
    return np.asarray(Vz @ (-found * size[here.by.z]), dtype=np.float64)
