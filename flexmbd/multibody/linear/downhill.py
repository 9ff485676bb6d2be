"""The search downhill: Newton's steps, turned round where the machine is unstable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.linear.balance import ForceBalance, balance, moved, step_size
from flexmbd.multibody.linear.forces_at_play import forces_at_play
from flexmbd.multibody.linear.strain_predictor import StrainPredictor
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_ITERATIONS = 200
_FEW = 30  # steps of ``newton_cut``
_STEP = 0.3  # rad, or of the machine's extent: the longest step
_CONVERGED = 1e-9  # a step of this size (rad, or of the extent) is Newton's last but one
_NOTHING = 1e-9  # of the forces at play: what counts as balanced along motions that nothing resists
_HALVINGS = 8
_SLOPE = 0.9  # of the work that forces do along a step at its beginning: what they may do against it at its end
_LEAVE = 0.01  # rad, or of the extent: by how much an unstable equilibrium is left


@dataclass(frozen=True, eq=False)
class _Step:
    """A step (nv,), how many motions are unstable about its start, and the most unstable or softest of them (nv,)."""

    along: FloatArray
    unstable: int
    softest: FloatArray


@dataclass(frozen=True, eq=False)
class _Machine:
    """The scene, scratch with its functions of time, strains of its bodies, and what is a large motion (nv,)."""

    scene: CompiledScene
    work: Work
    strains: StrainPredictor
    sizes: FloatArray


def stable_below(
    scene: CompiledScene, work: Work, start: ForceBalance, strains: StrainPredictor, sizes: FloatArray
) -> ForceBalance:
    """The stable equilibrium downhill of a state.

    Near it these are Newton's steps, in which the strains of slender bodies are unknowns of their own
    (`strain_predictor`); a step is cut where at its end the forces would push back, for beyond it energy rises. Where
    the machine is unstable, directions of negative stiffness are taken downhill; an unstable equilibrium is left along
    its most unstable motion.

    Args:
        scene: without states of users' equations.
        work: scratch; ``work.time`` holds the functions of time.
        start: where to begin.
        strains: of its bodies.
        sizes: (nv,) of ``motion_sizes``.

    Raises:
        SceneError: none is found; the message names the coordinate where most is lacking.
    """
    machine, here, predicted = _Machine(scene, work, strains, sizes), start, strains.at(start.x)
    for _ in range(_ITERATIONS):
        step = _newton_step(machine, here, strains.stiffness(here.x, predicted - strains.at(here.x)))
        size = step_size(sizes, step.along)
        if size <= _CONVERGED and step.unstable == 0:
            return _take_step(machine, here, step.along, predicted, searches=False)[0]
        if size <= _CONVERGED:
            along = step.softest * (_LEAVE / step_size(sizes, step.softest))
        else:
            along = step.along * min(1.0, _STEP / size)
        here, predicted = _take_step(machine, here, along, predicted, searches=step.unstable == 0)
    worst = int(np.argmax(np.abs(here.lacking) / np.sqrt(np.diag(here.mass))))
    name = scene.velocity_names[here.by.z[worst]]
    raise SceneError(
        f"no stable equilibrium found in {_ITERATIONS} steps downhill: at {name!r} a force of "
        f"{-here.lacking[worst]:.6g} (N, N m, or modal) stays unbalanced; check that something carries this load, or "
        "start nearer to the equilibrium, as from one under a part of the load (about=)"
    )


def newton_cut(
    scene: CompiledScene,
    work: Work,
    start: ForceBalance,
    strains: StrainPredictor,
    sizes: FloatArray,
    *,
    stays_stable: bool,
) -> ForceBalance:
    """The equilibrium to which few of Newton's steps lead, cut as in ``stable_below``.

    Args:
        scene: as of ``stable_below``, like those that follow.
        work: as there.
        start: as there.
        strains: as there.
        sizes: as there.
        stays_stable: give up where the machine is unstable on the way; from a start that is, go where forces push.

    Raises:
        ConvergenceError: they lead to none.
        SceneError: as ``balance``.
    """
    machine, here, predicted = _Machine(scene, work, strains, sizes), start, strains.at(start.x)
    for _ in range(_FEW):
        step = _newton_step(machine, here, strains.stiffness(here.x, predicted - strains.at(here.x)))
        if step.unstable and stays_stable:
            break
        size = step_size(sizes, step.along)
        cut = step.along * min(1.0, _STEP / max(size, _STEP))
        here, predicted = _take_step(machine, here, cut, predicted, searches=not step.unstable and size > _CONVERGED)
        if size <= _CONVERGED:
            return here
    raise ConvergenceError("Newton's steps lead to no equilibrium")


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
        x = moved(scene, machine.work, here.x, change)
        try:
            there = balance(scene, machine.work, x, here.v, motion=here.motion)
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


def _newton_step(machine: _Machine, here: ForceBalance, more: FloatArray) -> _Step:
    """Newton's own step where nothing is unstable.

    Along vibrations of negative stiffness it goes the other way, and along those without any it goes nowhere if they
    are balanced.

    Args:
        machine: it.
        here: the unbalanced forces.
        more: (nv, nv) stiffness beside that of the state.
    """
    Vz = here.by.Vz
    stiffness = Vz.T @ (here.of.stiffness + more) @ Vz
    if not len(stiffness):
        return _Step(np.zeros(len(Vz)), 0, np.zeros(len(Vz)))
    rates, shapes = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), here.mass)
    floor = len(rates) * 1e-15 * float(np.abs(rates).max())
    unstable = int((rates < -floor).sum())
    idle = np.abs(rates) <= floor
    pull = shapes.T @ here.lacking
    if idle.any():
        at_play = forces_at_play(machine.scene, machine.work, here)
        parts = np.abs(Vz @ shapes).T @ (at_play / machine.sizes)
        pull[idle & (np.abs(pull) <= _NOTHING * parts)] = 0.0
    if unstable == 0 and not idle.any():
        try:
            step = -np.linalg.solve(stiffness, here.lacking)
        except np.linalg.LinAlgError:  # its symmetric part alone shows that nothing is idle
            step = -np.linalg.lstsq(stiffness, here.lacking, rcond=None)[0]
    else:
        step = -shapes @ (pull / np.maximum(np.abs(rates), max(floor, 1e-300)))
    return _Step(Vz @ step, unstable, Vz @ shapes[:, 0])
