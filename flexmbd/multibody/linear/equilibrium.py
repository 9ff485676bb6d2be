"""Equilibria and steady motions: by Newton's method, along a path, or downhill where that is asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, searched
from flexmbd.continuation.newton import SETTLED, Correction, newton
from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS, InteriorSnapshot
from flexmbd.multibody.interiors.steady import steady
from flexmbd.multibody.kernels.base.arrays import Work, memories_end
from flexmbd.multibody.kernels.base.compiling import compiling
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.reading.force_tables import element_numbers, rough_contacts, slid_ways
from flexmbd.multibody.linear.balance import ForceBalance, balance, motion_sizes, moved, step_size
from flexmbd.multibody.linear.derivatives import DERIVING
from flexmbd.multibody.linear.downhill import HinderedError, hindered, most_lacking, stable_below, step_downhill
from flexmbd.multibody.linear.forces_at_play import BALANCED, forces_at_play
from flexmbd.multibody.linear.passing import Passing, landing, passing
from flexmbd.multibody.linear.path.force_homotopy import LostPathError, Settled, forces_let_go
from flexmbd.multibody.linear.sparse_equilibrium import stable_equilibrium
from flexmbd.multibody.linear.stability import MotionSpectrum, has_potential, spectrum
from flexmbd.multibody.linear.steadiness import STEADY, refuse_changing, refuse_unsteady, start_moving
from flexmbd.multibody.linear.steady_motion import SteadyMotion
from flexmbd.multibody.linear.strain_predictor import strain_predictor, stretches
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.sides import refuse_other_sides
from flexmbd.overflow import refuse_overflow

FloatArray = NDArray[np.float64]

_ITERATIONS = 50  # with states of users' equations
_STEP = 0.3  # rad, or of the machine's extent: the longest step with these
_TRIALS = 9  # of a step downhill
_PUSHES_BACK = 0.9  # of the work of forces along it at its beginning: what they may do against it then


@dataclass(frozen=True, eq=False)
class ToldEquilibrium:
    """An equilibrium, and what is to be told of it, if anything."""

    point: WorkingPoint
    warning: str | None


@refuse_overflow("an equilibrium")
def find_equilibrium(start: Start, work: Work, *, stable: bool = False) -> ToldEquilibrium:
    """The equilibrium near the start, or the steady motion with the start's velocities.

    It is the one that Newton's step leads to if that is near what the linear equations predict, else the one at the end
    of the path along which the forces that the start lacks are let go (`path.force_homotopy`).  It may be unstable,
    which is told; a start that is in equilibrium is kept.  What nothing resists stays where it is.

    With ``stable`` the search goes downhill, and leaves what is unstable; forces that follow what they act on have no
    potential, and where the symmetric part of the stiffness does not lead to an equilibrium the path is taken.

    With states of users' equations it is where these rest as well, found by Newton's steps alone, for what they do has
    no energy: it may be unstable, and what is unstable is not counted.

    Args:
        start: the consistent start.
        work: scratch; ``work.time`` holds the functions of time.
        stable: whether to search downhill.

    Raises:
        SceneError: nothing balances, or with ``stable`` nothing stable is found; the message names the coordinate where
            most is lacking; or what does balance is no steady motion.
    """
    if not start.v.any():
        return _search(start, work, SteadyMotion(start.scene), stable=stable)
    with compiling(DERIVING, aloud=start.scene.parts.team.is_root):
        motion, v = start_moving(start, work)
    try:
        found = _search(replace(start, v=v), work, motion, stable=stable)
    except (SceneError, np.linalg.LinAlgError) as reason:
        if start.scene.interiors is None:  # which tell by themselves that they turn
            refuse_changing(start, v, work, motion, reason)
        raise
    point = replace(found.point, steady_accelerations=motion.accelerations(work, found.point.x))
    refuse_unsteady(point, work, motion, balance(point.scene, work, point.x, point.v, motion=motion).of)
    return replace(found, point=point)


def _search(start: Start, work: Work, motion: SteadyMotion, *, stable: bool) -> ToldEquilibrium:
    """As ``find_equilibrium``, whether or not the motion is steady."""
    scene = start.scene
    sizes = motion_sizes(scene, work, start.x)
    if not (start.v.any() or motion.pairs or scene.state_mask.any() or scene.interiors or stretches(scene.plan)):
        stable_one = stable_equilibrium(scene, work, start.x, sizes)
        if stable_one is not None:
            point = _point(scene, work, stable_one.x, start.v, stable_one.multipliers)
            return ToldEquilibrium(replace(point, unstable=0, neutral=stable_one.neutral), None)
    with compiling(DERIVING, aloud=scene.parts.team.is_root):
        here = balance(scene, work, start.x, start.v, motion=motion)
    if scene.state_mask.any():
        if stable:
            raise SceneError(
                "stable=True asks for a search downhill, but states of users' equations have no energy; leave it out"
            )
        there = _with_states(scene, work, here, sizes)
        return ToldEquilibrium(_working_point(scene, work, there, None), None)
    strains = strain_predictor(scene.plan, work, scene.nv)
    if not stable:
        try:
            found = forces_let_go(scene, work, here, strains, sizes)
            return ToldEquilibrium(_working_point(scene, work, found.point.at, found.spectrum), _warning(scene, found))
        except LostPathError as reason:
            # as where a symmetric body turns freely: out of balance its stiffness shows no motion that nothing resists
            try:
                there = stable_below(scene, work, here, strains, sizes)
            except HinderedError:
                raise
            except SceneError:
                raise reason from reason.__cause__
            after = spectrum(scene, there)
            told = _unstable(scene, after) if after.diverging and not there.v.any() else None
            return ToldEquilibrium(_working_point(scene, work, there, after), told)
    try:
        there = stable_below(scene, work, here, strains, sizes)
    except SceneError:
        if scene.interiors is not None or has_potential(scene, here):
            raise
        there = forces_let_go(scene, work, here, strains, sizes).point.at
    after = spectrum(scene, there)
    if after.diverging and not there.v.any():
        raise SceneError(
            f"no stable equilibrium found: from the one that was, {_growing(scene, after)}; forces that follow what "
            "they act on may leave none"
        )
    return ToldEquilibrium(_working_point(scene, work, there, after), None)


def equilibrium_at_rest(start: Start, work: Work, *, stable: bool = False) -> ToldEquilibrium:
    """As ``find_equilibrium``, with prescribed motions held still where they are."""
    work.time[:-1, 1:] = 0.0
    return find_equilibrium(replace(start, v=np.zeros_like(start.v)), work, stable=stable)


def _working_point(
    scene: CompiledScene, work: Work, there: ForceBalance, after: MotionSpectrum | None
) -> WorkingPoint:
    """A state in balance, with what force elements and bodies with history remember there."""
    kept = NO_INTERIORS
    if scene.interiors is not None:
        balance(scene, work, there.x, there.v, motion=there.motion)  # what was tried last may be another state
        kept = _committed(scene)
    point = replace(_point(scene, work, there.x, there.v, there.multipliers), interiors=kept)
    return point if after is None else replace(point, unstable=after.unstable, neutral=_neutral(scene, after))


def _point(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, multipliers: FloatArray
) -> WorkingPoint:
    """A state in balance, with what force elements remember there."""
    t = float(work.time[-1, 0])
    if memories_end(scene.plan):
        x = x.copy()
        remember(scene.plan, work, x, v, t)
    refuse_other_sides(scene, t, x, v)
    return WorkingPoint(scene, t, x, v, multipliers)


def _committed(scene: CompiledScene) -> InteriorSnapshot:
    """The memories of bodies with history in balance: those of their last trial."""
    if scene.interiors is None:
        return NO_INTERIORS
    for body in scene.interiors.bodies:
        steady(body).commit()
    return scene.interiors.snapshot(scene.plan)


def _neutral(scene: CompiledScene, after: MotionSpectrum) -> tuple[str, ...]:
    """Names of as many coordinates as there are independent motions that nothing resists, those that move most."""
    if not after.idle.any():
        return ()
    parts = after.shapes[:, after.idle] / coordinate_sizes(scene)[:, None]
    _, _, order = scipy.linalg.qr(parts.T, mode="economic", pivoting=True)
    return tuple(scene.velocity_names[k] for k in np.sort(order[: parts.shape[1]]))


def _warning(scene: CompiledScene, found: Settled) -> str | None:
    """What is to be told of an equilibrium that the machine does not start from."""
    after, rests = found.spectrum, not found.point.at.v.any()
    if not found.moved:
        return None
    # gyroscopic forces may hold an even number of motions that the stiffness does not (Thomson and Tait), no odd one
    if after.diverging and (rests or after.diverging % 2):
        return _unstable(scene, after)
    if found.turned and rests:
        return (
            "between the start and the equilibrium that was found the path of equilibria turns: the machine comes "
            "there by a jump, if at all, as the load grows; path=fm.Continuation(to=...) follows the path"
        )
    return None


def _unstable(scene: CompiledScene, after: MotionSpectrum) -> str:
    return (
        f"the equilibrium is unstable: {_growing(scene, after)}; stable=True searches for one that the machine "
        "settles in, path=fm.Continuation(to=...) shows where this one becomes unstable as the load grows"
    )


def _growing(scene: CompiledScene, after: MotionSpectrum) -> str:
    """How many motions lead away, and the coordinate that one of them moves most."""
    parts = np.abs(after.diverging_mode()) / coordinate_sizes(scene)
    name = scene.velocity_names[int(np.argmax(parts))]
    count = "one motion grows" if after.diverging == 1 else f"{after.diverging} independent motions grow"
    return f"{count}, most of all in {name!r}"


@dataclass(frozen=True, eq=False)
class _RestWithStates:
    """Where a machine and states of users' equations rest, as a problem for Newton's method; ``sizes``: motions'."""

    scene: CompiledScene
    work: Work
    sizes: FloatArray

    def is_solved(self, here: ForceBalance, *, close: bool) -> bool:
        return close

    def correction(self, here: ForceBalance) -> Correction[FloatArray]:
        """Newton's own step, cut to no more than ``_STEP`` of places; states have no largest step.

        Where the states are ways that contacts have slid, and it presses something, it is the step downhill.
        """
        step, through = self._downhill(here), Passing()
        if step is not None:
            through = passing(self.scene, self.work, here.x, step)
        if step is None or not through.meets:
            step = _full_newton_step(self.scene, self.work, here)
            through = passing(self.scene, self.work, here.x, step)
        longest = step_size(self.sizes, np.where(self.scene.state_mask, 0.0, step))
        share = min(1.0, _STEP / max(longest, _STEP), through.share)
        return Correction(step, step_size(self.sizes, step), share=share)

    def _downhill(self, here: ForceBalance) -> FloatArray | None:
        """(nv,) the step downhill of places; None where states are others than ways that contacts have slid."""
        scene, bodies = self.scene, ~self.scene.state_mask[here.by.z]
        if not bodies.any() or not self.slides:
            return None
        Vz = here.by.Vz[:, bodies]
        stiffness, mass = Vz.T @ here.of.stiffness @ Vz, here.mass[np.ix_(bodies, bodies)]
        at_play = forces_at_play(scene, self.work, here)
        return Vz @ step_downhill(stiffness, mass, here.lacking[bodies], Vz=Vz, sizes=self.sizes, at_play=at_play)[0]

    @cached_property
    def slides(self) -> bool:
        """Whether all states are ways that contacts have slid."""
        return bool(np.isin(np.flatnonzero(self.scene.state_mask), slid_ways(self.scene.plan)).all())

    def moved(self, here: ForceBalance, correction: Correction[FloatArray], *, close: bool) -> ForceBalance:
        """Where a step leads; less of it where it goes downhill, and forces push back before its end."""
        scene, states, change = self.scene, self.scene.state_mask, correction.share * correction.change
        places, rates = np.where(states, 0.0, change), np.where(states, change, 0.0)
        touch, along = passing(scene, self.work, here.x, places).touch, places[here.by.z]
        before = float(here.lacking @ along)

        def trial(part: float) -> ShareTrial[ForceBalance]:
            x = moved(scene, self.work, here.x, part * places)
            there = balance(scene, self.work, x, here.v + part * rates, motion=here.motion)
            if close or not (self.slides and touch < np.inf) or not np.array_equal(there.by.z, here.by.z):
                return ShareTrial(there, part, 0.0)
            work = float(there.lacking @ along)
            return landing(there, part, touch=touch, work=work, before=before, ratio=_PUSHES_BACK)

        return searched(trial, most=_TRIALS).place


def _with_states(scene: CompiledScene, work: Work, here: ForceBalance, sizes: FloatArray) -> ForceBalance:
    """Where states of users' equations rest as well, by Newton's steps.

    Raises:
        SceneError: they do not converge.
    """
    found = newton(_RestWithStates(scene, work, sizes), here, most=_ITERATIONS, close=SETTLED)
    here = found.place
    if found.is_solution:
        _refuse_unresisted(scene, work, here, here.lacking)
        return here
    step = _full_newton_step(scene, work, here)
    through = passing(scene, work, here.x, step)
    if through.share < 1.0:
        raise hindered(scene, here, through)
    _refuse_unresisted(scene, work, here, here.lacking + here.by.Vz.T @ _slopes(scene, here) @ step)
    raise SceneError(
        f"no equilibrium found in {found.iterations} steps: {most_lacking(scene, here)}; check that something "
        "carries this load, or start nearer to the equilibrium"
    )


def _refuse_unresisted(scene: CompiledScene, work: Work, here: ForceBalance, left: FloatArray) -> None:
    """Raise SceneError where one of the forces (nz,) that Newton leaves alone is resisted by no place and no state."""
    z, beyond = here.by.z, _beyond(scene, work, here, left)
    if beyond.max(initial=0.0) > 0.0:
        worst = int(np.argmax(beyond))
        raise SceneError(
            f"no equilibrium found: at {scene.velocity_names[z[worst]]!r} a force of {-left[worst]:.6g} (N, "
            f"N m, or modal) stays unbalanced, for neither a place nor a state resists it{_rubs(scene)}"
        )


def _beyond(scene: CompiledScene, work: Work, here: ForceBalance, left: FloatArray) -> FloatArray:
    """(nz,) by how much forces (nz,) are more than round-off; of states nothing."""
    return np.where(scene.state_mask[here.by.z], 0.0, np.abs(left) - STEADY * _at_play(scene, work, here))


def _at_play(scene: CompiledScene, work: Work, here: ForceBalance) -> FloatArray:
    """(nz,) the forces at play along the independent changes."""
    return np.asarray(np.abs(here.by.Vz).T @ (forces_at_play(scene, work, here) / coordinate_sizes(scene)))


def _rubs(scene: CompiledScene) -> str:
    """Of contacts with friction, that it is none of an equilibrium's forces; nothing without any."""
    rough = [scene.element_names[k] for k in element_numbers(scene.plan, [*rough_contacts(scene.plan)])]
    if not rough:
        return "; hold it by a joint, a spring or a stop"
    return (
        f". Friction ({rough[0]}{', ...' if len(rough) > 1 else ''}) does not bear it here: how much it bears at rest "
        "follows from the way there, and an equilibrium has none. Let the machine come to rest by simulate(...), where "
        "it holds up to mu N, or hold it by a joint, a spring or a stop"
    )


def _slopes(scene: CompiledScene, here: ForceBalance) -> FloatArray:
    """(nv, nv) derivatives of the forces by places and, in the columns of states, by these."""
    slopes, states = here.of.stiffness.copy(), scene.state_mask
    slopes[:, states] = here.of.damping[:, states]
    return slopes


def _full_newton_step(scene: CompiledScene, work: Work, here: ForceBalance) -> FloatArray:
    """Newton's own step (nv,) of places and of states, the shortest where nothing tells some of them.

    What resists by less than round-off of the forces at play tells nothing.
    """
    size = coordinate_sizes(scene)
    Vz = here.by.Vz
    matrix = Vz.T @ _slopes(scene, here) @ Vz * size[here.by.z]
    rows = np.abs(matrix).max(axis=1, initial=0.0)
    nothing = (rows <= BALANCED * _at_play(scene, work, here)) & ~scene.state_mask[here.by.z]
    matrix[nothing] = 0.0
    rows[nothing | (rows == 0.0)] = 1.0
    found = np.linalg.lstsq(matrix / rows[:, None], here.lacking / rows, rcond=None)[0]
    return np.asarray(Vz @ (-found * size[here.by.z]), dtype=np.float64)
