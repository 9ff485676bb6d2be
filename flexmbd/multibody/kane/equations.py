"""Kane's equations of a compiled scene: partial velocities, generalised active and inertia forces.

With the partial velocities v_r of points and w_r of bodies, the derivatives of their velocities by the generalised
speed r, a force F and a torque T give the generalised active force F_r = v_r . F + w_r . T, and inertia gives
F*_r = -sum m a . v_r over all particles, so that F_r + F*_r = 0, plus the loops' -C^T nu (Kane & Levinson 1985).
It is a second way to the equations of motion, by definition and not by recursion: slow, for users' forces
(``fm.force.KaneForce``), and for checking the recursion.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, numbers, shaped_numbers
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import (
    backward_forces,
    forward_kinematics,
    frame_motion,
    load_frame,
)
from flexmbd.multibody.kernels.physics.elasticity import add_elastic_forces
from flexmbd.multibody.kernels.reading.evaluated_motion import required_wrenches
from flexmbd.multibody.kernels.reading.tree import flexible_row, modal_places, shaft_inertias
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.motion.machine import Contribution, Machine
from flexmbd.multibody.scene_index import Slots
from flexmbd.record.point_masses import point_masses
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

class Kinematics(Instant):
    """A machine's motion, which ``move`` brings to other instants, with its partial velocities."""

    multipliers: None = None

    def __init__(self, scene: Machine) -> None:
        super().__init__(scene, 0.0, scene.start, np.zeros(scene.nv), np.zeros(scene.nv))

    def move(self, t: float, x: FloatArray, v: FloatArray, a: FloatArray | None = None) -> Kinematics:
        """Bring it to another instant; without ``a`` accelerations are those of constant speeds."""
        self.t, self.x, self.v = t, np.ascontiguousarray(x), np.ascontiguousarray(v)
        self.a = np.zeros(self.scene.nv) if a is None else np.ascontiguousarray(a)
        self._frames.move(self.x, self.v, self.a)
        return self

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies but the ground."""
        return tuple(branch.outer.body for branch in self.scene.topology.branches)

    def modal_slots(self, body: Body) -> Slots:
        """Where the body's modal coordinates lie in x and in v."""
        return self.scene.index.modal(body)

    def partial_velocities(self, frames: Sequence[Frame]) -> tuple[FloatArray, FloatArray]:
        """v_r (k, 3, nv) of the origins of k frames and w_r (k, 3, nv) of their axes."""
        rows = [self._frames.row(frame) for frame in frames]
        plan, _ = self._frames.evaluated()
        nv = self.scene.nv
        work, rest = new_work(plan), np.zeros(nv)
        linear, angular = np.zeros((2, len(rows), 3, nv))
        for r, unit in enumerate(np.eye(nv)):
            forward_kinematics(plan, work, self.x, unit, rest)
            for k, row in enumerate(rows):
                _, R, velocity, spin, _, _ = frame_motion(plan, work, row)
                linear[k, :, r] = np.reshape(R, (3, 3)) @ velocity
                angular[k, :, r] = np.reshape(R, (3, 3)) @ spin
        return linear, angular

    def generalised_forces(self, contributions: Iterable[Contribution]) -> FloatArray:
        """F_r (nv,) of forces and torques on frames, in one sweep inwards instead of column by column.

        Raises:
            SceneError: a frame of another scene, or a force or torque that is not three finite numbers.
        """
        loads = [_checked(*contribution) for contribution in contributions]
        rows = [self._frames.row(frame) for frame, _, _ in loads]
        plan, work = self._frames.evaluated()
        out = np.zeros(self.scene.nv)
        required_wrenches(work)[:] = 0.0
        for row, (_, force, torque) in zip(rows, loads, strict=True):
            R = np.reshape(frame_motion(plan, work, row)[1], (3, 3))
            load_frame(plan, work, row, _triple(R.T @ force), _triple(R.T @ torque), out)
        backward_forces(plan, work, out)
        return out


@checked()
def active_forces(kinematics: Kinematics, contributions: Sequence[Contribution]) -> FloatArray:
    """F_r = sum of v_r . F + w_r . T (nv,), by definition."""
    loads = [_checked(*contribution) for contribution in contributions]
    linear, angular = kinematics.partial_velocities([frame for frame, _, _ in loads])
    force = np.array([load[1] for load in loads]).reshape(-1, 3)
    torque = np.array([load[2] for load in loads]).reshape(-1, 3)
    return np.einsum("kcr,kc->r", linear, force) + np.einsum("kcr,kc->r", angular, torque)


@checked()
def inertia_forces(kinematics: Kinematics, gravity: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """F*_r (nv,) of all bodies, and the active forces of their weight with ``gravity`` (3,) m/s^2.

    Rigid bodies: -m a* . v*_r - (I alpha + w x I w) . w_r at the centre of mass (eq. 3.2-3.4); flexible ones:
    -m a . v_r over the point masses that have all their inertia integrals, and the moments of rotors inside them.  With
    those of one-dimensional inertias on joint coordinates.
    """
    g = shaped_numbers(gravity, (3,), "gravity")
    total = np.zeros(len(kinematics.v))
    for body in kinematics.bodies:
        now = kinematics.scene.index.now(body)
        record = now.reduced()
        if record is not None:
            total += _flexible_inertia(kinematics, body, record, g)
        elif now.mass > 0.0:
            total += _rigid_inertia(kinematics, body, now, g)
    for v, inertia in shaft_inertias(kinematics.scene.plan):
        total[v] -= inertia * kinematics.a[v]
    return total


@checked()
def elastic_forces(kinematics: Kinematics, scene: Machine) -> FloatArray:
    """F_r (nv,) of the strain energy, the modal damping and the modal gyroscopic forces of all flexible bodies."""
    out = np.zeros(len(kinematics.v))
    for place in modal_places(scene.plan):
        q, qd = kinematics.x[place.x], kinematics.v[place.v]
        add_elastic_forces(scene.plan, flexible_row(scene.plan, place.row), q, qd, np.zeros(len(q)), out[place.v])
    return -out


def _rigid_inertia(kinematics: Kinematics, body: Body, now: Body, g: FloatArray) -> FloatArray:
    """``now``: the body with the numbers that it has in the scene."""
    first, second = now.moments()
    com: FloatArray = np.asarray(first / now.mass, dtype=np.float64)
    central = second - np.outer(first, com)
    frame = Frame(body, com, np.eye(3), None, f"{body.name}'s centre of mass")
    linear, angular = kinematics.partial_velocities([frame])
    R = kinematics.rotation(frame)
    inertia = R @ (np.trace(central) * np.eye(3) - central) @ R.T
    w, alpha = kinematics.angular_velocity(frame), kinematics.angular_acceleration(frame)
    force = -now.mass * (kinematics.acceleration(frame) - g)
    torque = -(inertia @ alpha + np.cross(w, inertia @ w))
    return linear[0].T @ force + angular[0].T @ torque


def _flexible_inertia(kinematics: Kinematics, body: Body, record: ReducedBody, g: FloatArray) -> FloatArray:
    points = point_masses(record)
    frame = Frame(body, np.zeros(3), np.eye(3), None, body.name)
    linear, angular = kinematics.partial_velocities([frame])
    R = kinematics.rotation(frame)
    slots = kinematics.modal_slots(body)
    arm = (points.x + points.phi @ kinematics.q(body)) @ R.T
    drift = (points.phi @ kinematics.q_rate(body)) @ R.T
    w, alpha = kinematics.angular_velocity(frame), kinematics.angular_acceleration(frame)
    acceleration = (
        kinematics.acceleration(frame)
        + np.cross(alpha, arm)
        + np.cross(w, np.cross(w, arm))
        + 2.0 * np.cross(w, drift)
        + (points.phi @ kinematics.a[slots.v]) @ R.T
    )
    force = -points.mass[:, None] * (acceleration - g)
    total = linear[0].T @ force.sum(axis=0) + angular[0].T @ np.cross(arm, force).sum(axis=0)
    total[slots.v] += np.einsum("kin,ki->n", points.phi, force @ R)
    if record.gyroscopic is not None:
        rotors, turning = record.gyroscopic, R.T @ w
        momentum = rotors.momentum + rotors.slope @ kinematics.q(body)
        moment = np.cross(turning, momentum) + rotors.slope @ kinematics.q_rate(body)
        total -= angular[0].T @ (R @ moment)
        total[slots.v] += rotors.slope.T @ turning
    return total


def _checked(frame: Frame, force: ArrayLike, torque: ArrayLike) -> tuple[Frame, FloatArray, FloatArray]:
    parts = []
    for name, part in (("force", force), ("torque", torque)):
        vector = numbers(part)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise SceneError(f"the {name} on {frame.label} must be three finite numbers, got {part!r}")
        parts.append(vector)
    return frame, parts[0], parts[1]


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
