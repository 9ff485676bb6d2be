"""Machines of every joint and of rigid and flexible bodies, and where their particles are."""

from __future__ import annotations

import numpy as np
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.plan.compiled_scene import add_probe

GRAVITY = np.array([0.3, -9.81, 1.2])


def mixed_scene(*, rotors=False, nonlinear=False):
    """Every joint kind, rigid and flexible parents, a reversed joint, a joint at a flexible tip."""
    scene = fm.System(gravity=GRAVITY)
    clouds = [
        particle_body(1, modes=3, damping=2.0, stretched=(0, 2), rotors=rotors, nonlinear=nonlinear),
        particle_body(2, modes=2, rotors=rotors, nonlinear=nonlinear),
    ]
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    a = scene.add(fm.RigidBody(1.3, np.diag([0.02, 0.03, 0.04]), (0.1, 0.05, -0.02)), name="a")
    b = scene.add(fm.FlexibleBody(clouds[0].record), name="b")
    c = scene.add(fm.RigidBody(0.7, np.diag([0.01, 0.02, 0.015]), (0.0, 0.1, 0.03)), name="c")
    d = scene.add(fm.FlexibleBody(clouds[1].record), name="d")
    e = scene.add(fm.RigidBody(0.4, np.diag([0.01, 0.012, 0.013])), name="e")
    f = scene.add(fm.RigidBody(0.2, np.diag([0.01, 0.012, 0.013])), name="f")
    joint = fm.joint
    scene.connect(joint.Free(), scene.ground.frame(), a.frame(p=(0.1, 0.2, 0.0), R=turn))
    scene.connect(joint.Revolute((1.0, 2.0, -1.0)), a.frame(p=(0.3, 0.0, 0.1)), b.frame("root"))
    scene.connect(joint.Spherical(), b.frame("tip"), c.frame(p=(0.0, -0.1, 0.0), R=turn))
    scene.connect(joint.Prismatic("y"), c.frame(p=(0.2, 0.1, 0.0)), d.frame("root"))
    scene.connect(joint.Revolute("x"), e.frame(p=(0.0, 0.0, 0.2), R=turn), d.frame("tip"))
    scene.connect(joint.Fixed(), e.frame(p=(0.1, 0.0, 0.0)), f.frame(R=turn))
    loops = [
        scene.connect(joint.Fixed(), a.frame(), f.frame(p=(0.1, 0.2, 0.3)), name="close fixed"),
        scene.connect(
            joint.Revolute("x"), d.frame("tip"), scene.ground.frame(R=turn), name="close turn"
        ),
        scene.connect(joint.Prismatic("z"), b.frame("tip"), e.frame(), name="close slide"),
    ]
    return scene, (a, b, c, d, e, f), {id(b): clouds[0], id(d): clouds[1]}, loops


def rigid_cloud(body):
    """Six particles with the mass, centre and inertia of a rigid body."""
    first, second = body.moments()
    central = second - np.outer(first, first) / body.mass
    values, axes = np.linalg.eigh(central)
    arms = axes * np.sqrt(3.0 * np.maximum(values, 0.0) / body.mass)
    centre = first / body.mass
    places = np.concatenate([centre + arms.T, centre - arms.T])
    return np.full(6, body.mass / 6.0), places


def particle_positions(compiled, bodies, clouds, x):
    """World positions of all particles, (k, 3), from the body frames' poses alone."""
    points = []
    for body in bodies:
        plan = add_probe(compiled, body.frame())
        out = np.zeros((1, 21))
        zero = np.zeros((1, compiled.nv))
        frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], zero, zero, out)
        p, R = out[0, :3], out[0, 3:12].reshape(3, 3)
        if id(body) in clouds:
            cloud = clouds[id(body)]
            local = cloud.x + cloud.phi @ x[compiled.index.modes[body].x]
        else:
            local = rigid_cloud(body)[1]
        points.append(p + local @ R.T)
    return np.concatenate(points)


def along(compiled, x, v, a, t):
    """A curve with velocity v and acceleration a at t = 0."""
    out = np.empty_like(x)
    retract(compiled.plan, x, v * t + 0.5 * a * t * t, out)
    return out
