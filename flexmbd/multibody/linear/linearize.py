"""The linear equations of a machine about an equilibrium or a steady motion (Anthonis & Ramon 2003, eq. 8).

With y and z of ``elimination``:  M dz/dt + C z + K y = F u,  dy/dt = Ty y + Tz z + Tu u.  Where no row holds
velocities alone, z is made dy/dt, so that M y'' + C y' + K y = F u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.steady import InteriorModes
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.reading.constraint_tables import driven_coordinates
from flexmbd.multibody.kernels.reading.force_tables import keep_forces, rough_contacts, slid_ways
from flexmbd.multibody.kernels.sampling import contacts as at
from flexmbd.multibody.linear.derivatives import Derivatives
from flexmbd.multibody.linear.elimination import Coordinates, Elimination, Prescribed, eliminate
from flexmbd.multibody.linear.interior_balance import InteriorEquations, linearize_interiors
from flexmbd.multibody.linear.output_equations import OutputDerivatives, output_derivatives
from flexmbd.multibody.linear.ports import InputEffects
from flexmbd.multibody.linear.round_off import RoundOff, energies_at_play, round_off, without_round_off
from flexmbd.multibody.linear.steadiness import AHEAD, SAME, STEADY, left_and_parts, motion_rate, steady_motion
from flexmbd.multibody.linear.steady_motion import Slopes, SteadyMotion
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.motion.quantity import LinearOutput
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.overflow import refuse_not_finite, refuse_overflow
from flexmbd.round_off import of_solver

FloatArray = NDArray[np.float64]

_AT_REST = 1e-5  # rad, or of the extent, within the slowest vibration


@dataclass(frozen=True, eq=False)
class LinearEquations:
    """See the module.

    Attributes:
        M, C, K: (nz, nz), (nz, nz), (nz, ny).
        F: (nz, nu).
        by: how changes of configuration and velocities follow from y, z, u.
        outputs: of the equations.
        coordinates: those of the machine, then those of interiors.
        motion: the steady one, from whose turning axes y and z are seen.
        rate: 1/s, of that motion; 0 at rest.
    """

    M: FloatArray
    C: FloatArray
    K: FloatArray
    F: FloatArray
    by: Elimination
    outputs: tuple[OutputDerivatives, ...]
    coordinates: Coordinates
    motion: SteadyMotion
    rate: float


@refuse_overflow("the linear machine")
def linearize(
    point: WorkingPoint, work: Work, ports: InputEffects, outputs: Sequence[LinearOutput], modes: InteriorModes
) -> LinearEquations:
    """Linearise about a working point, in which interiors stand; ``work.time`` of ``point.scene`` is up to date.

    Raises:
        SceneError: the motion is not steady, the constraints are singular, or an output does not fit.
    """
    point = _without_untouched(point, work)
    scene = point.scene
    wider = linearize_interiors(scene, work, point.x, point.v, modes=modes)
    motion, changes, own = steady_motion(scene, work, point.x, point.v, point.multipliers)
    point = replace(point, steady_accelerations=motion.accelerations(work, point.x))
    turning = motion.slopes(work, point.x)
    of, ports = wider.derivatives(_seen_turning(own, turning)), ports.extended(wider.added)
    by = eliminate(scene, wider.coordinates, of, np.pad(turning.velocity, (0, wider.added)), ports.given)
    energies = np.append(energies_at_play(point, work), wider.coordinates.size[scene.nv :] * np.abs(wider.lacking()))
    rate = motion_rate(scene, point.v)
    _refuse_driven_unsteadily(point, work, rate)
    _refuse_unbalanced(point, work, of, by, wider, energies)
    slopes = tuple(output_derivatives(scene, point.x, point.v, output) for output in outputs)
    noise = round_off(of, by, wider.coordinates, energies, rate)
    turns = rate > 0.0 and not _is_at_rest(rate, of, by, noise)
    if turns:
        if changes is not None:
            raise SceneError(
                f"the motion is not steady: {changes}; only motions along which the machine's equations stay the same "
                "can be linearised"
            )
        _refuse_changing_outputs(point, work, motion, rate, slopes, outputs)
    by = replace(by, Ty=without_round_off(by.Ty, noise.Ty))
    M, C, K, F = _reduce(of, by, ports)
    if len(by.y) == len(by.z):
        C, K, F, by = _second_order(M, C, K, F, by, ports.given)
    C, K = without_round_off(C, noise.C), without_round_off(K, noise.K)
    refuse_not_finite("the linear machine", M, C, K, F)
    slopes = tuple(slope.extended(wider.added) for slope in slopes)
    return LinearEquations(M, C, K, F, by, slopes, wider.coordinates, motion, rate if turns else 0.0)


def _without_untouched(point: WorkingPoint, work: Work) -> WorkingPoint:
    """The point of the machine without rough contacts that do not touch there, whose ways go on without effect."""
    plan = point.scene.plan
    kept, out = np.ones(len(plan.elements), bool), np.zeros((1, at.N_CONTACT))
    t = work.time[-1:, 0].copy()
    for i in rough_contacts(plan):
        at.contact_series(plan, work, int(i), t, point.x[None].copy(), point.v[None].copy(), point.a[None].copy(), out)
        kept[i] = out[0, at.GAP] < 0.0
    if kept.all():
        return point
    plan = keep_forces(plan, range(len(plan.forces)), kept)
    return replace(point, scene=replace(point.scene, plan=plan))


def _reduce(
    of: Derivatives, by: Elimination, ports: InputEffects
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Put xi, dv and da = Vz dz/dt + Vy dy/dt + ... into the equations and project them on Vz."""
    given = ports.given
    push = by.Vz.T @ of.mass @ by.Vy
    acceleration = by.Vu - given.motion[1]  # what follows of prescribed motions, at its rate, and these themselves
    acceleration = acceleration @ given.rate + given.motion[2]
    M = by.Vz.T @ of.mass @ by.Vz
    C = by.Vz.T @ of.damping @ by.Vz + push @ by.Tz
    K = by.Vz.T @ (of.damping @ by.Vy + of.stiffness @ by.Xy) + push @ by.Ty
    asked = of.mass @ acceleration + of.damping @ by.Vu + of.stiffness @ by.Xu
    F = by.Vz.T @ (ports.force - asked) - push @ by.Tu
    return M, C, K, F


def _second_order(
    M: FloatArray, C: FloatArray, K: FloatArray, F: FloatArray, by: Elimination, given: Prescribed
) -> tuple[FloatArray, FloatArray, FloatArray, Elimination]:
    """With z = y' - Ty y - Tu u, where y and z are as many; returns C, K, F and the same elimination in y'."""
    n = len(by.y)
    F = F + M @ by.Tu @ given.rate + C @ by.Tu
    K = K - C @ by.Ty
    C = C - M @ by.Ty
    by = replace(
        by,
        Vy=by.Vy - by.Vz @ by.Ty,
        Vu=by.Vu - by.Vz @ by.Tu,
        Ty=np.zeros((n, n)),
        Tz=np.eye(n),
        Tu=np.zeros_like(by.Tu),
    )
    return C, K, F, by


def _refuse_driven_unsteadily(point: WorkingPoint, work: Work, rate: float) -> None:
    """Raise SceneError where a prescribed motion has an acceleration that changes what goes on at a rate (1/s)."""
    scene = point.scene
    driven = driven_coordinates(scene.plan)
    for k, acceleration in zip(driven.v, work.time[driven.time, 2], strict=True):
        if abs(acceleration) > STEADY * rate**2 * scene.group_full[scene.group_of[k]]:
            raise SceneError(
                f"the motion is not steady at t = {point.t:g} s: {scene.velocity_names[k]!r} is prescribed with an "
                f"acceleration of {acceleration:.6g}; linearise at a time when it has none"
            )


def _refuse_unbalanced(
    point: WorkingPoint, work: Work, of: Derivatives, by: Elimination, wider: InteriorEquations, energies: FloatArray
) -> None:
    """Raise SceneError where accelerations are not zero; the message names the largest residual."""
    scene = point.scene
    left, parts = left_and_parts(scene, work, point.x, point.v, point.a, point.multipliers)
    lacks, size, names = wider.lacking(), wider.coordinates.size, wider.coordinates.names
    left, parts = np.append(left, lacks), np.append(parts, np.abs(lacks))
    states = wider.coordinates.states
    stiff = np.abs(of.stiffness) @ size + np.abs(of.damping[:, states]) @ np.maximum(1.0, np.abs(point.v[states]))
    lacking = by.Vz.T @ left
    lacking[np.isin(by.z, slid_ways(scene.plan))] = 0.0  # nothing follows from how far they have come
    # what little the forces on the bodies that it carries leave along a coordinate is balanced
    scale = np.abs(by.Vz).T @ (parts + stiff + energies / size)
    worst = int(np.argmax(np.abs(lacking) - STEADY * scale)) if len(lacking) else 0
    if len(lacking) and np.abs(lacking[worst]) > STEADY * scale[worst]:
        raise SceneError(
            f"the motion is not steady: at {names[by.z[worst]]!r} a force of {-lacking[worst]:.6g} (N, "
            f"N m, or modal) is not balanced, of {scale[worst]:.6g} at play; linearise about scene.equilibrium(), or "
            "set positions and velocities that stay as they are"
        )


def _is_at_rest(rate: float, of: Derivatives, by: Elimination, noise: RoundOff) -> bool:
    """Whether what moves at a rate (1/s) does so little that the machine's own vibrations are over before it shows."""
    stiffness, mass = (by.Vz.T @ part @ by.Vz for part in (of.stiffness, of.mass))
    if not len(mass):
        return False
    squares, shapes = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), mass)
    last = of_solver(len(mass)) * np.abs(squares).max()  # what the eigensolver tells apart
    if stiffness.shape == noise.K.shape:
        last += np.einsum("ik,ij,jk->k", np.abs(shapes), noise.K, np.abs(shapes))
    swinging = np.abs(squares[np.abs(squares) > last])
    return rate <= _AT_REST * float(np.sqrt(np.min(swinging, initial=np.inf))) < np.inf


def _seen_turning(of: Derivatives, turning: Slopes) -> Derivatives:
    """Derivatives of a machine's equations by velocities w and places xi seen from the turning axes.

    There velocities change by dw/dt + B w, and d xi/dt = dw - A xi.
    """
    places = turning.acceleration - turning.turning @ turning.velocity
    return replace(of, damping=of.damping + of.mass @ turning.turning, stiffness=of.stiffness + of.mass @ places)


def _refuse_changing_outputs(
    point: WorkingPoint,
    work: Work,
    motion: SteadyMotion,
    rate: float,
    slopes: Sequence[OutputDerivatives],
    outputs: Sequence[LinearOutput],
) -> None:
    """Raise SceneError where what is observed of the same motions beside the steady one changes along it."""
    size = coordinate_sizes(point.scene)
    for distance in AHEAD:
        t = distance / rate
        T = motion.transport(work, point.x, t)
        x = motion.later(work, point.x, point.v, t)
        for slope, output in zip(slopes, outputs, strict=True):
            there = output_derivatives(point.scene, x, T @ point.v, output)
            scale = _largest(slope.L * size)
            moved = _largest((there.L @ T - slope.L) * size), _largest((there.G @ T - slope.G) * size) / rate
            if max(moved) > SAME * scale:
                raise SceneError(
                    f"the output {slope.names[0]!r} changes along the steady motion, so that no constant matrix gives "
                    "it; observe a joint's coordinates, or a frame that does not turn"
                )


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))
