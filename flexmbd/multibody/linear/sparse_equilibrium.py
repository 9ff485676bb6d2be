"""The equilibrium of a machine of many bodies, where Newton's method leads to a stable one: by the sparse stiffness.

As `path.force_homotopy` does: Newton's step, if it does work and is near what the linear equations predict, and
corrections, else cut steps downhill; what nothing resists and nothing drives stays where it is.  What is not so simple
is left to the dense way: unstable equilibria, forces without a potential, strains as unknowns of their own, paths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, searched
from flexmbd.continuation.newton import CLOSE, SETTLED, Correction, newton
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.base.compiling import compiling
from flexmbd.multibody.linear.balance import moved, step_size
from flexmbd.multibody.linear.forces_at_play import BALANCED
from flexmbd.multibody.linear.passing import landing, passing, passing_on_the_way
from flexmbd.multibody.linear.stability import HAS_POTENTIAL, SOFT
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.sparse_stiffness import SparseStiffness, sparse_stiffness
from flexmbd.round_off import EQUAL, ROUND_OFF, WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]

#: What kernels are compiled for before the first equilibrium of a large machine.
BALANCING_MANY = "equilibria of many bodies"

_CORRECTIONS = 12
_REFINEMENTS = 3
_GROWS = 2.0
_COUPLED = ROUND_OFF / WORTHLESS_PIVOT  # of stiffnesses at play: of this share a worthless pivot is their round-off
_ASTRAY = 0.4  # of Newton's step: the first correction after it
_STEP = 0.3  # rad, or of the machine's extent: the longest step downhill
_DOWNHILL = 60  # steps
_TRIALS = 9  # of a step, each half as long as the one before
_PUSHES_BACK = 0.9  # of the work that forces do along a step at its beginning: what they may do against it at its end
_DENSE_UP_TO = 3000  # velocities: of more, dense matrices and their singular values take minutes


@dataclass(frozen=True, eq=False)
class StableEquilibrium:
    """An equilibrium.

    Attributes:
        x: (nx,) configuration.
        multipliers: (m,) reactions (N or N m).
        neutral: names of coordinates, one for each independent motion that nothing resists.
    """

    x: FloatArray
    multipliers: FloatArray
    neutral: tuple[str, ...]


class _Place(NamedTuple):
    """A state, its stiffness (k,), the step from there, and what forces (nv,) hold that nothing resists.

    ``unstable``: how many motions have a negative stiffness; None where that is not known.
    """

    x: FloatArray
    multipliers: FloatArray
    force: FloatArray
    values: FloatArray
    step: FloatArray
    change: FloatArray
    holding: FloatArray
    unstable: int | None


@dataclass(frozen=True, eq=False)
class _CutDescent:
    """Newton's steps down the energy, cut where it would rise, as a problem for his method.

    Where nothing resists some forces, or next to nothing, as across a flat net without tension, all is stiffened as
    much as keeps the step short, the less the smaller the forces (Levenberg and Marquardt).  What is unstable on the
    way is left to the dense way, which tells how the machine would come to the equilibrium.
    """

    balance: _Balance

    def is_solved(self, here: _Place, *, close: bool) -> bool:
        return close

    def correction(self, here: _Place) -> Correction[_Place]:
        """Newton's step, or the stiffened one where forces are loose, or his would be long."""
        size = self.balance.size
        if here.unstable:
            raise _NotSoSimpleError("on the way to the equilibrium the machine is unstable")
        ends = not here.holding.any()
        if not ends or step_size(size, here.step) > _STEP:
            here = self._stiffened(here)
        if not float(here.force @ here.step) <= 0.0:
            raise _NotSoSimpleError("on the way to the equilibrium a step leads uphill")
        length = step_size(size, here.step)
        share = passing(self.balance.stiffness.scene, self.balance.stiffness.work, here.x, here.step).share
        return Correction(here, length, share=min(1.0, _STEP / max(length, _STEP), share), ends=ends)

    def _stiffened(self, here: _Place) -> _Place:
        """With a step of a stiffness to which so much is added that no force alone moves its coordinate too far."""
        stiffness, size = self.balance.stiffness, self.balance.size
        energies = stiffness.entries.nearby(stiffness.entries.energies(here.values, size))
        moves = energies > 0.0
        share = float((np.abs(here.force * size)[moves] / energies[moves]).max(initial=0.0)) / _STEP
        stiffness.assemble(here.x, here.multipliers)
        stiffness.stiffen(share * energies / size**2)
        if not stiffness.factor(_COUPLED * energies / size**2):
            raise _NotSoSimpleError("its rows have no pivots")
        step, change = stiffness.solve(-here.force)
        return here._replace(step=step, change=change)

    def moved(self, here: _Place, correction: Correction[_Place], *, close: bool) -> _Place:
        """Halved until the forces no longer push back: beyond there the energy rises."""
        scene, work = self.balance.stiffness.scene, self.balance.stiffness.work
        step, change = (correction.share * one for one in (correction.change.step, correction.change.change))
        before, touch = float(here.force @ step), passing(scene, work, here.x, step).touch

        def trial(part: float) -> ShareTrial[_Place]:
            there = self.balance.at(moved(scene, work, here.x, part * step), here.multipliers + part * change)
            if close:
                return ShareTrial(there, part, 0.0)
            done = float(there.force @ step)
            return landing(there, part, touch=touch, work=done, before=before, ratio=_PUSHES_BACK)

        there = searched(trial, most=_TRIALS).place
        loose, changed = (np.abs(one * self.balance.size) for one in (here.holding, there.holding - here.holding))
        if loose.any() and (changed <= BALANCED * loose.max()).all():  # nothing resists them further down either
            _refuse_loose(self.balance.stiffness, here, self.balance.size)
        return there


class _NotSoSimpleError(Exception):
    """What is left to the dense way, and said where that would take too long."""


@dataclass(frozen=True, eq=False)
class _Balance:
    """As a problem for Newton's method; ``kept``: (nv,) a force held; ``least``: a step so short is the last one."""

    stiffness: SparseStiffness
    size: FloatArray
    kept: FloatArray | float = 0.0
    least: float = 0.0

    def at(self, x: FloatArray, multipliers: FloatArray) -> _Place:
        stiffness = self.stiffness
        force = stiffness.force(x, multipliers) - self.kept
        stiffness.assemble(x, multipliers)
        values, entries = stiffness.values(), stiffness.entries
        energies = entries.nearby(entries.energies(values, self.size))
        if not stiffness.factor(_COUPLED * energies / self.size**2):
            raise _NotSoSimpleError("its rows have no pivots")
        step, change = stiffness.solve(-force)
        if not (np.isfinite(step).all() and np.isfinite(change).all()):
            raise _NotSoSimpleError("its stiffness is no number")
        holding, unstable = stiffness.held() * step, stiffness.negative()
        at_play = energies * step_size(self.size, step) + entries.nearby(np.abs(force * self.size))
        # places are known to round-off, too
        loose = np.abs(holding * self.size) > np.maximum(BALANCED * at_play, ROUND_OFF * energies)
        holding = np.where(loose, holding, 0.0)
        return _Place(x, multipliers, force, values, step, change, holding, unstable)

    def is_solved(self, here: _Place, *, close: bool) -> bool:
        return close or step_size(self.size, here.step) <= self.least

    def correction(self, here: _Place) -> Correction[FloatArray]:
        return Correction(here.step, step_size(self.size, here.step))

    def moved(self, here: _Place, correction: Correction[FloatArray], *, close: bool) -> _Place:
        x = moved(self.stiffness.scene, self.stiffness.work, here.x, correction.change)
        return self.at(x, here.multipliers + here.change)


def stable_equilibrium(scene: CompiledScene, work: Work, x: FloatArray, size: FloatArray) -> StableEquilibrium | None:
    """The equilibrium at rest that Newton's step from x (nx,) leads to; None where the dense way has to look.

    Args:
        scene: without redundant rows, bodies with history and states.
        work: scratch; ``work.time`` holds the functions of time.
        x: a configuration with its loops closed.
        size: (nv,) of ``motion_sizes``.

    Raises:
        SceneError: there is none, or the machine is too large for the dense way.
    """
    stiffness = sparse_stiffness(scene, work)
    if stiffness is None:
        return None
    try:
        with compiling(BALANCING_MANY, aloud=scene.parts.team.is_root):
            return _found(stiffness, x, size)
    except (_NotSoSimpleError, SceneError) as reason:
        if scene.nv <= _DENSE_UP_TO:
            return None
        if isinstance(reason, SceneError):
            raise
        raise SceneError(
            f"no equilibrium found: {reason}; a machine of {scene.nv} velocities is too large to look for another way: "
            "start nearer to it, as from one under a part of the load (about=)"
        ) from reason


def _found(stiffness: SparseStiffness, x: FloatArray, size: FloatArray) -> StableEquilibrium:
    multipliers = stiffness.reactions(x)
    if multipliers is None:
        raise _NotSoSimpleError("some motion moves no mass")
    balance = _Balance(stiffness, size)
    start = balance.at(x, multipliers)
    length = step_size(size, start.step)
    if start.holding.any():
        place, length = _settled(balance, start), 1.0
    elif length <= SETTLED:
        place = start
    else:
        try:
            place = _corrected(balance, start, length)
        except _NotSoSimpleError:
            if start.unstable != 0:
                raise
            place = _settled(balance, start)
    digits = _Balance(stiffness, size, least=EQUAL * min(1.0, length))
    place = newton(digits, place, most=_REFINEMENTS, close=0.0, grows=0.5).place
    _refuse_loose(stiffness, place, size)
    return _judged(stiffness, place, size)


def _corrected(balance: _Balance, start: _Place, length: float) -> _Place:
    """The equilibrium near the end of Newton's step."""
    if not float(start.force @ start.step) < 0.0:
        raise _NotSoSimpleError("the start is unstable")
    scene, work = balance.stiffness.scene, balance.stiffness.work
    if passing_on_the_way(scene, work, start.x, start.step, balance.size).share < 1.0:
        raise _NotSoSimpleError("Newton's step passes through what touches")
    if length > 1.0:  # so far that an angle may have turned round: it must go straight
        half = moved(scene, work, start.x, 0.5 * start.step)
        there = _Balance(balance.stiffness, balance.size, kept=0.5 * start.force)
        if not step_size(balance.size, there.at(half, start.multipliers + 0.5 * start.change).step) <= 0.1:
            raise _NotSoSimpleError("Newton's step is too long")
    first = balance.moved(start, balance.correction(start), close=False)
    away, along = (np.linalg.norm(one.step / balance.size) for one in (first, start))
    if away > _ASTRAY * along and step_size(balance.size, first.step) > CLOSE:
        raise _NotSoSimpleError("Newton's method leads to another path")
    found = newton(balance, first, most=_CORRECTIONS, close=CLOSE, grows=_GROWS)
    if not found.is_solution:
        raise _NotSoSimpleError("Newton's method does not converge")
    return found.place


def _settled(balance: _Balance, start: _Place) -> _Place:
    """The equilibrium down from a start that is not unstable.

    Raises:
        SceneError: nothing resists them further down either.
    """
    found = newton(_CutDescent(balance), start, most=_DOWNHILL, close=SETTLED)
    if not found.is_solution:
        _refuse_loose(balance.stiffness, found.place, balance.size)
        raise _NotSoSimpleError("the steps downhill do not end")
    return found.place


def _judged(stiffness: SparseStiffness, place: _Place, size: FloatArray) -> StableEquilibrium:
    """The equilibrium, if its stiffness is symmetric and resists all motions, or some not at all."""
    scene = stiffness.scene
    held, negative, least = stiffness.held(), stiffness.negative(), stiffness.least_pivot
    if negative != 0:
        raise _NotSoSimpleError("what is there is unstable" if negative else "its rows give no pivots")
    if least <= SOFT and scene.nv <= _DENSE_UP_TO:
        raise _NotSoSimpleError("some motions are soft")
    if stiffness.entries.skewness(place.values, size, least=SOFT) > HAS_POTENTIAL:
        raise _NotSoSimpleError("some forces follow what they act on")
    neutral = tuple(scene.velocity_names[k] for k in np.flatnonzero(held))
    return StableEquilibrium(place.x, place.multipliers, neutral)


def _refuse_loose(stiffness: SparseStiffness, place: _Place, size: FloatArray) -> None:
    """Raise SceneError where there are forces that nothing resists."""
    if place.holding.any():
        worst = int(np.argmax(np.abs(place.holding * size)))
        name = stiffness.scene.velocity_names[worst]
        raise SceneError(
            f"no equilibrium found: at {name!r} a force of {place.holding[worst]:.6g} (N, N m, or modal) stays "
            "unbalanced, for nothing resists it; check that something carries this load, or prescribe the motion"
        )
