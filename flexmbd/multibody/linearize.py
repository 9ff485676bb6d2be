"""The linear equations of a machine about an equilibrium or a steady motion (Anthonis & Ramon 2003, eq. 8).

With y and z of ``elimination``:  M dz/dt + C z + K y = F u,  dy/dt = Ty y + Tz z + Tu u.  Where no row holds
velocities alone, z is made dy/dt, so that M y'' + C y' + K y = F u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.derivatives import Derivatives, derive, turning
from flexmbd.multibody.elimination import Coordinates, Elimination, Prescribed, eliminate
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.kernels.residual import residual
from flexmbd.multibody.output import Output, Slopes, observe
from flexmbd.multibody.ports import Ports
from flexmbd.multibody.settled import Widening, widen
from flexmbd.multibody.steady_interior import InteriorModes
from flexmbd.multibody.working_point import WorkingPoint

FloatArray = NDArray[np.float64]

_STEADY = 1e-6  # of the forces at play, or of 1 rad and the machine's extent times the stiffness
_NOISE = 1e-6  # of the largest forces at play, times this much
_SAME = 1e-7  # of a matrix' entries of the same units: what may change along a steady motion
_AT_REST = 1e-5  # rad, or of the extent, within the slowest vibration
_AHEAD = (0.3, 1.1)  # how far along the motion (rad, or of the extent) that is looked at


@dataclass(frozen=True, eq=False)
class LinearEquations:
    """See the module.

    Attributes:
        M, C, K: (nz, nz), (nz, nz), (nz, ny).
        F: (nz, nu).
        by: how changes of configuration and velocities follow from y, z, u.
        outputs: of the equations.
        coordinates: those of the machine, then those of interiors.
    """

    M: FloatArray
    C: FloatArray
    K: FloatArray
    F: FloatArray
    by: Elimination
    outputs: tuple[Slopes, ...]
    coordinates: Coordinates


def linearize(
    point: WorkingPoint, work: Work, ports: Ports, outputs: Sequence[Output], modes: InteriorModes
) -> LinearEquations:
    """Linearise about a working point, in which interiors stand; ``work.time`` of ``point.scene`` is up to date.

    Raises:
        SceneError: the motion is not steady, the constraints are singular, or an output does not fit.
    """
    scene = point.scene
    wider = widen(scene, work, point.x, point.v, modes=modes)
    own = derive(scene.plan, work, point.x, point.v, point.multipliers)
    of, ports = wider.derivatives(own), ports.widened(wider.added)
    turn = np.pad(turning(scene.plan, point.v), (0, wider.added))
    by = eliminate(scene, wider.coordinates, of, turn, ports.given)
    _refuse_unsteady(point, work, of, by, wider)
    slopes = tuple(observe(scene, point.x, point.v, output) for output in outputs)
    if not _is_at_rest(point, of, by, wider.coordinates):
        _refuse_changing(point, work, own, slopes, outputs)
    M, C, K, F = _reduce(of, by, ports)
    if len(by.y) == len(by.z):
        C, K, F, by = _second_order(M, C, K, F, by, ports.given)
    slopes = tuple(slope.widened(wider.added) for slope in slopes)
    return LinearEquations(M, C, K, F, by, slopes, wider.coordinates)


def _reduce(of: Derivatives, by: Elimination, ports: Ports) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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


def _refuse_unsteady(point: WorkingPoint, work: Work, of: Derivatives, by: Elimination, wider: Widening) -> None:
    """Raise SceneError where accelerations are not zero; the message tells the largest residual."""
    scene, none = point.scene, np.zeros(point.scene.nv)
    driven = scene.plan.driven
    for row in driven:
        if work.time[row[at.DRIVEN_TIME], 2] != 0.0:
            name = scene.velocity_names[row[at.DRIVEN_V]]
            raise SceneError(
                f"the motion is not steady at t = {point.t:g} s: {name!r} is prescribed with an acceleration of "
                f"{work.time[row[at.DRIVEN_TIME], 2]:.6g}; linearise at a time when it has none"
            )
    left, weight, held = np.zeros((3, scene.nv))
    residual(scene.plan, work, point.x, point.v, none, point.multipliers, left)
    light = scene.plan._replace(gravity=np.zeros(3))
    residual(light, work, point.x, point.v, none, point.multipliers, weight)
    residual(light, work, point.x, point.v, none, 0.0 * point.multipliers, held)
    parts = np.abs(left - weight) + np.abs(weight - held) + np.abs(held)
    lacks, size, names = wider.lacking(), wider.coordinates.size, wider.coordinates.names
    left, parts = np.append(left, lacks), np.append(parts, np.abs(lacks))
    stiff = np.abs(of.stiffness) @ size
    lacking = by.Vz.T @ left
    # what round-off of the largest forces leaves where next to nothing acts is balanced
    noise = _NOISE * float(np.max(parts * size, initial=0.0)) / size
    scale = np.abs(by.Vz).T @ (parts + stiff + noise)
    worst = int(np.argmax(np.abs(lacking) - _STEADY * scale)) if len(lacking) else 0
    if len(lacking) and np.abs(lacking[worst]) > _STEADY * scale[worst]:
        raise SceneError(
            f"the motion is not steady: at {names[by.z[worst]]!r} a force of {-lacking[worst]:.6g} (N, "
            f"N m, or modal) is not balanced, of {scale[worst]:.6g} at play; linearise about scene.equilibrium(), or "
            "set positions and velocities that stay as they are"
        )


def _is_at_rest(point: WorkingPoint, of: Derivatives, by: Elimination, coordinates: Coordinates) -> bool:
    """Whether nothing moves, or so little that the machine's own vibrations are over before it is seen."""
    speed = float(np.max(np.abs(point.v) / coordinates.size[: len(point.v)], initial=0.0))
    stiffness, mass = (by.Vz.T @ part @ by.Vz for part in (of.stiffness, of.mass))
    if speed == 0.0 or not len(mass):
        return speed == 0.0
    rates = np.sqrt(np.abs(scipy.linalg.eigvalsh(0.5 * (stiffness + stiffness.T), mass)))
    return speed <= _AT_REST * float(np.min(rates[rates > _SAME * rates.max(initial=0.0)], initial=np.inf)) < np.inf


def _refuse_changing(
    point: WorkingPoint, work: Work, of: Derivatives, slopes: Sequence[Slopes], outputs: Sequence[Output]
) -> None:
    """Raise SceneError where the equations change along the motion, for then they are not those of a steady one."""
    scene = point.scene
    size = scene.group_full[scene.group_of]
    speed = float(np.max(np.abs(point.v) / size))
    for distance in _AHEAD:
        x = np.empty_like(point.x)
        retract(scene.plan, point.x, point.v * (distance / speed), x)
        later = derive(scene.plan, work, x, point.v, point.multipliers)
        for name in ("stiffness", "damping", "mass"):
            _refuse_changed(point, name, getattr(of, name), getattr(later, name), size)
        for old, new in ((of.jacobian, later.jacobian), (of.rate_slope, later.rate_slope)):
            for k in np.flatnonzero(np.abs((new - old) * size).max(axis=1, initial=0.0) > _SAME * _largest(old * size)):
                raise SceneError(
                    f"the motion is not steady: along it the constraint {scene.row_names[k]!r} changes; only motions "
                    "along which the machine looks the same can be linearised"
                )
        for slope, output in zip(slopes, outputs, strict=True):
            there = observe(scene, x, point.v, output)
            if np.abs((there.L - slope.L) * size).max() > _SAME * _largest(slope.L * size):
                raise SceneError(
                    f"the output {slope.names[0]!r} changes along the steady motion, so that no constant matrix gives "
                    "it; observe a joint's coordinates, or a frame that does not turn"
                )


def _refuse_changed(point: WorkingPoint, name: str, old: FloatArray, new: FloatArray, size: FloatArray) -> None:
    free = point.scene.plan.free
    scale = np.outer(size, size)
    change = (np.abs(new - old) * scale)[np.ix_(free, free)]
    if change.size and change.max() > _SAME * _largest(old * scale):
        k = free[np.unravel_index(int(change.argmax()), change.shape)[1]]
        raise SceneError(
            f"the motion is not steady: along it the {name} of {point.scene.velocity_names[k]!r} changes by "
            f"{change.max() / _largest(old * scale):.3g} of the largest; only motions along which the machine looks "
            "the same can be linearised"
        )


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))
