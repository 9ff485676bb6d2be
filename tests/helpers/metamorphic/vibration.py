"""How fast a machine of rigid bodies vibrates on its springs, and what errors of its motion are measured by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from machine_loads import Bush, CoordinateSpring, Spring
from scipy.linalg import block_diag


def in_motion(by, machine):
    """Sizes of errors of a motion, from those of a state: one of position that vibrates is one of speed too."""
    rate = fastest_vibration(machine)
    return replace(
        by,
        speed=max(by.speed, by.length * rate),
        turning=max(by.turning, rate),
        acceleration=max(by.acceleration, by.length * rate**2),
    )


def fastest_vibration(machine):
    """rad/s, no slower than the machine vibrates on its springs.

    By Rayleigh's quotient: the ends of a spring give way most where nothing else holds its two bodies, and several
    springs together are no stiffer than the sum of them.
    """
    square = 0.0
    for load in machine.loads:
        if isinstance(load, (Bush, CoordinateSpring, Spring)):
            stiffness, ends = _held(machine, load)
            mobility = sum(_mobility(machine, part, p) for part, p in ends)
            square += np.abs(np.linalg.eigvals(mobility @ stiffness)).max()
    return float(np.sqrt(square))


def _held(machine, load):
    """Stiffness (6, 6) against displacements and turns in inertial axes, and the parts and points that it acts on."""
    if isinstance(load, Bush):
        first, second = (machine.pose(mark) for mark in load.marks)
        axes = block_diag(first.R, first.R)
        return axes @ load.stiffness @ axes.T, [(mark.part, second.p) for mark in load.marks]
    if isinstance(load, Spring):
        points = [machine.pose(mark).p for mark in load.marks]
        across = abs(1.0 - load.length / np.linalg.norm(points[1] - points[0]))  # by its tension
        ends = [(mark.part, p) for mark, p in zip(load.marks, points, strict=True)]
        return load.stiffness * max(1.0, across) * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), ends
    link = machine.link(load.link)
    turns = float(machine.turns(load))
    at = machine.pose(link.child).p
    return load.stiffness * np.diag([1.0 - turns] * 3 + [turns] * 3), [
        (mark.part, at) for mark in (link.parent, link.child)
    ]


def _mobility(machine, name, p):
    """(6, 6) accelerations of a rigid part at a point p, and angular ones, per unit of force and torque there."""
    if name == "ground":
        return np.zeros((6, 6))
    part = machine.part(name)
    arm = p - part.pose.after(part.body.com, np.eye(3)).p
    turned = np.linalg.inv(part.pose.R @ part.body.inertia @ part.pose.R.T)
    cross = np.cross(arm, np.eye(3)).T  # times f: arm x f
    force = np.vstack([np.eye(3) / part.body.mass + cross.T @ turned @ cross, turned @ cross])
    return np.hstack([force, np.vstack([cross.T @ turned, turned])])
