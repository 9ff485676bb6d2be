"""The search downhill: Newton's steps, turned round where the machine is unstable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, searched
from flexmbd.continuation.newton import SETTLED, Correction, newton
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.reading.force_tables import keep_forces, rough_surfaces
from flexmbd.multibody.linear.balance import ForceBalance, balance, moved, step_size
from flexmbd.multibody.linear.forces_at_play import BALANCED, forces_at_play
from flexmbd.multibody.linear.passing import Passing, landing, may_touch, passing
from flexmbd.multibody.linear.strain_predictor import StrainPredictor
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.round_off import of_solver

FloatArray = NDArray[np.float64]

_ITERATIONS = 200
_FEW = 30  # steps of ``newton_cut``
_STEP = 0.3  # rad, or of the machine's extent: the longest step
_TRIALS = 9  # of a step, each half as long as the one before
_SLOPE = 0.9  # of the work that forces do along a step at its beginning: what they may do against it at its end
_LEAVE = 0.01  # rad, or of the extent: by how much an unstable equilibrium is left


class HinderedError(SceneError):
    """A contact gives way under the load up to the middle of what it meets."""


class UnbalancedContactError(ConvergenceError):
    """Newton's steps lead to no equilibrium, and have led to a contact."""


@dataclass(frozen=True, eq=False)
class _DownhillPlace:
    """A place of the search.

    Attributes:
        at: forces and derivatives there.
        predicted: the strains there by the linear equations of the last step.
        met: whether a step on the way there pressed what it touched.
    """

    at: ForceBalance
    predicted: FloatArray
    met: bool = False


@dataclass(frozen=True, eq=False)
class _Step:
    """A step (nv,), how many motions are unstable about its start, and the most unstable or softest of them (nv,)."""

    along: FloatArray
    unstable: int
    softest: FloatArray


@dataclass(frozen=True, eq=False)
class _DownhillProblem:
    """The equilibrium of a machine as a problem for Newton's method.

    Attributes:
        scene: without states of users' equations.
        work: scratch; ``work.time`` holds the functions of time.
        strains: of its bodies.
        sizes: (nv,) of ``motion_sizes``.
        leaves: whether an unstable equilibrium is left along its most unstable motion.
        stays_stable: whether to give up where the machine is unstable.
    """

    scene: CompiledScene
    work: Work
    strains: StrainPredictor
    sizes: FloatArray
    leaves: bool
    stays_stable: bool

    def begin(self, start: ForceBalance) -> _DownhillPlace:
        return _DownhillPlace(start, self.strains.at(start.x))

    def is_solved(self, here: _DownhillPlace, *, close: bool) -> bool:
        return close

    def correction(self, here: _DownhillPlace) -> Correction[_Step]:
        """The next step; in it the strains of slender bodies are unknowns of their own (`strain_predictor`).

        Raises:
            ConvergenceError: the machine is unstable, and was to stay stable.
            HinderedError: a contact allows none of it.
        """
        at, strains = here.at, self.strains
        step = _newton_step(self, at, strains.stiffness(at.x, here.predicted - strains.at(at.x)))
        if step.unstable and self.stays_stable:
            raise ConvergenceError("on the way to the equilibrium the machine is unstable")
        size = step_size(self.sizes, step.along)
        if self.leaves and step.unstable and size <= SETTLED:
            aside = step.softest * (_LEAVE / step_size(self.sizes, step.softest))
            return Correction(replace(step, along=aside), _LEAVE)
        through = passing(self.scene, self.work, at.x, step.along)
        if through.share * size <= SETTLED < size:
            raise hindered(self.scene, at, through)
        return Correction(step, size, share=min(1.0, _STEP / max(size, _STEP), through.share))

    def moved(self, here: _DownhillPlace, correction: Correction[_Step], *, close: bool) -> _DownhillPlace:
        """Where a step leads.

        It is halved until interiors find their balance there and, where the machine is stable, the forces no longer
        push back: beyond there its energy rises.
        """
        scene, strains, at = self.scene, self.strains, here.at
        step, searches = correction.share * correction.change.along, not (close or correction.change.unstable)
        along = step[at.by.z]
        linear = strains.at(at.x) + strains.change(at.x, step)
        before, touch = float(at.lacking @ along), passing(scene, self.work, at.x, step).touch

        def trial(part: float) -> ShareTrial[_DownhillPlace]:
            x = moved(scene, self.work, at.x, part * step)
            try:
                there = balance(scene, self.work, x, at.v, motion=at.motion)
            except SceneError as reason:
                if scene.interiors is None:
                    raise
                raise SceneError(f"no equilibrium found: on the way to it {reason}") from reason
            then = here.predicted + part * (linear - here.predicted)
            # other coordinates are the independent ones there: no work along the step to be compared
            if not searches or not np.array_equal(there.by.z, at.by.z):
                return ShareTrial(_DownhillPlace(there, then), part, 0.0)
            open_forces = there.lacking + there.by.Vz.T @ strains.force(there.x, then - strains.at(there.x))
            work = float(open_forces @ along)
            return landing(_DownhillPlace(there, then), part, touch=touch, work=work, before=before, ratio=_SLOPE)

        fails = () if scene.interiors is None else (SceneError,)
        found = searched(trial, most=_TRIALS, fails=fails)
        there = replace(found.place, met=here.met or touch == 0.0)
        return self._laid_down(there) if 0.0 < touch <= found.share else there

    def _laid_down(self, here: _DownhillPlace) -> _DownhillPlace:
        """With the patches that have come to touch sticking where they have, if there is friction."""
        rough = rough_surfaces(self.scene.plan)
        if not len(rough):
            return here
        x, at = here.at.x.copy(), here.at
        remember(keep_forces(self.scene.plan, [], rough), self.work, x, at.v, float(self.work.time[-1, 0]))
        return replace(here, at=balance(self.scene, self.work, x, at.v, motion=at.motion))


def stable_below(
    scene: CompiledScene, work: Work, start: ForceBalance, strains: StrainPredictor, sizes: FloatArray
) -> ForceBalance:
    """The stable equilibrium downhill of a state.

    Near it these are Newton's steps; where the machine is unstable, directions of negative stiffness are taken
    downhill, and an unstable equilibrium is left along its most unstable motion.

    Args:
        scene: without states of users' equations.
        work: scratch; ``work.time`` holds the functions of time.
        start: where to begin.
        strains: of its bodies.
        sizes: (nv,) of ``motion_sizes``.

    Raises:
        SceneError: none is found; the message names the coordinate where most is lacking.
    """
    search = _DownhillProblem(scene, work, strains, sizes, leaves=True, stays_stable=False)
    found = newton(search, search.begin(start), most=_ITERATIONS, close=SETTLED)
    if found.is_solution:
        return found.place.at
    _refuse_hindered(search, found.place)
    raise SceneError(
        f"no stable equilibrium found in {found.iterations} steps downhill: {most_lacking(scene, found.place.at)}; "
        "check that something carries this load, or start nearer to the equilibrium, as from one under a part of the "
        "load (about=)"
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
    """The equilibrium to which few of Newton's steps lead, more where bodies may touch, cut as in ``stable_below``.

    Args:
        scene: as of ``stable_below``, like those that follow.
        work: as there.
        start: as there.
        strains: as there.
        sizes: as there.
        stays_stable: give up where the machine is unstable on the way; from a start that is, go where forces push.

    Raises:
        ConvergenceError: they lead to none.
        HinderedError: the next one would pass through a contact.
        SceneError: as ``balance``.
    """
    search = _DownhillProblem(scene, work, strains, sizes, leaves=False, stays_stable=stays_stable)
    most = _ITERATIONS if may_touch(scene) else _FEW  # each goes to what lies on the way, or a part of a turn
    found = newton(search, search.begin(start), most=most, close=SETTLED)
    if not found.is_solution:
        _refuse_hindered(search, found.place)
        error = UnbalancedContactError if found.place.met else ConvergenceError
        raise error(f"Newton's steps lead to no equilibrium: {most_lacking(scene, found.place.at)}")
    return found.place.at


def _refuse_hindered(search: _DownhillProblem, here: _DownhillPlace) -> None:
    """Raise HinderedError where the next step would pass through a contact."""
    try:
        step = search.correction(here).change.along
    except ConvergenceError:
        return
    through = passing(search.scene, search.work, here.at.x, step)
    if through.share < 1.0:
        raise hindered(search.scene, here.at, through)


def hindered(scene: CompiledScene, at: ForceBalance, through: Passing) -> HinderedError:
    """The error that a contact gives way under the load."""
    return HinderedError(
        f"no equilibrium found: {through.told}, does not bear the load before the middle of what it meets is reached, "
        f"from where it is pushed out on the other side ({most_lacking(scene, at)}); take a stiffer law, a "
        "thicker shape, larger patches or a smaller load, or begin nearer to the equilibrium (about=)"
    )


def most_lacking(scene: CompiledScene, at: ForceBalance) -> str:
    """The coordinate where most is out of balance, and how much, in words."""
    worst = int(np.argmax(np.abs(at.lacking) / np.sqrt(np.diag(at.mass))))
    name = scene.velocity_names[at.by.z[worst]]
    return f"at {name!r} a force of {-at.lacking[worst]:.6g} (N, N m, or modal) stays unbalanced"


def _newton_step(search: _DownhillProblem, here: ForceBalance, more: FloatArray) -> _Step:
    """The step downhill, with a stiffness ``more`` (nv, nv) beside that of the state."""
    Vz = here.by.Vz
    stiffness = Vz.T @ (here.of.stiffness + more) @ Vz
    if not len(stiffness):
        return _Step(np.zeros(len(Vz)), 0, np.zeros(len(Vz)))
    at_play = forces_at_play(search.scene, search.work, here)
    step, unstable, softest = step_downhill(
        stiffness, here.mass, here.lacking, Vz=Vz, sizes=search.sizes, at_play=at_play
    )
    return _Step(Vz @ step, unstable, Vz @ softest)


def step_downhill(
    stiffness: FloatArray,
    mass: FloatArray,
    lacking: FloatArray,
    *,
    Vz: FloatArray,
    sizes: FloatArray,
    at_play: FloatArray,
) -> tuple[FloatArray, int, FloatArray]:
    """Newton's own step where nothing is unstable.

    Along vibrations of negative stiffness it goes the other way, and along those without any it goes nowhere if they
    are balanced.

    Args:
        stiffness: (nz, nz).
        mass: (nz, nz).
        lacking: (nz,) unbalanced forces.
        Vz: (nv, nz) the changes.
        sizes: (nv,) of ``motion_sizes``.
        at_play: (nv,) J, of ``forces_at_play``.

    Returns:
        The step (nz,), how many motions are unstable, and the most unstable or softest of them (nz,).
    """
    rates, shapes = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), mass)
    floor = of_solver(len(rates)) * float(np.abs(rates).max())
    parts = np.abs(Vz @ shapes)
    size = (parts / sizes[:, None]).max(axis=0, initial=0.0)
    nothing = BALANCED * parts.T @ (at_play / sizes)  # of the forces at play: their round-off is no stiffness either
    idle = np.abs(rates) <= np.maximum(floor, nothing * size)
    unstable = int(((rates < 0.0) & ~idle).sum())
    pull = shapes.T @ lacking
    pull[idle & (np.abs(pull) <= nothing)] = 0.0
    if unstable == 0 and not idle.any():
        try:
            step = -np.linalg.solve(stiffness, lacking)
        except np.linalg.LinAlgError:  # its symmetric part alone shows that nothing is idle
            step = -np.linalg.lstsq(stiffness, lacking, rcond=None)[0]
    else:
        # what nothing resists goes where it is pushed, as far as the machine is large; no step is longer
        farthest = step_size(sizes, Vz @ shapes[:, idle] @ pull[idle])
        step = -shapes @ (pull / np.where(idle, farthest or 1.0, np.maximum(np.abs(rates), floor)))
    return np.asarray(step, dtype=np.float64), unstable, np.asarray(shapes[:, 0])
