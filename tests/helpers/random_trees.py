"""Random trees of rigid and flexible bodies, and places in their configuration space."""

from __future__ import annotations

import numpy as np
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.joints import retract

NOTHING = np.zeros(0)


def random_tree(seed, *, driven=True):
    """Eight bodies on random joints, at random places: about half of them flexible, one of them with two children."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=rng.standard_normal(3) * 9.0)
    bodies, clouds, hinges = [], {}, []

    def marker(body):
        turn = np.eye(3) if rng.random() < 0.3 else Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
        return body.frame(p=rng.standard_normal(3) * 0.3, R=turn)

    for k in range(8):
        if k in (2, 4) or rng.random() < 0.3:
            cloud = particle_body(seed * 100 + k, modes=4 + k % 3, damping=1.5, stretched=(0, 2) if k == 4 else ())
            body = scene.add(fm.FlexibleBody(cloud.record))
            clouds[id(body)] = cloud
            outer = body.frame("root") if rng.random() < 0.5 else body.frame()
        else:
            inertia = np.diag(rng.uniform(0.02, 0.03, 3))
            body = scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), inertia, tuple(rng.standard_normal(3) * 0.2)))
            outer = marker(body)
        parent = scene.ground if k == 0 else bodies[{3: 2, 5: 4, 6: 4}.get(k, rng.integers(k))]
        if id(parent) in clouds:
            inner = parent.frame("tip") if k != 3 else parent.frame()
        else:
            inner = marker(parent)
        axis = rng.standard_normal(3)
        kinds = [fm.joint.Revolute(axis), fm.joint.Prismatic(axis), fm.joint.Spherical(), fm.joint.Fixed()]
        joint = fm.joint.Free() if k == 0 and seed % 2 else kinds[rng.integers(4) if k > 2 else k]
        connection = scene.connect(joint, inner, outer)
        if isinstance(joint, fm.joint.Revolute | fm.joint.Prismatic):
            hinges.append(connection)
        bodies.append(body)
    for connection in hinges[1:2] if driven else []:
        connection.prescribe(fm.Sine(0.3, 1.7, phase=0.4))
    for connection in hinges[:1]:
        law = fm.force.JointTorque if isinstance(connection.joint, fm.joint.Revolute) else fm.force.JointForce
        scene.add_force(law(connection, 1.7))
    for connection in hinges[2:3]:
        scene.add_force(fm.force.JointSpring(connection, 30.0, 0.2, 1.5))
    return scene, bodies, clouds


def somewhere(compiled, seed, *, spread=0.4):
    """A configuration, a velocity and a work whose functions of time all stand at other numbers."""
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * spread, x)
    v = rng.standard_normal(compiled.nv)
    work = new_work(compiled.plan)
    work.time[:] = rng.standard_normal(work.time.shape)
    drive(compiled.plan, work, x, v, np.zeros(compiled.nv))
    return x, v, work
