"""Whether a motion is steady: what drives it, seen from its turning axes, stays the same as it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows, driven_coordinates
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.kernels.reading.tree import tree_joint
from flexmbd.multibody.linear.balance import nothing_prescribed, reactions
from flexmbd.multibody.linear.derivatives import Derivatives, derive
from flexmbd.multibody.linear.elimination import Elimination, eliminate, own_coordinates
from flexmbd.multibody.linear.round_off import energies_at_play
from flexmbd.multibody.linear.steady_motion import SteadyMotion, carried
from flexmbd.multibody.linear.turning_pairs import turning_pairs
from flexmbd.multibody.linear.whole_turn import twists
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import constraint_values, coordinate_sizes, row_sizes
from flexmbd.multibody.start.consistent_start import Start, accelerations
from flexmbd.multibody.start.given_coordinates import coordinates_given
from flexmbd.multibody.start.given_start import given_start
from flexmbd.multibody.start.loop_closing import match_velocities
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]

STEADY = 1e-6  #: of the forces at play: what may be left of a force in balance
SAME = 1e-7  #: of what a coordinate's own inertia and stiffness are: what may change along a steady motion
AHEAD = (0.3, 1.1)  #: how far along the motion (rad, or of the extent) that is looked at


def motion_rate(scene: CompiledScene, v: FloatArray) -> float:
    """1/s, the largest velocity of v (nv,) over its coordinate's size."""
    moving = np.where(scene.state_mask, 0.0, np.abs(v))
    return float(np.max(moving / coordinate_sizes(scene), initial=0.0))


class FoundMotion(NamedTuple):
    """A steady motion, what changes along it in words, if anything, and derivatives of the equations where it is."""

    motion: SteadyMotion
    changes: str | None
    of: Derivatives


def steady_motion(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, multipliers: FloatArray | None = None
) -> FoundMotion:
    """The steady motion through x (nx,), v (nv,) whose turning axes see the same machine at any time.

    Where none do it is that of the body that most likely tells the turn of the whole.

    Args:
        scene: the machine.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) where.
        v: (nv,) how fast.
        multipliers: (m,) reactions there; by default those that leave least out of balance.
    """
    if motion_rate(scene, v) == 0.0:
        rest = SteadyMotion(scene)
        return FoundMotion(rest, None, _equations(scene, work, x, v, rest, multipliers)[0])
    pairs = turning_pairs(scene, work, x)
    tried: list[FoundMotion] = []
    for whole in twists(scene, work, x, v, pairs):
        motion = carried(scene, work, x, v, whole, pairs)
        if not motion.pairs and any(not other.motion.pairs for other in tried):
            continue
        of, open_ = _equations(scene, work, x, v, motion, multipliers)
        seen = _seen_turning(of, open_, motion, work, x, x, 0.0)
        tried.append(FoundMotion(motion, _change_along(scene, work, x, v, motion, seen), of))
        if tried[-1].changes is None:
            return tried[-1]
    return tried[0]


def start_moving(start: Start, work: Work) -> tuple[SteadyMotion, FloatArray]:
    """The steady motion that a start begins, and its velocities (nv,).

    Bodies that constraints alone hold are given no velocities: if those that change least of the others' make no
    steady motion, such a body's own change first, so that what hangs on it moves as one with it.
    """
    scene, x, v = start.scene, start.x, start.v
    motion, changes, _ = steady_motion(scene, work, x, v)
    flying = np.zeros(scene.nv, bool)
    for branch in scene.topology.branches:
        if branch.connection is None:
            flying[tree_joint(scene.plan, scene.index.bodies[branch.outer.body]).v] = True
    if changes is None or not flying.any():
        return motion, v
    given = given_start(scene, list(scene.index.joints), list(scene.index.modes))
    at, wanted = x.copy(), given[1]
    drive(scene.plan, work, at, wanted, np.zeros(scene.nv))
    other = match_velocities(scene, work, x, wanted, given[3], coordinates_given(scene), first=flying)
    found, changes, _ = steady_motion(scene, work, x, other)
    return (motion, v) if changes is not None else (found, other)


def _change_along(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, motion: SteadyMotion, now: Derivatives
) -> str | None:
    """What changes of the linear equations, seen from the turning axes, in words; None where they stay the same.

    They are compared as they are once the loops are eliminated, for rows fixed in the ground turn against these axes.
    All is compared as forces at a coordinate within the motion's own time, 1 / rate: stiffness with damping times the
    rate and mass times its square.
    """
    rate, A = motion_rate(scene, v), motion.slopes(work, x).velocity
    try:
        of = replace(now, rate_slope=now.rate_slope - now.jacobian @ A)
        by = eliminate(scene, own_coordinates(scene), of, A, nothing_prescribed(scene))
        own = _own_forces(now, by, rate)
        for distance in AHEAD:
            t = distance / rate
            there = motion.later(work, x, v, t), motion.transport(work, x, t) @ v
            later = _seen_turning(*_equations(scene, work, *there, motion), motion, work, x, there[0], t)
            found = _changed_rows(scene, now, later, by, A, rate)
            found = found or _changed_matrices(scene, now, later, by, A, own, rate)
            if found is not None:
                return found
    except (FlexmbdError, np.linalg.LinAlgError) as reason:
        return f"along it the equations cannot be followed ({reason})"
    return None


def _equations(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    motion: SteadyMotion,
    multipliers: FloatArray | None = None,
) -> tuple[Derivatives, FloatArray]:
    """Derivatives at x (nx,), v (nv,) in a steady motion, and the force (nv,) that is out of balance."""
    a, force = motion.accelerations(work, x), np.zeros(scene.nv)
    residual(scene.plan, work, x, v, a, np.zeros(len(scene.plan.rows)), force)
    scene.refuse_failed(work)
    nu = reactions(scene, work, x, v, force) if multipliers is None else multipliers
    of = derive(scene.plan, work, x, v, nu, size=coordinate_sizes(scene), a=a)
    return of, force + of.jacobian.T @ nu


def _seen_turning(
    of: Derivatives, open_: FloatArray, motion: SteadyMotion, work: Work, x: FloatArray, there: FloatArray, t: float
) -> Derivatives:
    """Derivatives of motions beside the steady one as the turning axes see them.

    Args:
        of: the machine's, where it is a while later.
        open_: (nv,) force that is out of balance there.
        motion: the steady motion.
        work: scratch.
        x: (nx,) where it was.
        there: (nx,) where it is.
        t: s, how much later.
    """
    if not motion.pairs:
        return of
    T, by = motion.transport(work, x, t), motion.slopes(work, there)
    A, B = by.velocity, by.turning
    damping = of.damping + of.mass @ (A + B)
    stiffness = of.stiffness + of.damping @ A + of.mass @ by.acceleration
    return Derivatives(
        T.T @ of.mass @ T,
        T.T @ damping @ T,
        T.T @ stiffness @ T + motion.bend(work, x, t, open_),
        of.jacobian @ T,
        (of.rate_slope + of.jacobian @ A) @ T,
    )


def _parts(seen: Derivatives, by: Elimination, A: FloatArray, rate: float) -> Iterator[tuple[str, FloatArray]]:
    """What the equations consist of, by its name: forces along independent velocities within the motion's time."""
    rates = by.Vy - A @ by.Xy
    yield "stiffness", by.Vz.T @ (seen.stiffness @ by.Xy + seen.damping @ rates)
    yield "damping", rate * by.Vz.T @ seen.damping @ by.Vz
    yield "mass", rate**2 * by.Vz.T @ seen.mass @ by.Vz


def _own_forces(seen: Derivatives, by: Elimination, rate: float) -> tuple[FloatArray, FloatArray]:
    """(nz,), (ny,) the roots of what each independent velocity and coordinate has of its own."""
    found = []
    for along in (by.Vz, by.Xy):
        parts = ((seen.stiffness, 1.0), (seen.damping, rate), (seen.mass, rate**2))
        own = sum(np.abs(((part @ along) * along).sum(axis=0)) * factor for part, factor in parts)
        found.append(np.sqrt(own))
    return found[0], found[1]


def _changed_matrices(
    scene: CompiledScene,
    now: Derivatives,
    later: Derivatives,
    by: Elimination,
    A: FloatArray,
    own: tuple[FloatArray, FloatArray],
    rate: float,
) -> str | None:
    for (name, old), (_, new) in zip(_parts(now, by, A, rate), _parts(later, by, A, rate), strict=True):
        columns = own[1] if name == "stiffness" else own[0]
        at = by.y if name == "stiffness" else by.z
        change = np.abs(new - old)
        scale = np.outer(own[0], columns)
        share = np.divide(change, scale, out=np.zeros_like(change), where=scale > 0.0)
        if share.size and share.max() > SAME:
            k = at[np.unravel_index(int(share.argmax()), share.shape)[1]]
            return (
                f"along it the {name} of {scene.velocity_names[k]!r} changes by {share.max():.3g} of the forces of the "
                "motion itself"
            )
    return None


def _changed_rows(
    scene: CompiledScene, now: Derivatives, later: Derivatives, by: Elimination, A: FloatArray, rate: float
) -> str | None:
    """Of the constraints: what kept them at first must keep them later."""
    size, holds = coordinate_sizes(scene), constraint_rows(scene.plan).holds_position
    if not len(holds):
        return None
    rows = np.abs(now.jacobian * size).max(axis=1)
    slope = later.rate_slope @ by.Xy + later.jacobian @ (by.Vy - A @ by.Xy)
    gaps = (
        np.where(holds, np.abs(later.jacobian @ by.Xy * size[by.y]).max(axis=1, initial=0.0), 0.0),
        np.abs(later.jacobian @ by.Vz * size[by.z]).max(axis=1, initial=0.0),
        np.abs(slope * size[by.y]).max(axis=1, initial=0.0) / rate,
    )
    for gap in gaps:
        for k in np.flatnonzero(gap > SAME * rows):
            return f"along it the constraint {scene.row_names[k]!r} changes"
    return None


def refuse_changing(start: Start, v: FloatArray, work: Work, motion: SteadyMotion, reason: Exception) -> None:
    """Raise SceneError, because of ``reason``, where a machine's equations change along the motion that a start begins.

    The message says what accelerates there, if anything does.
    """
    scene = start.scene
    _, changes, of = steady_motion(scene, work, start.x, v)
    if changes is None:
        return
    a = motion.accelerations(work, start.x)
    point = WorkingPoint(scene, float(work.time[-1, 0]), start.x, v, start.multipliers, steady_accelerations=a)
    try:
        refuse_unsteady(point, work, motion, of)
    except SceneError as unsteady:
        raise unsteady from reason
    raise SceneError(f"the motion is not steady: {changes}; {WHAT_IS}") from reason


def refuse_unsteady(point: WorkingPoint, work: Work, motion: SteadyMotion, of: Derivatives) -> None:
    """Raise SceneError where the machine, moving on from ``point``, would be accelerated otherwise, or its loops open.

    What drives a prescribed motion has to stay the same, too.

    Args:
        point: the state.
        work: scratch; ``work.time`` holds the functions of time, of which those of prescribed motions go on evenly.
        motion: the steady motion.
        of: of the equations at the point.
    """
    scene = point.scene
    rate = motion_rate(scene, point.v)
    if rate == 0.0 or scene.interiors is not None:  # frames of interiors move straight on
        return
    size, kept = coordinate_sizes(scene), work.time.copy()
    # what holds a body in its orbit is nothing that joints pass on: its inertia and other forces by their sizes
    bare = replace(scene, plan=without_forces(scene.plan))
    inertial = energies_at_play(replace(point, scene=bare, multipliers=np.zeros_like(point.multipliers)), work)
    energies = energies_at_play(point, work) + inertial
    at_play = STEADY * energies / size + EQUAL * (np.abs(of.stiffness) + rate**2 * np.abs(of.mass)) @ size
    driven, driven_rows = driven_coordinates(scene.plan), np.flatnonzero(constraint_rows(scene.plan).time >= 0)
    tight = STEADY * float(energies.max(initial=0.0)) / row_sizes(scene)[driven_rows]
    drives: list[FloatArray] = []
    for t in (0.0, *(distance / rate for distance in AHEAD)):
        x, v = motion.later(work, point.x, point.v, t), motion.transport(work, point.x, t) @ point.v
        work.time[driven.time, 0] = x[driven.x]
        _refuse_opening(scene, work, x, v, t)
        a = motion.accelerations(work, x)
        try:
            found, multipliers = accelerations(scene, work, x, v)
        except FlexmbdError as reason:
            raise SceneError(f"the motion is not steady: {t:.3g} s on, {reason}") from reason
        left, parts = left_and_parts(scene, work, x, v, a, multipliers)
        work.time[:] = kept
        allowed = STEADY * parts + at_play
        _refuse_accelerated(scene, left, found - a, allowed, t)
        drives.append(np.append(left[driven.v], multipliers[driven_rows]))
        wrong = np.abs(drives[-1] - drives[0]) > np.append(allowed[driven.v], tight)
        if wrong.any():
            names = [*(scene.velocity_names[k] for k in driven.v), *(scene.row_names[k] for k in driven_rows)]
            k = int(np.argmax(wrong))
            raise SceneError(
                f"the motion is not steady: what drives {names[k]!r} changes by {drives[-1][k] - drives[0][k]:.6g} (N "
                f"or N m), {t:.3g} s on; {WHAT_IS}"
            )


def left_and_parts(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(nv,) each, the residual and the sum of the sizes of what it is made of."""
    left, weight, held = np.zeros((3, scene.nv))
    light = scene.plan.replace(gravity=np.zeros(3))
    residual(scene.plan, work, x, v, a, multipliers, left)
    residual(light, work, x, v, a, multipliers, weight)
    residual(light, work, x, v, a, np.zeros_like(multipliers), held)
    return left, np.abs(left - weight) + np.abs(weight - held) + np.abs(held)


def _refuse_accelerated(
    scene: CompiledScene, left: FloatArray, change: FloatArray, allowed: FloatArray, t: float
) -> None:
    """Raise SceneError where more than ``allowed`` (nv,) is ``left`` (nv,); ``change`` is what it accelerates by."""
    free = np.zeros(scene.nv, bool)
    free[scene.plan.free] = True
    wrong = free & ~scene.state_mask & (np.abs(left) > allowed)
    if wrong.any():
        k = int(np.argmax(np.where(wrong, np.abs(change / coordinate_sizes(scene)), 0.0)))
        when = f", {t:.3g} s on" if t else ""
        raise SceneError(
            f"the motion is not steady: {scene.velocity_names[k]!r} would accelerate by {change[k]:.6g} (m/s^2, "
            f"rad/s^2, or modal){when}; {WHAT_IS}"
        )


def _refuse_opening(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, t: float) -> None:
    """Raise SceneError where the motion leaves the loops, but those that are prescribed to move."""
    rows = constraint_rows(scene.plan)
    gaps, rates, _ = constraint_values(scene, work, x, v)
    gaps[(rows.time >= 0) | ~rows.holds_position] = 0.0
    size = row_sizes(scene)
    for gap in (np.abs(gaps) / size, np.abs(rates) / (size * motion_rate(scene, v))):
        if gap.size and gap.max() > STEADY:
            raise SceneError(
                f"the motion is not steady: {t:.3g} s on it leaves the constraint "
                f"{scene.row_names[int(gap.argmax())]!r}; {WHAT_IS}"
            )


#: What a steady motion is, for messages.
WHAT_IS = (
    "a steady motion turns the whole at one rate about one line, with gravity along it and what holds it to the ground "
    "symmetric about it, or moves it straight on, and inside turns symmetric rotors; check the velocities set"
)

