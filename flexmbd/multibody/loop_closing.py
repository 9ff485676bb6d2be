"""Closing the loops: the configuration and the velocities nearest to those wanted, least intrusive moves first."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError, SceneError
from flexmbd.multibody.given_coordinates import NOTHING_GIVEN, Given, coordinate_names
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.plan import CompiledScene
from flexmbd.multibody.scene_matrices import constraint_jacobian, constraint_values

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A loop counts as closed when it stays open by no more than this share of the machine's extent,
# as where the frames of an overconstrained loop come from a mesh; it closes further if it can.
_CLOSED = 1e-7
_ROUND_OFF = 1e-14
_ITERATIONS = 50
# How far (rad, or of the machine's extent) and how often it is tried from beside the wanted configuration.
_ASIDE = 0.2
_TRIALS = 5


def _stages(scene: CompiledScene, held: Mask) -> list[Mask]:
    """Which coordinates may move, least intrusive first."""
    movable = np.zeros(scene.nv, bool)
    movable[scene.plan.free] = True
    modal = np.zeros(scene.nv, bool)
    for slots in scene.modal_slots.values():
        modal[slots.v] = True
    stages = [movable & ~held & ~modal, movable & ~held, movable & ~modal, movable]
    return [s for k, s in enumerate(stages) if s.any() and not any((s == t).all() for t in stages[:k])]


def close_loops(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask, given: Given = NOTHING_GIVEN
) -> tuple[FloatArray, list[tuple[str, float, float]]]:
    """Close the loops by the first stage that closes them to round-off, else by the best one.

    Args:
        scene: the scene.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) wanted configuration.
        held: (nv,) tangent directions that move only where the others cannot close the loops.
        given: coordinates of joints held by constraints, which are kept; those ``held`` then are kept as well.

    Returns:
        The configuration, and what moved: (coordinate, 0, by how much).

    Raises:
        AssemblyError: nothing closes the loops.
        SceneError: they close, but not with what the user gave.
    """
    if len(scene.plan.rows) == 0 and not given.positions:
        return x, []
    best_x: FloatArray = x
    best_total: FloatArray = np.zeros(scene.nv)
    best = _gaps(scene, work, x, given)
    for movable in _stages(scene, held):
        if given.positions and (movable & held).any():
            break
        for aside in _moves_aside(scene, movable, given):
            near = np.empty_like(x)
            retract(scene.plan, x, aside, near)
            trial, total, phi = _gauss_newton(scene, work, near, movable, given)
            if np.abs(phi).max() < 0.1 * np.abs(best).max():  # less intrusive stages have preference
                best_x, best_total, best = trial, aside + total, phi
            if np.abs(best).max() <= _CLOSED * scene.extent:
                break
        if np.abs(best).max() <= _ROUND_OFF * scene.extent:
            break
    worst = int(np.argmax(np.abs(best)))
    if abs(best[worst]) > _CLOSED * scene.extent:
        if given.positions:
            near, _ = close_loops(scene, work, x, held)  # or what is open is not the given coordinates' fault
            _refuse("positions", coordinate_names(given.positions), given.position_gaps(scene, work, near), "m or rad")
        raise AssemblyError(
            f"the mechanism cannot be assembled: {scene.row_names[worst]} stays open by "
            f"{abs(best[worst]):.3e} (m or rad); check lengths, frames and the joint positions set"
        )
    changed = np.flatnonzero(np.abs(best_total) > _CLOSED * scene.extent)
    return best_x, [(scene.velocity_names[k], 0.0, float(best_total[k])) for k in changed]


def _moves_aside(scene: CompiledScene, movable: Mask, given: Given) -> list[FloatArray]:
    """Where to begin, against the wanted configuration: there; and near it if given coordinates must be reached.

    For a mechanism at a dead centre, as one stretched out in a line, knows no way from there.
    """
    moves: list[FloatArray] = [np.zeros(scene.nv)]
    if given.positions:
        generator = np.random.default_rng(0)
        size = np.where(movable, scene.group_full[scene.group_of], 0.0)
        for slots in scene.modal_slots.values():
            size[slots.v] = 0.0
        moves += [_ASIDE * size * generator.uniform(-1.0, 1.0, scene.nv) for _ in range(_TRIALS)]
    return moves


def _refuse(what: str, names: list[str], gaps: FloatArray, unit: str) -> None:
    """Raise SceneError: what the user gave contradicts the loops, or itself."""
    worst = int(np.argmax(np.abs(gaps)))
    raise SceneError(
        f"the {what} set on joints contradict each other or the loops: {names[worst]!r} of a joint held by "
        f"constraints lies {abs(gaps[worst]):.3e} ({unit}) from where the others put it; set fewer, or others"
    )


def _gaps(scene: CompiledScene, work: Work, x: FloatArray, given: Given) -> FloatArray:
    """What is open: all rows, then the given coordinates."""
    phi = constraint_values(scene, work, x, np.zeros(scene.nv))[0]
    return np.concatenate([phi, given.position_gaps(scene, work, x)]) if given.positions else phi


def _gauss_newton(
    scene: CompiledScene, work: Work, x: FloatArray, movable: Mask, given: Given
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move some coordinates until the loops close no further: configuration, move, what stays open."""
    rest: FloatArray = np.zeros(scene.nv)
    phi = _gaps(scene, work, x, given)
    holds = np.ones(len(phi), bool)
    holds[: len(scene.plan.rows)] = scene.plan.rows[:, at.ROW_LEVEL] == at.LEVEL_POSITION
    trial, total = x, rest
    for _ in range(_ITERATIONS):
        jacobian = constraint_jacobian(scene, work, trial)
        if given.positions:
            jacobian = np.vstack([jacobian, given.position_slopes(scene, work, trial)])
        step = np.zeros(scene.nv)
        step[movable] = -scipy.linalg.lstsq(jacobian[np.ix_(holds, movable)], phi[holds], cond=1e-10)[0]
        step *= min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        moved = np.empty_like(trial)
        retract(scene.plan, trial, step, moved)
        left = _gaps(scene, work, moved, given)
        settled = np.abs(phi).max() <= _CLOSED * scene.extent
        if settled and np.abs(left).max() >= 0.1 * np.abs(phi).max():
            break
        trial, total, phi = moved, total + step, left
    return trial, total, phi


def match_velocities(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, held: Mask, given: Given = NOTHING_GIVEN
) -> tuple[FloatArray, list[tuple[str, float, float]]]:
    """The velocity nearest to v that keeps the loops closed; arguments as of ``close_loops``.

    Returns:
        The velocity, and what changed: (coordinate, from, to).

    Raises:
        AssemblyError: no velocity keeps the loops closed.
        SceneError: some do, but none with what the user gave.
    """
    if len(scene.plan.rows) == 0 and not given.velocities:
        return v, []
    jacobian = constraint_jacobian(scene, work, x)
    gap = constraint_values(scene, work, x, v)[1]
    if given.velocities:
        jacobian = np.vstack([jacobian, given.velocity_slopes(scene, work, x)])
        gap = np.concatenate([gap, given.velocity_gaps(scene, work, x, v)])
    scale = max(1.0, float(np.abs(v).max(initial=0.0)))
    left = gap
    if np.abs(gap).max() <= 1e-13 * scale:
        return v, []
    for movable in _stages(scene, held):
        if given.velocities and (movable & held).any():
            break
        step = np.zeros(scene.nv)
        step[movable] = -scipy.linalg.lstsq(jacobian[:, movable], gap, cond=1e-10)[0]
        left = gap + jacobian @ step
        if np.abs(left).max() <= 1e-9 * scale:
            changes = [
                (f"rate of {scene.velocity_names[k]}", float(v[k]), float(v[k] + step[k]))
                for k in np.flatnonzero(np.abs(step) > 1e-12 * scale)
            ]
            return v + step, changes
    if given.velocities:
        near, _ = match_velocities(scene, work, x, v, held)
        names = coordinate_names(given.velocities)
        _refuse("velocities", names, given.velocity_gaps(scene, work, x, near), "m/s or rad/s")
    worst = int(np.argmax(np.abs(left)))
    raise AssemblyError(
        f"the start's velocities contradict the loops: {scene.row_names[worst]} opens at "
        f"{abs(left[worst]):.3e} (m/s or rad/s); check prescribed motions and joint velocities"
    )
