"""The benchmark bicycle of Meijaard, Papadopoulos, Ruina & Schwab (2007), of joints and two rolling discs."""

from __future__ import annotations

import numpy as np

import flexmbd as fm

BASE, TRAIL, TILT = 1.02, 0.08, np.pi / 10
REAR, FRONT = 0.3, 0.35
G = 9.81

#: z of the disc along y of the wheel.
_AXLE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

# their equations in roll and steer, M q'' + v C1 q' + (g K0 + v^2 K2) q = 0
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])


def bicycle(speed):
    """The scene, riding straight along x, z up; and its steering joint, whose axis points down as theirs does."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    frame = scene.add(
        fm.RigidBody(85.0, [[9.2, 0.0, -2.4], [0.0, 11.0, 0.0], [-2.4, 0.0, 2.8]], (0.3, 0.0, 0.9 - REAR)), name="frame"
    )
    head = np.array([BASE + TRAIL, 0.0, -REAR])  # where the steering axis meets the ground, from the rear hub
    hub = np.array([BASE, 0.0, FRONT - REAR])
    com = np.array([0.9, 0.0, 0.7 - REAR])
    fork = scene.add(
        fm.RigidBody(4.0, [[0.05892, 0.0, 0.00756], [0.0, 0.06, 0.0], [0.00756, 0.0, 0.00708]], tuple(com - head)),
        name="fork",
    )
    rear = scene.add(fm.RigidBody(2.0, (0.0603, 0.12, 0.0603)), name="rear wheel")
    front = scene.add(fm.RigidBody(3.0, (0.1405, 0.28, 0.1405)), name="front wheel")
    ground = scene.ground.frame()
    ride = scene.connect(fm.joint.Free(), ground, frame.frame(), name="ride")
    axis = (np.sin(TILT), 0.0, -np.cos(TILT))
    steer = scene.connect(fm.joint.Revolute(axis), frame.frame(p=head), fork.frame(), name="steer")
    spins = [
        scene.connect(fm.joint.Revolute("y"), body.frame(p=place), wheel.frame(), name=f"{wheel.name} axle")
        for body, place, wheel in ((frame, (0.0, 0.0, 0.0), rear), (fork, hub - head, front))
    ]
    for wheel, radius in ((rear, REAR), (front, FRONT)):
        scene.connect(fm.joint.RollingDisc(radius), ground, wheel.frame(R=_AXLE), name=f"{wheel.name} rolls")
    ride.position = [0.0, 0.0, REAR, 1.0, 0.0, 0.0, 0.0]
    ride.velocity = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
    for spin, radius in zip(spins, (REAR, FRONT), strict=True):
        spin.velocity = speed / radius
    return scene, frame, steer
