"""Whether a motion is steady: what drives it, seen from its turning axes, stays the same as it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows, driven_coordinates
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.linear.balance import nothing_prescribed, reactions
from flexmbd.multibody.linear.derivatives import Derivatives, derive
from flexmbd.multibody.linear.elimination import Elimination, eliminate, own_coordinates
from flexmbd.multibody.linear.round_off import energies_at_play
from flexmbd.multibody.linear.steady_motion import SteadyMotion, carried, twists
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import constraint_values, coordinate_sizes, row_sizes
from flexmbd.multibody.start.consistent_start import accelerations

FloatArray = NDArray[np.float64]

STEADY = 1e-6  #: of the forces at play: what may be left of a force in balance
_ROUND_OFF = 1e-12  # of the stiffness and of inertia's, times 1 rad or the machine's extent: what forces are known to
SAME = 1e-7  #: of what a coordinate's own inertia and stiffness are: what may change along a steady motion
AHEAD = (0.3, 1.1)  #: how far along the motion (rad, or of the extent) that is looked at


@dataclass(frozen=True, eq=False)
class _SeenTurning:
    """A machine's equations a while later, seen from the turning axes; as ``Derivatives``, of steady motions beside."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    jacobian: FloatArray
    rate_slope: FloatArray


def motion_rate(scene: CompiledScene, v: FloatArray) -> float:
    """1/s, the largest velocity of v (nv,) over its coordinate's size."""
    moving = np.where(scene.state_mask, 0.0, np.abs(v))
    return float(np.max(moving / coordinate_sizes(scene), initial=0.0))


def steady_motion(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> SteadyMotion:
    """The steady motion through x (nx,), v (nv,), whose turning axes see the same machine at any time.

    Where none do it is that of the body that most likely tells the turn of the whole.
    """
    rate = motion_rate(scene, v)
    if rate == 0.0:
        return SteadyMotion(scene)
    wholes = twists(scene, work, x, v)
    motions = [carried(scene, work, x, v, whole) for whole in wholes]
    if len(motions) == 1:
        return motions[0]
    for motion in motions:
        if change_along(scene, work, x, v, motion) is None:
            return motion
    return motions[0]


def change_along(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, motion: SteadyMotion
) -> str | None:
    """What changes of the linear equations, seen from the turning axes, in words; None where they stay the same.

    They are compared as they are once the loops are eliminated, for rows fixed in the ground turn against these axes.
    All is compared as forces at a coordinate within the motion's own time, 1 / rate: stiffness with damping times the
    rate and mass times its square.
    """
    rate, size = motion_rate(scene, v), coordinate_sizes(scene)
    now = _seen(scene, work, x, v, motion, 0.0)
    of = derive(scene.plan, work, x, v, np.zeros(len(scene.plan.rows)), size=size)
    A = motion.slopes(work, x).velocity
    by = eliminate(scene, own_coordinates(scene), of, A, nothing_prescribed(scene))
    own = _own_forces(now, by, rate)
    for distance in AHEAD:
        later = _seen(scene, work, x, v, motion, distance / rate)
        found = _changed_rows(scene, now, later, by, A, rate) or _changed_matrices(scene, now, later, by, A, own, rate)
        if found is not None:
            return found
    return None


def _seen(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, motion: SteadyMotion, t: float
) -> _SeenTurning:
    """The equations a time t (s) after x (nx,), v (nv,)."""
    T = motion.transport(work, x, t)
    x, v = motion.later(work, x, v, t), T @ v
    a, force = motion.accelerations(work, x), np.zeros(scene.nv)
    residual(scene.plan, work, x, v, a, np.zeros(len(scene.plan.rows)), force)
    scene.refuse_failed(work)
    nu = reactions(scene, work, x, v, force)
    of = derive(scene.plan, work, x, v, nu, size=coordinate_sizes(scene), a=a)
    by = motion.slopes(work, x)
    A, B = by.velocity, by.turning
    damping = of.damping + of.mass @ (A + B)
    stiffness = of.stiffness + of.damping @ A + of.mass @ by.acceleration
    return _SeenTurning(
        T.T @ of.mass @ T, T.T @ damping @ T, T.T @ stiffness @ T, of.jacobian @ T,
        (of.rate_slope + of.jacobian @ A) @ T,
    )  # fmt: skip


def _parts(seen: _SeenTurning, by: Elimination, A: FloatArray, rate: float) -> Iterator[tuple[str, FloatArray]]:
    """What the equations consist of, by its name: forces along independent velocities within the motion's time."""
    rates = by.Vy - A @ by.Xy
    yield "stiffness", by.Vz.T @ (seen.stiffness @ by.Xy + seen.damping @ rates)
    yield "damping", rate * by.Vz.T @ seen.damping @ by.Vz
    yield "mass", rate**2 * by.Vz.T @ seen.mass @ by.Vz


def _own_forces(seen: _SeenTurning, by: Elimination, rate: float) -> tuple[FloatArray, FloatArray]:
    """(nz,), (ny,) the roots of what each independent velocity and coordinate has of its own."""
    found = []
    for along in (by.Vz, by.Xy):
        parts = ((seen.stiffness, 1.0), (seen.damping, rate), (seen.mass, rate**2))
        own = sum(np.abs(np.einsum("ik,ij,jk->k", along, part, along)) * factor for part, factor in parts)
        found.append(np.sqrt(own))
    return found[0], found[1]


def _changed_matrices(
    scene: CompiledScene,
    now: _SeenTurning,
    later: _SeenTurning,
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
                "motion itself; only motions along which the machine's equations stay the same can be linearised"
            )
    return None


def _changed_rows(
    scene: CompiledScene, now: _SeenTurning, later: _SeenTurning, by: Elimination, A: FloatArray, rate: float
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
            return (
                f"along it the constraint {scene.row_names[k]!r} changes; only motions along which the machine's "
                "equations stay the same can be linearised"
            )
    return None


def refuse_unsteady(point: WorkingPoint, work: Work, motion: SteadyMotion, of: Derivatives) -> None:
    """Raise SceneError where the machine, moving steadily from ``point``, would be accelerated otherwise, or its loops open.

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
    at_play = STEADY * (energies_at_play(point, work) + inertial) / size
    at_play += _ROUND_OFF * (np.abs(of.stiffness) + rate**2 * np.abs(of.mass)) @ size
    driven = driven_coordinates(scene.plan)
    for t in (0.0, *(distance / rate for distance in AHEAD)):
        x, v = motion.later(work, point.x, point.v, t), motion.transport(work, point.x, t) @ point.v
        work.time[driven.time, 0] = x[driven.x]
        _refuse_opening(scene, work, x, v, t)
        a = motion.accelerations(work, x)
        try:
            found, multipliers = accelerations(scene, work, x, v)
        except FlexmbdError as reason:
            raise SceneError(f"the motion is not steady: {t:.3g} s on, {reason}") from reason
        left, weight, held = np.zeros((3, scene.nv))
        light, nothing = scene.plan.replace(gravity=np.zeros(3)), np.zeros_like(multipliers)
        residual(scene.plan, work, x, v, a, multipliers, left)
        residual(light, work, x, v, a, multipliers, weight)
        residual(light, work, x, v, a, nothing, held)
        work.time[:] = kept
        parts = np.abs(left - weight) + np.abs(weight - held) + np.abs(held)
        free = np.zeros(scene.nv, bool)
        free[scene.plan.free] = True
        wrong = free & ~scene.state_mask & (np.abs(left) > STEADY * parts + at_play)
        if wrong.any():
            change = found - a
            k = int(np.argmax(np.where(wrong, np.abs(change / size), 0.0)))
            _refuse(scene, k, float(change[k]), t)


def _refuse_opening(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, t: float) -> None:
    """Raise SceneError where the motion leaves the loops, but those that are prescribed to move."""
    rows = constraint_rows(scene.plan)
    gaps, rates, _ = constraint_values(scene, work, x, v)
    gaps[(rows.time >= 0) | ~rows.holds_position] = 0.0
    gaps, rates = np.abs(gaps) / row_sizes(scene), np.abs(rates) / row_sizes(scene) / motion_rate(scene, v)
    for gap in (gaps, rates):
        if gap.size and gap.max() > STEADY:
            raise SceneError(
                f"the motion is not steady: {t:.3g} s on it leaves the constraint "
                f"{scene.row_names[int(gap.argmax())]!r}; {_WHAT_IS}"
            )


_WHAT_IS = (
    "a steady motion turns the whole at one rate about one line, with gravity along it and what holds it to the ground "
    "symmetric about it, or moves it straight on, and inside turns symmetric rotors; check the velocities set"
)


def _refuse(scene: CompiledScene, k: int, change: float, t: float) -> None:
    when = f", {t:.3g} s on" if t else ""
    raise SceneError(
        f"the motion is not steady: {scene.velocity_names[k]!r} would accelerate by {change:.6g} (m/s^2, rad/s^2, or "
        f"modal){when}; {_WHAT_IS}"
    )
