"""Radau IIA: order, tolerance, stiff machines, reuse of factors, against closed forms and other methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machines import CRANK, pendulum, slider_crank, slider_position
from particles import particle_body

import flexmbd as fm
from flexmbd.integrate.radau.coefficients import ORDER
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual

RADAU = fm.RadauIIA()


def loaded_slider_crank():
    """Crank started at 10 rad/s and driven by a sine torque."""
    scene, piston, j1 = slider_crank()
    scene.add_force(fm.force.JointTorque(j1, fm.Sine(3.0, 20.0, 0.4)))
    j1.position = 0.3
    j1.velocity = 10.0
    return scene, piston, j1


def tumbling_top(*, closed):
    """A heavy asymmetric top on a spherical joint, or flying and held at its point by multipliers."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    top = scene.add(fm.RigidBody(2.0, np.diag([0.03, 0.05, 0.02]), (0.0, 0.2, 0.05)), name="top")
    if closed:
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), top.frame())
        free.velocity = (0.0, 0.0, 0.0, 2.0, 5.0, -3.0)
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    if not closed:
        ball.velocity = (2.0, 5.0, -3.0)
    return scene


def observed_orders(scene, t_end, steps, exact_steps):
    """(len(steps) - 1, 4) orders of x, v, a and multipliers at t_end; the last is empty on a tree."""

    def end(n):
        run = scene.simulate(t_end, h=t_end / n, rtol=1e-10, integrator=RADAU)
        return [run.x[-1], run.v[-1], run.a[-1], run.multipliers[-1]]

    exact = end(exact_steps)
    errors = [[np.abs(p - e).max(initial=0.0) for p, e in zip(end(n), exact, strict=True)] for n in steps]
    found = np.array(errors)
    return np.log2(found[:-1] / np.where(found[1:] == 0.0, np.nan, found[1:]))


def test_order_five_for_positions_velocities_and_multipliers():
    scene, _, _ = loaded_slider_crank()
    orders = observed_orders(scene, 0.16, (80, 160), 800)
    assert orders.min() > ORDER - 0.2, orders


def test_order_five_on_rotations():
    """Rotation vectors of steps of a quarter radian, by their own differential."""
    tree = observed_orders(tumbling_top(closed=False), 1.0, (25, 50), 400)
    assert tree[:, :3].min() > ORDER - 0.3, tree
    closed = observed_orders(tumbling_top(closed=True), 1.0, (25, 50), 400)
    assert closed.min() > ORDER - 0.3, closed


def test_the_top_is_the_same_by_multipliers():
    runs = [tumbling_top(closed=closed).simulate(1.0, rtol=1e-9, integrator=RADAU) for closed in (False, True)]
    tips = [run.position(run.bodies["top"].frame(p=(0.0, 1.0, 0.3)))[-1] for run in runs]
    np.testing.assert_allclose(*tips, atol=1e-7)
    assert np.ptp(runs[1].energy().total) < 1e-6
    assert runs[1].stats.constraint_residual < 1e-12


def test_pendulum_follows_the_reference_in_proportion_to_rtol():
    """BENCHMARKS A1 at 10 s, twelve digits."""
    scene, bob, _ = pendulum()
    tip = bob.frame(p=(1.0, 0.0, 0.0))
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        run = scene.simulate(10.0, rtol=rtol, integrator=RADAU)
        errors.append(np.abs(run.position(tip)[-1, :2] - (-0.275087462576, -0.961419205099)).max())
        assert errors[-1] < 60.0 * rtol
    falls = np.array(errors[:-1]) / errors[1:]
    assert falls.min() > 20.0
    assert falls.max() < 500.0


def test_far_fewer_steps_than_by_order_two():
    scene, _, _ = pendulum()
    steps = [scene.simulate(5.0, rtol=1e-7, integrator=method).stats.steps for method in (RADAU, fm.GeneralizedAlpha())]
    assert 50 * steps[0] < steps[1]


def test_slider_crank_follows_its_closed_form():
    """The slider stays on x(angle); the multipliers recorded close the accelerations, too."""
    scene, piston, j1 = loaded_slider_crank()
    run = scene.simulate(0.2, rtol=1e-9, integrator=RADAU)
    other = scene.simulate(0.2, rtol=1e-9)  # by order 2, to about a hundred times its rtol
    x = run.position(piston.frame())
    assert np.abs(x[:, 0] - slider_position(run.beta(j1))).max() < 1e-12 * CRANK
    assert np.abs(x[:, 1:]).max() < 1e-12 * CRANK
    assert run.stats.constraint_residual < 1e-12
    assert np.abs(run.acceleration(piston.frame())[:, 1:]).max() < 1e-6 * np.abs(run.acceleration(piston.frame())).max()
    assert run.beta(j1)[-1] == pytest.approx(other.beta(j1)[-1], abs=1e-7)
    np.testing.assert_allclose(run.multipliers[-1], other.multipliers[-1], rtol=1e-5, atol=1e-5)


def flexible_pendulum(stiffness=1.0):
    """A cloud of particles with four modes, on a hinge."""
    record = particle_body(3, modes=4).record
    record = replace(
        record, stiffness=record.stiffness * stiffness, damping=record.damping * np.sqrt(stiffness)
    )
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = scene.add(fm.FlexibleBody(record), name="body")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("root"))
    hinge.velocity = 3.0
    return scene, body, hinge


def test_flexible_pendulum_as_by_generalized_alpha():
    scene, body, hinge = flexible_pendulum()
    run = scene.simulate(0.5, rtol=1e-8, integrator=RADAU)
    other = scene.simulate(0.5, rtol=1e-9)
    assert np.abs(run.q(body)).max() > 1e-3
    assert run.beta(hinge)[-1] == pytest.approx(other.beta(hinge)[-1], abs=2e-7)
    np.testing.assert_allclose(run.q(body)[-1], other.q(body)[-1], atol=1e-6 * np.abs(run.q(body)).max() * 10)


def test_modes_too_stiff_to_follow_cost_no_steps():
    """Modes of 1e5 times the swing's rate: the steps of a slow machine, and deflections that the load causes."""
    scene, body, _ = flexible_pendulum(1e8)
    run = scene.simulate(2.0, rtol=1e-6, integrator=RADAU)
    assert run.stats.steps < 150, run.stats
    modal = run.scene.index.modes[body]
    x, v, a = run.x[-1].copy(), run.v[-1].copy(), run.a[-1].copy()
    x[modal.x] = v[modal.v] = a[modal.v] = 0.0
    load = np.zeros(run.scene.nv)
    residual(run.scene.plan, new_work(run.scene.plan), x, v, a, np.zeros(0), load)
    expected = -load[modal.v] / body.record.stiffness
    np.testing.assert_allclose(run.q(body)[-1], expected, atol=1e-3 * np.abs(expected).max())


def test_no_order_is_lost_on_a_stiff_machine():
    """Fixed steps of a hundred vibrations each keep at least order 3 of the swing."""
    scene, _, hinge = flexible_pendulum(1e8)
    reference = scene.simulate(1.0, rtol=1e-10, integrator=RADAU).beta(hinge)[-1]
    runs = [scene.simulate(1.0, h=1.0 / n, rtol=1e-9, integrator=RADAU) for n in (10, 20, 40)]
    errors = [abs(run.beta(hinge)[-1] - reference) for run in runs]
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[2]) / 2.0 > 3.0, errors


def test_factors_serve_many_steps():
    """With fixed steps the factors stay while Newton contracts; with error control they change seldom."""
    scene, _, _ = flexible_pendulum()
    fixed = scene.simulate(0.5, h=1e-3, rtol=1e-6, integrator=RADAU).stats
    assert fixed.factorisations < 0.05 * fixed.steps
    controlled = scene.simulate(2.0, rtol=1e-8, integrator=RADAU).stats
    assert controlled.factorisations < 0.3 * controlled.steps
    assert controlled.rejected < 0.1 * controlled.steps


def test_prescribed_motion_is_taken_at_each_stage():
    """A driven hinge follows its function, and the torque is what the motion asks for."""
    scene, _, hinge = pendulum()
    hinge.position = 0.7 * np.sin(0.1)  # where its motion has it
    hinge.prescribe(fm.Sine(0.7, 3.0, 0.1))
    run = scene.simulate(2.0, rtol=1e-8, integrator=RADAU)
    np.testing.assert_allclose(run.beta(hinge), 0.7 * np.sin(3.0 * run.t + 0.1), atol=1e-14)


def test_a_function_that_fails_stops_the_run_with_its_time():
    scene, _, hinge = pendulum()

    def torque(t):
        if t > 0.5:
            raise ValueError("no torque here")
        return 0.1 * t

    scene.add_force(fm.force.JointTorque(hinge, torque))
    with pytest.raises(fm.SimulationError, match=r"at t = 0\.[5-9].*no torque here") as caught:
        scene.simulate(2.0, rtol=1e-6, integrator=RADAU)
    assert 0.2 < caught.value.trajectory.t[-1] <= 0.5


def test_a_jump_in_the_load_is_stepped_over_with_care():
    """Velocity after a torque that sets in within a step: momentum balance."""
    scene, _, hinge = pendulum()
    scene.gravity = (0.0, 0.0, 0.0)
    scene.add_force(fm.force.JointTorque(hinge, lambda t: 1.0 if t > 0.3337 else 0.0))
    run = scene.simulate(1.0, rtol=1e-6, integrator=RADAU)
    assert run.beta_rate(hinge)[-1] == pytest.approx(1.0 - 0.3337, abs=1e-5)
    assert run.stats.rejected > 0


def test_a_restart_goes_on_to_the_bit():
    scene, _, _ = loaded_slider_crank()
    whole = scene.simulate(0.1, rtol=1e-7, integrator=RADAU, checkpoints=[0.05])
    rest = scene.simulate(0.1, integrator=RADAU, restart=whole.checkpoints[0])
    assert rest.t[-1] == whole.t[-1]
    assert (rest.x[-1] == whole.x[-1]).all()
    assert (rest.multipliers[-1] == whole.multipliers[-1]).all()


def test_a_fixed_step_that_cannot_converge_stops_and_keeps_the_past():
    scene, _, _ = loaded_slider_crank()
    with pytest.raises(fm.SimulationError, match=r"stopped at t = .*fixed step.*smaller h") as caught:
        scene.simulate(30.0, h=0.3, rtol=1e-9, integrator=RADAU)
    assert caught.value.trajectory.t[0] == 0.0
