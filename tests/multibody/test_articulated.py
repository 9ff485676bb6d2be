"""Forward dynamics in O(bodies) against the residual, and its factors against masses of particles."""

from __future__ import annotations

import numpy as np
import pytest
from particles import particle_body
from scipy.spatial.transform import Rotation
from test_recursion import along, mixed_scene, particle_positions, rigid_cloud

import flexmbd as fm
from flexmbd.multibody.kernels.articulated import articulate, forward_dynamics, solve_mass
from flexmbd.multibody.kernels.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import new_work
from flexmbd.multibody.kernels.residual import drive, residual

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
    return scene, bodies, clouds
