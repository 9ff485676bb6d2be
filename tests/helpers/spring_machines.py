"""Machines with a lattice of springs, as a body with history or as its twin of rigid bodies."""

from __future__ import annotations

import numpy as np
from spring_interior import ImplicitSprings, Springs, as_continuum, as_rigid_bodies

import flexmbd as fm
from flexmbd.multibody.bodies.continuum_body import InteriorFrame

SPIN = np.array([0.0, 3.0, 0.0])


class Nothing(Springs):
    """No interior at all behind its frames: what makes a machine step as those with bodies that have a history do."""

    def __init__(self):
        self.frames = (InteriorFrame("alone", np.zeros(3), np.eye(3), 1.0, np.zeros(3), np.eye(3)),)

    mass = 0.0

    def begin(self, t, motion, gravity):
        return np.zeros((len(self.frames), 6))

    def snapshot(self):
        return {}

    def restore(self, memory):
        pass

    def energies(self):
        return {}

    def trial(self, t_end, h, scheme, motion):
        k = 6 * len(self.frames)
        return np.zeros((k // 6, 6)), np.zeros((k, k))

    def commit(self):
        pass

    revert = commit


def ends(scene, interior, twin, spin=(0.0, 0.0, 0.0)):
    """The two end frames of the lattice, or of its twin, whose second is free where no joint will carry it."""
    if not twin:
        body, (a, b) = as_continuum(scene, interior)
        return a, b, body
    a, b = as_rigid_bodies(scene, interior, spin=spin)
    alone = scene.add(fm.ContinuumBody(Nothing()), name="alone") if isinstance(interior, ImplicitSprings) else None
    if alone:
        scene.connect(fm.joint.Free(), scene.ground.frame(), alone.frame("alone"))
    return a, b, alone


def fly(scene, interior, b, twin, spin=(0.0, 0.0, 0.0)):
    if twin:
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), b)
        p = interior.frames[1].p_BI_B
        free.position = [*p, 1.0, 0.0, 0.0, 0.0]
        free.velocity = [*np.cross(spin, p), *spin]


def pendulum(interior, twin):
    """Turning about one end, with a ball on the other."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    a, b, body = ends(scene, interior, twin, SPIN)
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), a)
    hinge.velocity = SPIN[1]
    fly(scene, interior, b, twin, SPIN)
    ball = scene.add(fm.RigidBody(0.7, (0.01, 0.02, 0.015), (0.1, 0.0, 0.05)), name="ball")
    joint = scene.connect(fm.joint.Spherical(), b, ball.frame())
    joint.velocity = [0.5, 0.0, 1.0]
    return scene, [a, b, ball.frame()], hinge, body


def cantilever(interior, twin):
    """One end held, a force and a torque on the other."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    a, b, body = ends(scene, interior, twin)
    wall = scene.connect(fm.joint.Fixed(), scene.ground.frame(), a)
    fly(scene, interior, b, twin)
    scene.add_force(fm.force.FrameForce(b, (5.0, 40.0, lambda t: 30.0 * np.sin(20.0 * t)), (0.0, 3.0, 0.0)))
    return scene, [a, b], wall, body


def loop(interior, twin):
    """Closed by an arm from the other end to the ground: a four-bar with multipliers."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    a, b, body = ends(scene, interior, twin)
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), a)
    fly(scene, interior, b, twin)
    arm = scene.add(fm.RigidBody(0.9, (0.01, 0.02, 0.02), (0.0, 0.0, -0.2)), name="arm")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(p=(1.0, 0.0, 0.4)), arm.frame())
    scene.connect(fm.joint.Spherical(), b, arm.frame(p=(0.0, 0.0, -0.4)), way=fm.Way.CONSTRAINTS)
    return scene, [a, b, arm.frame()], hinge, body
