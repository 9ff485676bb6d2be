"""The work of all that stores nothing, from the motion of frames: a second account of what a machine's energy does."""

from __future__ import annotations

import functions_of_time as of_time
import joint_motion as jm
import numpy as np
from machine_loads import Bush, CoordinateFriction, CoordinateSpring, Motor, PinFriction, Push, Spring
from random_machine import Pose
from scipy.spatial.transform import Rotation

#: The open Newton-Cotes rule of the seven inner points of eight equal intervals: it asks for nothing at a break.
INTERVALS = 8
_OPEN = np.array([0.0, 460.0, -954.0, 2196.0, -2459.0, 2196.0, -954.0, 460.0, 0.0]) * 8.0 / 945.0


def work(machine, built, run):
    """(n,) J after each eight of a run's equal steps, between which the breaks lie."""
    power = sum((_power(machine, built, run, load) for load in machine.loads), np.zeros(len(run.t)))
    for link in machine.links:
        if link.motion is not None:
            power = power + run.drive(built.joints[link.name]) * of_time_rates(link.motion, run.t)
    for part in machine.parts:
        record = built.bodies[part.name].reduced()
        if record is not None:
            rate = run.q_rate(built.bodies[part.name])
            power = power - np.einsum("ti,ij,tj->t", rate, record.damping, rate)
    h = (run.t[-1] - run.t[0]) / (len(run.t) - 1)
    pieces = [h * _OPEN @ power[k : k + INTERVALS + 1] for k in range(0, len(power) - 1, INTERVALS)]
    return np.cumsum(pieces)


def of_time_rates(function, t):
    return np.array([of_time.value(function, s, 1) for s in t])


def _power(machine, built, run, load):
    return _POWERS[type(load)](machine, built, run, load)


def _poses(built, run, mark):
    frame = built.frame(mark)
    asked = [ask(frame) for ask in (run.position, run.rotation, run.velocity, run.angular_velocity)]
    return [Pose(*parts) for parts in zip(*asked, strict=True)]


def _push(machine, built, run, load):
    values = np.array([[of_time.value(c, t) for c in load.components] for t in run.t])
    found = []
    for pose, wrench in zip(_poses(built, run, load.mark), values, strict=True):
        R = pose.R if load.in_frame else np.eye(3)
        found.append(R @ wrench[:3] @ pose.v + R @ wrench[3:] @ pose.w)
    return np.array(found)


def _spring(machine, built, run, load):
    found = []
    for one, other in zip(*(_poses(built, run, mark) for mark in load.marks), strict=True):
        line = other.p - one.p
        found.append(-load.damping * (line @ (other.v - one.v)) ** 2 / (line @ line))
    return np.array(found)


def _bush(machine, built, run, load):
    found = []
    for one, other in zip(*(_poses(built, run, mark) for mark in load.marks), strict=True):
        R, _, twist = one.seen(other)
        theta = Rotation.from_matrix(R).as_rotvec()
        rate = np.concatenate([twist[3:], _rate_of_rotation_vector(theta, twist[:3])])
        found.append(-rate @ load.damping @ rate)
    return np.array(found)


def _rate_of_rotation_vector(theta, w):
    """d theta / dt of a frame that turns with w, both in the axes that it turns in (Bullo & Murray 1995)."""
    angle = np.linalg.norm(theta)
    across = np.cross(theta, w)
    share = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
    return w - 0.5 * across + share * np.cross(theta, across)


def _rate(machine, built, run, load):
    """The rate of a joint's coordinate."""
    link = machine.link(load.links[0])
    found = []
    for one, other in zip(*(_poses(built, run, mark) for mark in (link.parent, link.child)), strict=True):
        found.append(jm.rates_of(link.joint, *one.seen(other))[load.coordinate])
    return np.array(found)


def _coordinate_spring(machine, built, run, load):
    return -load.damping * _rate(machine, built, run, load) ** 2


def _friction(machine, built, run, load):
    rate = _rate(machine, built, run, load)
    size = load.size
    if load.static is not None:
        size = size + (load.static - load.size) * np.exp(-((rate / load.stribeck) ** 2))
    return -(size * np.tanh(rate / load.speed) + load.viscous * rate) * rate


def _pin_friction(machine, built, run, load):
    """With the force across the joint's axis that the run's own reaction passes on."""
    link = machine.link(load.links[0])
    axis = np.asarray(link.joint.turn)[:, 2]
    force = run.reaction(built.joints[link.name])[:, :3]
    across = np.linalg.norm(force - np.outer(force @ axis, axis), axis=1)
    rate = _rate(machine, built, run, load)
    arm = 1.0 if load.radius is None else load.radius
    return -load.coefficient * arm * across * np.tanh(rate / load.speed) * rate


def _motor(machine, built, run, load):
    if machine.link(load.links[0]).motion is not None:
        return np.zeros(len(run.t))  # the drive counts it
    return np.array([of_time.value(load.value, t) for t in run.t]) * _rate(machine, built, run, load)


_POWERS = {
    Push: _push, Spring: _spring, Bush: _bush, CoordinateSpring: _coordinate_spring, CoordinateFriction: _friction,
    Motor: _motor, PinFriction: _pin_friction,
}  # fmt: skip
