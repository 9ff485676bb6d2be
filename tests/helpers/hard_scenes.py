"""Scenes with hard contacts, and the closed forms of their impacts."""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from flexmbd import contact

G = 9.81


def bouncing_ball(law, *, height=0.5, radius=0.1, gravity=G, size=1.0, up="z", mass=1.0):
    """A ball at ``height`` above a floor; the scene, its joint, and the contact."""
    axis = "xyz".index(up)
    pull, place = np.zeros(3), np.zeros(3)
    pull[axis], place[axis] = -gravity * size, (radius + height) * size
    scene = fm.System(gravity=pull)
    ball = scene.add(fm.RigidBody(mass, (0.4 * mass * (radius * size) ** 2,) * 3), name="ball")
    drop = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame(), name="drop")
    drop.position = (*place, 1.0, 0.0, 0.0, 0.0)
    floor = contact.HalfSpace(scene.ground.frame(), normal=up)
    (pair,) = scene.touch(floor, contact.Sphere(ball.frame(), radius * size), law)
    return scene, drop, pair


def times_of_bounces(count, *, e, height=0.5, gravity=G):
    """(count,) s, a ball's first bounces: flights of 2 e^k t0, t0 the time of its fall."""
    fall = np.sqrt(2.0 * height / gravity)
    return fall * (1.0 + 2.0 * np.concatenate([[0.0], np.cumsum(e ** np.arange(1.0, count))]))


def _turn(t):
    return 7.0 * np.pi / 18.0 - t


def _turn_rate(t):
    return 0.0 * t - 1.0


def _turn_acceleration(t):
    return 0.0 * t


def four_bar(law, *, backwards=False, scale=1.0, driven=False):
    """A parallelogram of cranks of 0.5 m, whose coupler carries a ball over a plane that it meets at 30 degrees.

    At 70 degrees at the start, turning back by 1 rad/s, without gravity: the coupler does not turn, so that the machine
    is one inertia, and a blow takes the share 1 + e of its speed.  ``driven``: the crank goes on turning so.
    """
    scene = fm.System()
    crank, coupler, rocker = (
        fm.RigidBody(mass, (mass / 12.0 * (length * scale) ** 2,) * 3)
        for mass, length in ((1.0, 0.5), (2.0, 1.0), (1.0, 0.5))
    )
    named = [(crank, "crank"), (coupler, "coupler"), (rocker, "rocker")]
    for body, name in reversed(named) if backwards else named:
        scene.add(body, name=name)
    half, quarter = (0.5 * scale, 0.0, 0.0), (0.25 * scale, 0.0, 0.0)
    back, short = (-0.5 * scale, 0.0, 0.0), (-0.25 * scale, 0.0, 0.0)
    ground = scene.ground
    joints = [
        (ground.frame(), crank.frame(p=short)),
        (crank.frame(p=quarter), coupler.frame(p=back)),
        (ground.frame(p=(1.0 * scale, 0.0, 0.0)), rocker.frame(p=short)),
        (rocker.frame(p=quarter), coupler.frame(p=half)),
    ]
    made = [scene.connect(fm.joint.Revolute("z"), *ends) for ends in (reversed(joints) if backwards else joints)]
    first, lift, second, fourth = reversed(made) if backwards else made
    angle = np.deg2rad(70.0)
    first.position, lift.position, second.position, fourth.position = angle, -angle, angle, -angle
    first.velocity, lift.velocity, second.velocity, fourth.velocity = -1.0, 1.0, -1.0, 1.0
    if driven:
        first.position = first.velocity = None
        first.prescribe(fm.Motion(*map(fm.compiled, (_turn, _turn_rate, _turn_acceleration))))
    plane = contact.HalfSpace(ground.frame(p=(0.0, 0.2 * scale, 0.0)), normal="y")
    (pair,) = scene.touch(plane, contact.Sphere(coupler.frame(), 0.05 * scale), law)
    return scene, pair
