"""The equilibrium that a machine comes to when the forces that its start lacks are let go.

All of them at once are Newton's step, which is taken where it stays near what the linear equations predict, does work
and passes no change of the stiffness.  Where it does not, his steps are cut, as long as the machine stays stable on the
way.  Otherwise the forces are held and let go along a path (Newton's homotopy; Allgower & Georg 1990, Numerical
Continuation Methods, section 1.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.follow import follow
from flexmbd.continuation.newton import SETTLED, Correction, newton
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.space import PathDirection, typical_motion, unit, until
from flexmbd.continuation.station import station
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.reading.force_tables import rough_surfaces
from flexmbd.multibody.linear.balance import ForceBalance, step_size
from flexmbd.multibody.linear.downhill import HinderedError, UnbalancedContactError, newton_cut
from flexmbd.multibody.linear.forces_at_play import BALANCED, forces_at_play
from flexmbd.multibody.linear.passing import passing
from flexmbd.multibody.linear.path.corrector import MachinePoint, MachineSpace
from flexmbd.multibody.linear.path.loading import LackingTakenAway
from flexmbd.multibody.linear.stability import SOFT, MotionSpectrum, own_stiffness
from flexmbd.multibody.linear.strain_predictor import StrainPredictor
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.round_off import EQUAL, ROUND_OFF

FloatArray = NDArray[np.float64]

_LONGEST = 0.5  # rad, or of the extent: of a path's steps
_POINTS = 60  # of a path
_REFINEMENTS = 3  # further steps
_STRAIGHT = 0.1  # rad, or of the extent: by how much the middle of a step that is longer than 1 may lie off the path


class LostPathError(SceneError):
    """The path of the lacking forces goes on, and is not found, as of motions that nothing resists at its start."""


@dataclass(frozen=True, eq=False)
class Settled:
    """An equilibrium.

    Attributes:
        point: it.
        spectrum: of its stiffness.
        moved: whether the start was another state.
        turned: whether the path there from a stable start turned back on the way.
    """

    point: MachinePoint
    spectrum: MotionSpectrum
    moved: bool
    turned: bool


def forces_let_go(
    scene: CompiledScene, work: Work, start: ForceBalance, strains: StrainPredictor, sizes: FloatArray
) -> Settled:
    """The equilibrium to which Newton's step leads, or else the path.

    Args:
        scene: the machine.
        work: scratch; ``work.time`` holds the functions of time.
        start: where it starts.
        strains: of its bodies.
        sizes: (nv,) of ``motion_sizes``.

    Raises:
        SceneError: there is none.
    """
    loading = LackingTakenAway(start.open_force(), len(scene.plan.rows))
    space = MachineSpace(scene, work, strains, loading, 1.0, start.v, sizes, remembers=False, motion=start.motion)
    goal = MachinePoint(start.x, 1.0, start, loading.slopes(work, start.x, start.v, factor=1.0, width=1.0), 0)
    if _has_soft_motions(space, goal):
        space = replace(space, at_play=forces_at_play(scene, work, start))
    step, before = space.newton_step(goal, space.along_factor(1.0)), space.spectrum(goal)
    open_ = _unresolved(space, goal, step) if np.any(space.at_play) else np.zeros(len(start.by.z))
    if open_.any():
        return _where_pushed(space, goal, before, open_)
    if space.largest(step) <= SETTLED:
        x, _ = space.moved(start.x, 1.0, step)
        there = space.at(x, 1.0)
        return Settled(there, space.spectrum(there), False, False)
    works = -float(start.lacking @ step.xi[start.by.z])
    if works > 0.0:
        found = until(lambda: _at_once(space, goal, step))
        if found is not None:
            after = space.spectrum(found)
            if after.diverging == 0 or _alike(before, after):
                return _balanced(space, goal, Settled(found, after, True, False))
        if space.still(goal) is None:
            found = until(lambda: _by_cut_steps(space, goal, stays_stable=before.diverging == 0))
            if found is not None:
                after = space.spectrum(found)
                if after.diverging == 0:
                    return _balanced(space, goal, Settled(found, after, True, False))
    return _along_the_path(space, goal, before, open_, sign=1.0 if works > 0.0 else -1.0)


def _at_once(space: MachineSpace, goal: MachinePoint, step: PathDirection) -> MachinePoint:
    """The equilibrium at the end of Newton's step.

    Raises:
        ConvergenceError: it is not near there.
        SceneError: as ``balance``.
    """
    across = space.along_factor(1.0)
    if space.largest(step) > 1.0:  # so far that an angle may have turned round: it must go straight
        x, _ = space.moved(goal.x, 1.0, step.times(0.5))
        middle = space.at(x, 0.5)
        if not space.largest(space.newton_step(middle, across)) <= _STRAIGHT:
            raise ConvergenceError("Newton's step is too long")
    return space.correct(goal, step, across)


def _by_cut_steps(space: MachineSpace, goal: MachinePoint, *, stays_stable: bool) -> MachinePoint:
    """The equilibrium to which cut steps lead, as ``newton_cut``."""
    found = newton_cut(space.scene, space.work, goal.at, space.strains, space.size, stays_stable=stays_stable)
    return MachinePoint(found.x, 1.0, found, goal.slopes, 0)


def _where_pushed(space: MachineSpace, goal: MachinePoint, before: MotionSpectrum, open_: FloatArray) -> Settled:
    """The equilibrium to which forces (nz,) lead that nothing resists at first: on what they press, or by the path."""
    found, reason = _to_touch(space, goal, open_)
    if found is not None:
        return found
    try:
        return _along_the_path(space, goal, before, open_)
    except SceneError:
        if reason is None:
            raise
        bears = "; friction bears mu N at most" if len(rough_surfaces(space.scene.plan)) else ""
        raise SceneError(
            f"no equilibrium found where the machine falls onto what it meets: {reason}{bears}"
        ) from reason


def _to_touch(
    space: MachineSpace, goal: MachinePoint, open_: FloatArray
) -> tuple[Settled | None, UnbalancedContactError | None]:
    """The equilibrium on what forces that nothing resists, yet, press the machine against; or why there is none.

    Raises:
        HinderedError: it is pressed through that.
    """
    falls = space.against(goal, open_)
    if not passing(space.scene, space.work, goal.x, falls.xi).meets:
        return None, None
    try:
        found = _by_cut_steps(space, goal, stays_stable=False)
    except UnbalancedContactError as reason:
        return None, reason
    except HinderedError:
        raise
    except (ConvergenceError, SceneError, np.linalg.LinAlgError):
        return None, None
    return _balanced(space, goal, Settled(found, space.spectrum(found), True, False)), None


def _along_the_path(
    space: MachineSpace, goal: MachinePoint, before: MotionSpectrum, open_: FloatArray, *, sign: float = 1.0
) -> Settled:
    """The end of the path.

    Args:
        space: the machine.
        goal: its start, with nothing held.
        before: of the start.
        open_: (nz,) forces there that nothing resists; the path goes along these if there are any.
        sign: of the change of the factor at the start, along which the forces do work.
    """
    held = space.at(goal.x, 0.0)
    onwards = space.against(held, open_) if open_.any() else space.along_factor(sign)
    if open_.any():
        onwards = unit(space, onwards)
    if sign < 0.0:  # away from what is near: the forces that hold it come to many times those that the start lacks
        tangent = space.tangent(held, onwards)
        space = replace(space, width=max(1.0, abs(tangent.factor) / step_size(space.size, tangent.xi)))
        onwards = space.along_factor(sign)
    space = replace(space, typical=typical_motion(space, space.tangent(held, onwards)))
    here, turned = station(space, held, onwards), False
    try:
        for stretch in follow(space, here, Bounds(to=1.0, back_to=-np.inf, longest=_LONGEST, points=_POINTS)):
            here = stretch.after
            turned = turned or here.tangent.factor < 0.0
            if open_.any() and abs(here.point.factor) <= BALANCED:
                _refuse_open(space, goal, open_, LostPathError if _resisted(space, goal, onwards) else SceneError)
    except ConvergenceError as reason:
        raise LostPathError(f"no equilibrium found: {reason}; {_LOOK}") from reason
    if here.point.factor != 1.0:
        raise SceneError(
            f"no equilibrium found: as the forces that the start lacks are let go, on a path of {_POINTS} points at "
            f"most, {here.point.factor:.3g} of them are in the end; {_LOOK}"
        )
    turned = turned and before.diverging == 0
    return _balanced(space, goal, Settled(here.point, space.spectrum(here.point), True, turned))


_LOOK = (
    "start nearer to it, as from one under a part of the load (about=), or look at the path of equilibria as the load "
    "grows, path=fm.Continuation(to=...)"
)


def _has_soft_motions(space: MachineSpace, here: MachinePoint) -> bool:
    """Whether round-off of the forces at play might move something, or be taken for a stiffness."""
    size, stiffness = space.size[here.at.by.z], np.abs(here.at.stiffness())
    own = stiffness @ size * size
    return bool(own.min(initial=np.inf) <= SOFT * own.max(initial=0.0)) or space.softest(here) <= SOFT


def _unresolved(space: MachineSpace, here: MachinePoint, step: PathDirection) -> FloatArray:
    """(nz,) the forces that no small motion brings into balance; zeros where that is round-off of those at play."""
    at, z = here.at, here.at.by.z
    change, stiffness = step.xi[z], at.stiffness()
    left = at.lacking + stiffness @ change
    at_play = forces_at_play(space.scene, space.work, at)
    own = own_stiffness(stiffness, space.size[z], at_play[z])
    solved = np.linalg.norm(np.abs(stiffness) @ np.abs(change) / own) + np.linalg.norm(at.lacking / own)
    carried = np.abs(at.by.Vz).T @ (at_play / space.size)
    open_ = (np.abs(left) > BALANCED * carried) & (np.abs(left / own) > EQUAL * solved)
    return np.where(open_, left, 0.0)


def _alike(one: MotionSpectrum, other: MotionSpectrum) -> bool:
    """Whether no eigenvalue has passed zero from one to the other; two at once of forces without a potential may."""
    if one.has_potential and other.has_potential:
        return one.diverging == other.diverging
    return one.diverging % 2 == other.diverging % 2


def _balanced(space: MachineSpace, goal: MachinePoint, found: Settled) -> Settled:
    """What was found, as exactly as round-off lets it be, if no force is left along motions that nothing resists.

    Raises:
        SceneError: some is.
    """
    along = space.along_factor(1.0)
    found = replace(found, point=_refined(space, found.point, space.largest(space.newton_step(goal, along))))
    if found.spectrum.idle.any():
        step = space.newton_step(found.point, along)
        _refuse_open(space, found.point, _unresolved(space, found.point, step))
    return found


class _Stepping(NamedTuple):
    """A point and Newton's step from there."""

    point: MachinePoint
    step: PathDirection


@dataclass(frozen=True, eq=False)
class _LastDigits:
    """Further steps of Newton's method at a point; ``least``: a step so short changes none of the digits."""

    space: MachineSpace
    least: float

    def at(self, point: MachinePoint) -> _Stepping:
        return _Stepping(point, self.space.newton_step(point, self.space.along_factor(1.0)))

    def is_solved(self, here: _Stepping, *, close: bool) -> bool:
        return self.space.largest(here.step) <= self.least

    def correction(self, here: _Stepping) -> Correction[PathDirection]:
        return Correction(here.step, self.space.largest(here.step))

    def moved(self, here: _Stepping, correction: Correction[PathDirection], *, close: bool) -> _Stepping:
        return self.at(self.space.at(self.space.moved(here.point.x, 1.0, correction.change)[0], 1.0))


def _refined(space: MachineSpace, point: MachinePoint, reach: float) -> MachinePoint:
    """A point after further steps of Newton's method, as long as they become shorter and change digits of ``reach``."""
    digits = _LastDigits(space, EQUAL * min(1.0, reach))
    return newton(digits, digits.at(point), most=_REFINEMENTS, close=0.0, grows=0.5).place.point


def _resisted(space: MachineSpace, here: MachinePoint, onwards: PathDirection) -> bool:
    """Whether forces change along a motion that nothing resists where it begins, as that across a flat net does."""
    step = onwards.times(_LONGEST / max(space.largest(onwards), _LONGEST * ROUND_OFF))
    point = until(lambda: space.at(space.moved(here.x, 1.0, step)[0], 1.0))
    if point is None:
        return False
    there = point.at
    if not np.array_equal(here.at.by.z, there.by.z):
        return True
    at_play = np.abs(here.at.by.Vz).T @ (forces_at_play(space.scene, space.work, here.at) / space.size)
    return bool((np.abs(there.lacking - here.at.lacking) > BALANCED * at_play).any())


def _refuse_open(
    space: MachineSpace, here: MachinePoint, open_: FloatArray, error: type[SceneError] = SceneError
) -> None:
    """Raise an error where forces are left that nothing resists."""
    if not open_.any():
        return
    z = here.at.by.z
    worst = int(np.argmax(np.abs(open_ * space.size[z])))
    name = space.scene.velocity_names[z[worst]]
    raise error(
        f"no equilibrium found: at {name!r} a force of {-open_[worst]:.6g} (N, N m, or modal) stays unbalanced, for "
        "nothing resists it; check that something carries this load, or prescribe the motion"
    )
