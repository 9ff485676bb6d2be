"""The compiled recursion against d'Alembert's principle on the particles themselves."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import GRAVITY, along, mixed_scene, particle_positions, rigid_cloud
from particles import elastic_forces, strain_energy
from scipy.spatial.transform import Rotation

from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.sampling.series import energy_series, frame_series
from flexmbd.multibody.plan.compiled_scene import add_probe
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian, constraint_values, mass_matrix


def test_bodies_frames_are_where_the_joints_put_them():
    """Poses through a flexible parent, composed by hand with SciPy's rotations."""
    scene, bodies, clouds, _ = mixed_scene()
    compiled = scene.compile().scene
    rng = np.random.default_rng(7)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.4, x)
    _, b, c, *_ = bodies
    free, hinge, ball = (scene._connections[k] for k in range(3))
    slot = {k: compiled.index.joints[j].x for k, j in enumerate((free, hinge, ball))}

    def matrix(q):
        return Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()

    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    p_G, R_G = x[slot[0]][:3], matrix(x[slot[0]][3:])
    R_a = R_G @ turn.T
    p_a = p_G - R_a @ [0.1, 0.2, 0.0]
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    R_b = R_a @ Rotation.from_rotvec(axis * x[slot[1]][0]).as_matrix()
    p_b = p_a + R_a @ [0.3, 0.0, 0.1]
    tip = clouds[id(b)].record.interface("tip")
    q = x[compiled.index.modes[b].x]
    R_tip = R_b @ Rotation.from_rotvec(tip.modes[3:] @ q).as_matrix() @ tip.R_BI
    p_tip = p_b + R_b @ (tip.p_BI_B + tip.modes[:3] @ q)
    R_c = R_tip @ matrix(x[slot[2]]) @ turn.T
    p_c = p_tip - R_c @ [0.0, -0.1, 0.0]
    plan = add_probe(compiled, c.frame())
    out, zero = np.zeros((1, 21)), np.zeros((1, compiled.nv))
    frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], zero, zero, out)
    np.testing.assert_allclose(out[0, :3], p_c, atol=1e-14)
    np.testing.assert_allclose(out[0, 3:12].reshape(3, 3), R_c, atol=1e-14)




@pytest.mark.parametrize("seed", [0, 1])
def test_residual_is_d_alembert_on_particles(seed):
    """out_j = sum m dr/dv_j . (r'' - g) + elastic + damping, r'' by central differences."""
    scene, bodies, clouds, _ = mixed_scene()
    compiled = scene.compile().scene
    plan = compiled.plan
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v, a = rng.standard_normal((2, compiled.nv))
    mass = np.concatenate(
        [clouds[id(b)].mass if id(b) in clouds else rigid_cloud(b)[0] for b in bodies]
    )
    weights = {1: 1.0 / 90.0, 2: -3.0 / 20.0, 3: 3.0 / 2.0}
    step = 5e-3
    here = particle_positions(compiled, bodies, clouds, x)
    second = -49.0 / 18.0 * here
    for k, w in zip((3, 2, 1), weights.values(), strict=True):
        for sign in (-1.0, 1.0):
            place = along(compiled, x, v, a, sign * k * step)
            second = second + w * particle_positions(compiled, bodies, clouds, place)
    second /= step * step
    force = mass[:, None] * (second - GRAVITY)
    expected = np.zeros(compiled.nv)
    for j, unit in enumerate(np.eye(compiled.nv)):
        arm = np.zeros_like(here)
        for k, w in ((1, 2.0 / 3.0), (2, -1.0 / 12.0)):
            for sign in (-1.0, 1.0):
                place = along(compiled, x, unit, 0 * unit, sign * k * 1e-3)
                arm += sign * w * particle_positions(compiled, bodies, clouds, place)
        expected[j] = np.sum(arm / 1e-3 * force)
    for body in bodies:
        if id(body) in clouds:
            record, slots = clouds[id(body)].record, compiled.index.modes[body]
            expected[slots.v] += elastic_forces(record, x[slots.x]) + record.damping @ v[slots.v]
    out = np.zeros(compiled.nv)
    residual(plan, new_work(plan), x, v, a, np.zeros(len(plan.rows)), out)
    # differences of order 6 and 4 with these steps hold about 9 digits
    np.testing.assert_allclose(out, expected, atol=2e-8 * np.abs(expected).max())


def test_constraint_rates_are_derivatives_of_the_residuals():
    scene, *_ = mixed_scene()
    compiled = scene.compile().scene
    work = new_work(compiled.plan)
    rng = np.random.default_rng(3)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v, a = rng.standard_normal((2, compiled.nv))
    phi, rate, rate2 = constraint_values(compiled, work, x, v, a)
    step = 2e-3
    places = {
        k: constraint_values(compiled, work, along(compiled, x, v, a, k * step), 0 * v)[0]
        for k in range(-3, 4)
    }
    first = sum(
        w * (places[k] - places[-k]) for k, w in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
    )
    second = -49.0 / 18.0 * places[0] + sum(
        w * (places[k] + places[-k]) for k, w in ((1, 1.5), (2, -0.15), (3, 1.0 / 90.0))
    )
    assert len(phi) == 5 + 5 + 5
    np.testing.assert_allclose(rate, first / step, atol=1e-10 * np.abs(rate).max())
    np.testing.assert_allclose(rate2, second / step**2, atol=1e-7 * np.abs(rate2).max())


def test_reactions_are_the_transposed_jacobian():
    scene, *_ = mixed_scene()
    compiled = scene.compile().scene
    plan, work = compiled.plan, new_work(compiled.plan)
    rng = np.random.default_rng(4)
    x = np.empty(compiled.nx)
    retract(plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v, a = rng.standard_normal((2, compiled.nv))
    jacobian = constraint_jacobian(compiled, work, x)
    multipliers = rng.standard_normal(len(plan.rows))
    without, with_ = np.zeros((2, compiled.nv))
    residual(plan, work, x, v, a, 0 * multipliers, without)
    residual(plan, work, x, v, a, multipliers, with_)
    expected = jacobian.T @ multipliers
    np.testing.assert_allclose(with_ - without, expected, atol=1e-12 * np.abs(with_).max())


def test_mass_matrix_is_the_kinetic_energy():
    """v M v / 2 from the trajectory's energy kernel and from the particles' velocities."""
    scene, bodies, clouds, _ = mixed_scene()
    compiled = scene.compile().scene
    work = new_work(compiled.plan)
    rng = np.random.default_rng(5)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v = rng.standard_normal(compiled.nv)
    matrix = mass_matrix(compiled, work, x)
    places = [
        particle_positions(compiled, bodies, clouds, along(compiled, x, v, 0 * v, k * 1e-3))
        for k in (-2, -1, 1, 2)
    ]
    rate = (places[0] - 8 * places[1] + 8 * places[2] - places[3]) / 12e-3
    mass = np.concatenate(
        [clouds[id(b)].mass if id(b) in clouds else rigid_cloud(b)[0] for b in bodies]
    )
    kinetic = 0.5 * np.sum(mass[:, None] * rate**2)
    assert 0.5 * v @ matrix @ v == pytest.approx(kinetic, rel=1e-9)


def test_energies():
    """Of the trajectory's kernel, against the particles' and the modes'."""
    scene, bodies, clouds, _ = mixed_scene()
    compiled = scene.compile().scene
    rng = np.random.default_rng(6)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v = rng.standard_normal(compiled.nv)
    matrix = mass_matrix(compiled, new_work(compiled.plan), x)
    records = [(body, clouds[id(body)].record) for body in bodies if id(body) in clouds]
    elastic = sum(strain_energy(record, x[compiled.index.modes[body].x]) for body, record in records)
    out = np.zeros((1, 3))
    energy_series(compiled.plan, new_work(compiled.plan), x[None], v[None], 0 * v, 0 * v, out)
    assert out[0, 0] == pytest.approx(0.5 * v @ matrix @ v, rel=1e-12)
    assert out[0, 1] == pytest.approx(elastic, rel=1e-12)
