"""Free balls and boxes on a floor, for the problems of contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import flexmbd as fm
from flexmbd import contact

G = 9.81


def ball(
    scene: fm.System,
    radius: float,
    place: Sequence[float],
    *,
    mass: float = 1.0,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
) -> fm.RigidBody:
    """A solid ball (m, kg, m/s) that does not spin."""
    body = scene.add(fm.RigidBody(mass, (0.4 * mass * radius**2,) * 3))
    _free(scene, body, place, velocity)
    return body


def block(scene: fm.System, side: float, place: Sequence[float], *, mass: float) -> fm.RigidBody:
    """A cube at rest (m, kg)."""
    body = scene.add(fm.RigidBody(mass, (mass * side**2 / 6.0,) * 3))
    _free(scene, body, place, (0.0, 0.0, 0.0))
    return body


def incline(angle: float) -> tuple[fm.System, contact.HalfSpace]:
    """A scene whose floor slopes down along x by an angle (rad)."""
    scene = fm.System(gravity=(G * float(np.sin(angle)), 0.0, -G * float(np.cos(angle))))
    return scene, contact.HalfSpace(scene.ground.frame())


def _free(scene: fm.System, body: fm.RigidBody, place: Sequence[float], velocity: Sequence[float]) -> None:
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, 1.0, 0.0, 0.0, 0.0), (*velocity, 0.0, 0.0, 0.0)
