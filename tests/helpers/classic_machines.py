"""Tops, double pendulums and slider-cranks of the textbooks."""

from __future__ import annotations

from functools import cache

import numpy as np
from machines import slider_crank
from scipy.integrate import solve_ivp

import flexmbd as fm

MASS, INERTIA = 15.0, np.array([0.234375, 0.46875, 0.234375])
SPIN = np.array([0.0, 150.0, -4.61538])
GRAVITY = np.array([0.0, 0.0, -9.81])


def heavy_top(*, closed=False, spin=SPIN, inertia=tuple(INERTIA)):
    """BENCHMARKS A7, by a spherical joint or as a free body that a loop holds by its tip."""
    scene = fm.System(gravity=tuple(GRAVITY))
    top = scene.add(fm.RigidBody(MASS, np.diag(inertia), (0.0, 1.0, 0.0)), name="top")
    if closed:
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), top.frame())
        free.velocity = (0.0, 0.0, 0.0, *spin)
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    if not closed:
        ball.velocity = tuple(spin)
    return scene, top


def turn(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@cache
def euler_top(t_end, spin=tuple(SPIN), inertia=tuple(INERTIA)):
    """Quaternion, spin in body axes, and force of the ground on the tip, from Euler's equations."""
    arm = np.array([0.0, 1.0, 0.0])
    about_tip = np.array(inertia) + MASS * np.array([1.0, 0.0, 1.0])

    def spin_rate(q, w):
        torque = np.cross(arm, MASS * turn(q).T @ GRAVITY)
        return (torque - np.cross(w, about_tip * w)) / about_tip

    def equations(t, y):
        q, w = y[:4], y[4:]
        s, v = q[0], q[1:]
        return np.concatenate([[-0.5 * v @ w], 0.5 * (s * w + np.cross(v, w)), spin_rate(q, w)])

    y = solve_ivp(
        equations, (0.0, t_end), [1.0, 0.0, 0.0, 0.0, *spin], method="DOP853", rtol=3e-14, atol=1e-14
    ).y[:, -1]
    q, w = y[:4] / np.linalg.norm(y[:4]), y[4:]
    acceleration = turn(q) @ (np.cross(spin_rate(q, w), arm) + np.cross(w, np.cross(w, arm)))
    return q, w, MASS * (acceleration - GRAVITY)


def loaded_slider_crank():
    """Crank started at 10 rad/s and driven by a sine torque."""
    scene, piston, j1 = slider_crank()
    scene.add_force(fm.force.JointTorque(j1, fm.Sine(3.0, 20.0, 0.4)))
    j1.position = 0.3
    j1.velocity = 10.0
    return scene, piston, j1


def rods_double_pendulum(start):
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    rods = [
        scene.add(fm.RigidBody(1.0, (1e-4, 1 / 12, 1 / 12), (0.5, 0.0, 0.0)), name=f"rod {k}")
        for k in (1, 2)
    ]
    first = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rods[0].frame())
    second = scene.connect(fm.joint.Revolute("z"), rods[0].frame(p=(1.0, 0.0, 0.0)), rods[1].frame())
    first.position, second.position = start
    return scene, rods[1].frame(p=(1.0, 0.0, 0.0))
