"""Closing the loops: the configuration and the velocities nearest to those wanted, least intrusive moves first.

Joints that nobody set move first, then those that were set, and bodies deform only by what no rigid motion closes, at
the least elastic energy.  Each stage goes on where the one before it ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.newton import Correction, newton
from flexmbd.errors import AssemblyError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.mass_solver import MassSolver, mass_solver
from flexmbd.multibody.plan.row_slopes import RowSlopes
from flexmbd.multibody.plan.scene_matrices import (
    constraint_slopes,
    constraint_values,
    coordinate_sizes,
    modal_stiffness,
    row_sizes,
)
from flexmbd.multibody.start.given_coordinates import NOTHING_GIVEN, GivenCoordinates, coordinate_names
from flexmbd.multibody.start.least_change import least_change
from flexmbd.multibody.start.loop_gaps import loop_gaps, loop_slopes
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A loop counts as closed when it stays open by no more than this share of the machine's size,
#: as where the frames of an overconstrained loop come from a mesh; it closes further if it can.
CLOSED = 1e-7
_ITERATIONS = 50
_LONGEST = 0.5  # of a coordinate's size: the longest step
_WORTH = 0.5  # a more intrusive stage must close more than this share of what the others leave open
_STILL = 1e-6  # of the gap: smaller steps than this do not reduce it
_GUESS_SIZE = 0.2  # how far (of each coordinate's size) it is tried from beside the wanted configuration
_TRIALS = 5  # how often
SAME_RATE = 1e-13  #: of the machine's rates: round-off


@dataclass(frozen=True, eq=False)
class Closing:
    """A configuration that closes the loops.

    Attributes:
        x: (nx,).
        change: (nv,) tangent vector from the configuration wanted.
        left_open: share of the machine's size that no rigid motion closed, so that bodies were deformed; else 0.
    """

    x: FloatArray
    change: FloatArray
    left_open: float


@dataclass(frozen=True, eq=False)
class _Stage:
    """Which coordinates may move (nv,); the roots of what their squared change costs (nv,); whether bodies deform."""

    movable: Mask
    cost: FloatArray
    deforms: bool


def _rigid(scene: CompiledScene) -> Mask:
    """(nv,) free coordinates of joints."""
    rigid = np.zeros(scene.nv, bool)
    rigid[scene.plan.free] = True
    for slots in scene.index.modes.values():
        rigid[slots.v] = False
    return rigid


def _stages(scene: CompiledScene, held: Mask, modal_cost: FloatArray) -> list[_Stage]:
    """Least intrusive first."""
    movable = np.zeros(scene.nv, bool)
    movable[scene.plan.free] = True
    rigid, unset = _rigid(scene), movable & ~held
    nothing, away = np.zeros(scene.nv), held / coordinate_sizes(scene)
    stages = [
        _Stage(rigid & unset, nothing, False),
        _Stage(rigid, away, False),
        _Stage(unset, modal_cost, True),
        _Stage(rigid | unset, modal_cost, True),
        _Stage(movable, modal_cost, True),
    ]
    masks = [s.movable for s in stages]
    return [s for k, s in enumerate(stages) if masks[k].any() and not any((masks[k] == m).all() for m in masks[:k])]


def close_loops(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask, given: GivenCoordinates = NOTHING_GIVEN
) -> Closing:
    """Close the loops, each stage from where the one before it ended, until they are closed to round-off.

    Args:
        scene: the scene.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) wanted configuration.
        held: (nv,) tangent directions that move only where other rigid motions cannot close the loops, or where modes
            are meant, where nothing else can.
        given: coordinates of joints held by constraints, which are kept; those ``held`` then are kept as well.

    Raises:
        AssemblyError: nothing closes the loops.
        SceneError: they close, but not with what the user gave.
    """
    best, gap = close_as_far(scene, work, x, held, given)
    if _largest(gap) > CLOSED:
        if given.positions:
            near = close_loops(scene, work, x, held).x  # or what is open is not the given coordinates' fault
            _refuse("positions", coordinate_names(given.positions), given.position_gaps(scene, work, near), "m or rad")
        worst = int(np.argmax(np.abs(gap)))
        raise AssemblyError(
            f"the mechanism cannot be assembled: {scene.row_names[worst]} stays open by "
            f"{abs(gap[worst]) * row_sizes(scene)[worst]:.3e} (m or rad); check lengths, frames and the joint "
            "positions set"
        )
    return best


def close_as_far(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask, given: GivenCoordinates = NOTHING_GIVEN
) -> tuple[Closing, FloatArray]:
    """As ``close_loops``, as far as the loops can be closed; and the gaps left (m,), over the machine's size."""
    best = Closing(x, np.zeros(scene.nv), 0.0)
    if len(scene.plan.rows) == 0 and not given.positions:
        return best, np.zeros(0)
    gap = _gaps(scene, work, x, given)
    for stage in _stages(scene, held, np.sqrt(modal_stiffness(scene))):
        if _largest(gap) <= ROUND_OFF:
            break
        if given.positions and (stage.movable & held).any():
            continue
        if given.positions and stage.deforms and _largest(gap) > CLOSED and _closes_rigidly(scene, work, x, held):
            break  # bodies are not bent to meet what was given
        left_open = _largest(gap) if stage.deforms and best.left_open == 0.0 else best.left_open
        for aside in _first_guesses(scene, stage, given):
            near = np.empty_like(x)
            retract(scene.plan, best.x, aside, near)
            trial, change, left = _gauss_newton(scene, work, near, best.change + aside, stage, given)
            if _largest(left) < _WORTH * _largest(gap):
                best, gap = Closing(trial, change, left_open), left
            if _largest(gap) <= CLOSED:
                break
    return best, gap


def close_rigidly(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask
) -> tuple[FloatArray, FloatArray]:
    """Where joints that are not held have closed the loops as far as they can: (nx,), and (nv,) how it lies from x."""
    stage = _Stage(_rigid(scene) & ~held, np.zeros(scene.nv), False)
    reached, change, _ = _gauss_newton(scene, work, x, np.zeros(scene.nv), stage, NOTHING_GIVEN)
    return reached, change


def _closes_rigidly(scene: CompiledScene, work: Work, x: FloatArray, held: Mask) -> bool:
    return close_loops(scene, work, x, held).left_open <= CLOSED


def _largest(gap: FloatArray) -> float:
    return float(np.abs(gap).max(initial=0.0))


def _first_guesses(scene: CompiledScene, stage: _Stage, given: GivenCoordinates) -> list[FloatArray]:
    """Where to begin, against the configuration at hand: there; and near it if given coordinates must be reached.

    For a mechanism at a dead centre, as one stretched out in a line, knows no way from there.
    """
    moves: list[FloatArray] = [np.zeros(scene.nv)]
    if given.positions and not stage.deforms:
        generator = np.random.default_rng(0)
        size = np.where(stage.movable, coordinate_sizes(scene), 0.0)
        moves += [_GUESS_SIZE * size * generator.uniform(-1.0, 1.0, scene.nv) for _ in range(_TRIALS)]
    return moves


def _refuse(what: str, names: list[str], gaps: FloatArray, unit: str) -> None:
    """Raise SceneError: what the user gave contradicts the loops, or itself."""
    worst = int(np.argmax(np.abs(gaps)))
    raise SceneError(
        f"the {what} set on joints contradict each other or the loops: {names[worst]!r} of a joint held by "
        f"constraints lies {abs(gaps[worst]):.3e} ({unit}) from where the others put it; set fewer, or others"
    )


def _gaps(scene: CompiledScene, work: Work, x: FloatArray, given: GivenCoordinates) -> FloatArray:
    """Gaps over the machine's size: of all rows, then of the given coordinates."""
    gaps = loop_gaps(scene, work, x)
    if not given.positions:
        return gaps
    return np.concatenate([gaps, given.position_gaps(scene, work, x) / given.position_sizes(scene)])


def _slopes(scene: CompiledScene, work: Work, x: FloatArray, given: GivenCoordinates) -> RowSlopes:
    """Rates of ``_gaps`` per unit of each velocity."""
    slopes = loop_slopes(scene, work, x)
    if not given.positions:
        return slopes
    more = given.position_slopes(scene, work, x) / given.position_sizes(scene)[:, None]
    return RowSlopes.of_matrix(np.vstack([slopes.matrix(), more]), scene.plan.free)


class _Reached(NamedTuple):
    """Configuration (nx,), how far it lies from the wanted one (nv,), gaps (m,), and whether a step closed no more."""

    x: FloatArray
    change: FloatArray
    gap: FloatArray
    is_last: bool = False


@dataclass(frozen=True, eq=False)
class _LoopProblem:
    """The loops as a problem for Newton's method, in which a stage's coordinates move."""

    scene: CompiledScene
    work: Work
    stage: _Stage
    given: GivenCoordinates

    def is_solved(self, here: _Reached, *, close: bool) -> bool:
        return here.is_last or close

    def correction(self, here: _Reached) -> Correction[FloatArray]:
        """The least change that closes the gaps, cut where a coordinate would go by more than ``_LONGEST``."""
        size = coordinate_sizes(self.scene)
        slopes = _slopes(self.scene, self.work, here.x, self.given)
        movable, cost = self.stage.movable, self.stage.cost
        step = least_change(slopes, here.gap, size=size, movable=movable, cost=cost, before=here.change)
        longest = _largest(step / size)
        share = min(1.0, _LONGEST / max(longest, _LONGEST))
        return Correction(step, longest, share=share, scale=_largest(here.gap))

    def moved(self, here: _Reached, correction: Correction[FloatArray], *, close: bool) -> _Reached:
        step, after = correction.share * correction.change, np.empty_like(here.x)
        retract(self.scene.plan, here.x, step, after)
        left = _gaps(self.scene, self.work, after, self.given)
        if _largest(here.gap) <= CLOSED and _largest(left) >= 0.1 * _largest(here.gap):
            return here._replace(is_last=True)
        return _Reached(after, here.change + step, left)


def _gauss_newton(
    scene: CompiledScene, work: Work, x: FloatArray, change: FloatArray, stage: _Stage, given: GivenCoordinates
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move a stage's coordinates until the loops close no further: configuration, whole change, what stays open."""
    begin = _Reached(x, change, _gaps(scene, work, x, given))
    found = newton(_LoopProblem(scene, work, stage, given), begin, most=_ITERATIONS, close=_STILL).place
    return found.x, found.change, found.gap


def match_velocities(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    held: Mask,
    given: GivenCoordinates = NOTHING_GIVEN,
    *,
    first: Mask | None = None,
) -> FloatArray:
    """The velocity (nv,) nearest to v that keeps the loops closed; arguments as of ``close_loops``.

    Modal rates change only by what no rigid motion can, by the least kinetic energy; before all others those of
    ``first`` (nv,) change, if any.

    Raises:
        AssemblyError: no velocity keeps the loops closed.
        SceneError: some do, but none with what the user gave.
    """
    if len(scene.plan.rows) == 0 and not given.velocities:
        return v
    size = coordinate_sizes(scene)
    gap = constraint_values(scene, work, x, v)[1] / row_sizes(scene)
    if not given.velocities and _largest(gap) <= SAME_RATE * max(_largest(v / size), _largest(gap)):
        return v + 0.0
    open_ = _largest(_gaps(scene, work, x, NOTHING_GIVEN))
    slopes = constraint_slopes(scene, work, x).over(row_sizes(scene))
    if given.velocities:
        sizes = given.velocity_sizes(scene)
        more = given.velocity_slopes(scene, work, x) / sizes[:, None]
        slopes = RowSlopes.of_matrix(np.vstack([slopes.matrix(), more]), scene.plan.free)
        gap = np.concatenate([gap, given.velocity_gaps(scene, work, x, v) / sizes])
    rate = max(_largest(v / size), _largest(gap))  # 1/s, the machine's
    change: FloatArray = np.zeros(scene.nv)
    stages = _stages(scene, held, np.ones(scene.nv) * (modal_stiffness(scene) > 0.0))
    if first is not None:
        stages.insert(0, _Stage(first, np.zeros(scene.nv), False))
    for stage in stages:
        if _largest(gap) <= SAME_RATE * rate:
            break
        if given.velocities and (stage.movable & held).any():
            continue
        step = least_change(
            slopes, gap, size=size, movable=stage.movable, cost=stage.cost, before=change, blurred=open_
        )
        left = gap + slopes.times(step)
        if _largest(left) < _WORTH * _largest(gap):
            change, gap = change + step, left
    if _largest(gap) <= CLOSED * rate or _largest(gap) <= SAME_RATE * own_rate(scene, work, x):
        return v + change
    if given.velocities:
        near = match_velocities(scene, work, x, v, held)
        names = coordinate_names(given.velocities)
        _refuse("velocities", names, given.velocity_gaps(scene, work, x, near), "m/s or rad/s")
    worst = int(np.argmax(np.abs(gap)))
    raise AssemblyError(
        f"the start's velocities contradict the loops: {scene.row_names[worst]} opens at "
        f"{abs(gap[worst]) * row_sizes(scene)[worst]:.3e} (m/s or rad/s); check prescribed motions and joint "
        "velocities"
    )


def own_rate(scene: CompiledScene, work: Work, x: FloatArray, solve: MassSolver | None = None) -> float:
    """1/s: the rate that the machine's forces and motions give it from rest within a coordinate's full size.

    Beside it the rates of a machine at rest are round-off, whatever they are to each other.  Gravity counts where
    constraints carry all of it, too: accelerations of bodies are known as sums with it.  ``solve``: by the mass matrix
    at x, if it is factored.
    """
    free, rest = scene.plan.free, np.zeros(scene.nv)
    pull = np.zeros(scene.nv)
    drive(scene.plan, work, x.copy(), rest.copy(), pull)
    if len(free):
        force = np.zeros(scene.nv)
        residual(scene.plan, work, x, rest, rest, np.zeros(len(scene.plan.rows)), force)
        pull[free] = (solve or mass_solver(scene, work, x))(force[None])[0, free]
    fastest = np.abs(pull / coordinate_sizes(scene)).max(initial=0.0)
    return float(np.sqrt(max(fastest, np.linalg.norm(scene.plan.gravity) / scene.extent)))
