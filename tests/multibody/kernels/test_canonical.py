"""Momenta and the gradients of the energies, against differences of energies made elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import mixed_scene

import flexmbd as fm
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.canonical import canonical, momenta, potential_energy
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.sampling.series import energy_series
from flexmbd.multibody.plan.scene_matrices import mass_matrix


def state(compiled, seed):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    return x, rng.standard_normal(compiled.nv)


def free_rows(plan):
    """Offsets in x (of the quaternion) and v (of the linear velocity) of free joints."""
    return [(row[at.JOINT_X] + 3, row[at.JOINT_V]) for row in plan.tree if row[at.JOINT_SIZE] == 6]


def lagrangian(compiled, x, v):
    """T - V by the trajectory's kernel."""
    out = np.zeros((1, 4))
    none = np.zeros(compiled.nv)
    energy_series(compiled.plan, new_work(compiled.plan), x[None], v[None], none, none.copy(), out)
    return out[0, 0] - out[0, 1:].sum()


def spring_scene(*, nonlinear=False):
    """The mixed scene with a spring on a joint, and a screw."""
    scene, *_ = mixed_scene(nonlinear=nonlinear)
    hinge = scene._connections[1]
    scene.add_force(fm.force.JointSpring(hinge, 3.0, rest=0.2))
    nut = scene.add(fm.RigidBody(0.5, np.diag([0.01, 0.02, 0.03]), (0.1, 0.02, 0.05)), name="nut")
    scene.connect(fm.joint.Screw(0.3, "y"), scene._bodies[3].frame("tip"), nut.frame(p=(0.1, 0.0, 0.0)))
    return scene


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_force_is_the_lagrangians_gradient_and_momentum_its_velocity_gradient(seed, nonlinear):
    """By differences of order 6, the free joint's linear velocity turned with the joint."""
    compiled = spring_scene(nonlinear=nonlinear).compile().scene
    plan, work, nv = compiled.plan, new_work(compiled.plan), compiled.nv
    plan.flex[:, at.MODAL_DAMPING] = -1
    x, v = state(compiled, seed)
    p, out, none = np.zeros((3, nv))
    loose = np.zeros(len(plan.rows))
    canonical(plan, work, x, v, 0.5 * v, none, loose, np.zeros((len(plan.tree), 6)), np.zeros(6), p, out)
    weights = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
    step = 1e-2
    (_, k0), = free_rows(plan)

    def moved(j, size):
        place, turned = np.empty_like(x), v.copy()
        retract(plan, x, np.eye(nv)[j] * size, place)
        if k0 + 3 <= j < k0 + 6:
            axis = np.eye(3)[j - k0 - 3] * size
            turned[k0 : k0 + 3] = rotation(x, plan) @ exp(axis) @ rotation(x, plan).T @ v[k0 : k0 + 3]
        return lagrangian(compiled, place, turned)

    gradient = np.array(
        [sum(w * (moved(j, k * step) - moved(j, -k * step)) for k, w in weights) / step for j in range(nv)]
    )
    by_velocity = np.array(
        [
            0.5 * (lagrangian(compiled, x, v + e) - lagrangian(compiled, x, v - e))
            for e in np.eye(nv)
        ]
    )
    np.testing.assert_allclose(p, by_velocity, atol=1e-11 * np.abs(p).max())
    np.testing.assert_allclose(out, -gradient, atol=1e-9 * np.abs(out).max())
    np.testing.assert_allclose(p, mass_matrix(compiled, work, x) @ v, atol=1e-12 * np.abs(p).max())
    q = np.zeros(nv)
    momenta(plan, work, x, v, none, q)
    np.testing.assert_allclose(q, p, atol=1e-13 * np.abs(p).max())
    forward_kinematics(plan, work, x, none, none)
    assert potential_energy(plan, work, x) == pytest.approx(-lagrangian(compiled, x, none), rel=1e-12)


def exp(theta):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(theta).as_matrix()


def rotation(x, plan):
    from scipy.spatial.transform import Rotation

    (o, _), = free_rows(plan)
    return Rotation.from_quat(x[[o + 1, o + 2, o + 3, o]]).as_matrix()
