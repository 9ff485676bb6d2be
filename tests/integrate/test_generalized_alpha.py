"""Order, tolerance and invariants of generalized-alpha, against closed forms and references."""

from __future__ import annotations

import numpy as np
import pytest
from machines import CRANK, pendulum, slider_crank, slider_position
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.integrate.alpha.generalized_alpha import ORDER


def loaded_slider_crank():
    """Crank started at 10 rad/s and driven by a sine torque."""
    scene, piston, j1 = slider_crank()
    scene.add_force(fm.force.JointTorque(j1, fm.Sine(3.0, 20.0, 0.4)))
    j1.position = 0.3
    j1.velocity = 10.0
    return scene, piston, j1


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
def test_order_two_for_positions_velocities_and_multipliers(rho):
    """Multipliers in the range where they are smooth: undamped ones (rho = 1) ripple."""
    scene, _, _ = loaded_slider_crank()
    method = fm.GeneralizedAlpha(rho)

    def end(steps):
        run = scene.simulate(0.16, h=0.16 / steps, rtol=1e-8, integrator=method)
        return run.x[-1], run.v[-1], run.multipliers[-1]

    exact = end(25600)
    errors = np.array(
        [
            [np.abs(p - e).max() for p, e in zip(end(n), exact, strict=True)]
            for n in (400, 800, 1600)
        ]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders[:, :2].min() > ORDER - 0.1, orders
    assert rho == 1.0 or orders[-1, 2] > ORDER - 0.1, orders


def test_index_three_has_order_two_and_closes_positions_alone():
    """Positions are closed to round-off, velocities as the order goes; multipliers where rho damps their start."""
    scene, piston, crank = loaded_slider_crank()
    slider = piston.frame()
    method = fm.GeneralizedAlpha(0.5, index=3)
    exact = scene.simulate(0.16, h=0.16 / 12800, rtol=1e-10, integrator=fm.GeneralizedAlpha(0.5))
    errors = []
    for n in (400, 800, 1600):
        run = scene.simulate(0.16, h=0.16 / n, rtol=1e-10, integrator=method)
        open_by = run.position(slider)[:, 0] - slider_position(run.beta(crank))
        assert np.abs(open_by).max() < 1e-12
        ends = ((run.x, exact.x), (run.v, exact.v), (run.multipliers, exact.multipliers))
        slide = run.velocity(slider)[:, 0]
        angle, rate, eps = run.beta(crank), run.beta_rate(crank), 1e-6
        slope = (slider_position(angle + eps) - slider_position(angle - eps)) / (2.0 * eps)
        drift = np.abs(slide - slope * rate)[n // 4 :].max()
        assert drift > 1e-8
        errors.append([*(np.abs(a[-1] - b[-1]).max() for a, b in ends), drift])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders.min() > ORDER - 0.1, (errors, orders)


def test_index_three_wants_fixed_steps():
    scene, _, _ = loaded_slider_crank()
    with pytest.raises(SceneError, match=r"index 3 has no error control: give a step h, or take index=2"):
        scene.simulate(0.1, rtol=1e-4, integrator=fm.GeneralizedAlpha(index=3))
    with pytest.raises(SceneError, match=r"an index of 2 or 3, got 1"):
        fm.GeneralizedAlpha(index=1)


def test_pendulum_follows_the_reference_in_proportion_to_rtol():
    """BENCHMARKS A1: positions at 1, 5 and 10 s, twelve digits."""
    scene, bob, _ = pendulum()
    tip = bob.frame(p=(1.0, 0.0, 0.0))
    references = {
        1.0: (0.986291751132, -0.165010853126),
        5.0: (-0.942305435044, -0.334754338414),
        10.0: (-0.275087462576, -0.961419205099),
    }
    for end, place in references.items():
        errors = [
            np.abs(scene.simulate(end, rtol=rtol, integrator=fm.GeneralizedAlpha()).position(tip)[-1, :2] - place).max()
            for rtol in (1e-5, 1e-7)
        ]
        assert errors[1] < 60.0 * 1e-7
        assert 30.0 < errors[0] / errors[1] < 300.0


def test_pendulum_period_by_error_control():
    """T = 4 sqrt(L/g) K(1/2): back at the start, at rest."""
    scene, _, hinge = pendulum()
    run = scene.simulate(2.36784194757624, rtol=1e-8, integrator=fm.GeneralizedAlpha())
    assert run.beta(hinge)[-1] == pytest.approx(np.pi, abs=1e-6)
    assert run.beta_rate(hinge)[-1] == pytest.approx(0.0, abs=2e-6)


@pytest.mark.parametrize("closed", [False, True])
def test_heavy_top(closed):
    """BENCHMARKS A7 at 0.5 s, by a spherical joint and by a free body held by multipliers."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    top = scene.add(
        fm.RigidBody(15.0, np.diag([0.234375, 0.46875, 0.234375]), (0.0, 1.0, 0.0)), name="top"
    )
    if closed:
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), top.frame())
        free.velocity = (0.0, 0.0, 0.0, 0.0, 150.0, -4.61538)
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    if not closed:
        ball.velocity = (0.0, 150.0, -4.61538)
    run = scene.simulate(0.5, rtol=1e-7, integrator=fm.GeneralizedAlpha())
    place = run.position(top.frame(p=(0.0, 1.0, 0.0)))[-1]
    exact = np.array([-0.702468297057, -0.021165184702, -0.711400257652])
    assert run.multipliers.shape[1] == (3 if closed else 0)
    np.testing.assert_allclose(place, exact, atol=1e-4)
    assert run.energy().total[0] == pytest.approx(5435.6967908655, rel=1e-12)
    np.testing.assert_allclose(run.energy().total, 5435.6967908655, rtol=1e-6)


def test_double_pendulum():
    """BENCHMARKS A12 (i), both rods horizontal: tip at 1 s and 3 s."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    rods = [
        scene.add(fm.RigidBody(1.0, (1e-4, 1 / 12, 1 / 12), (0.5, 0.0, 0.0)), name=f"rod {k}")
        for k in (1, 2)
    ]
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rods[0].frame())
    scene.connect(fm.joint.Revolute("z"), rods[0].frame(p=(1.0, 0.0, 0.0)), rods[1].frame())
    tip = rods[1].frame(p=(1.0, 0.0, 0.0))
    for end, place in ((1.0, (-1.6621151358, -1.0414666372)), (3.0, (1.3304368251, -1.3986448605))):
        run = scene.simulate(end, rtol=1e-8, integrator=fm.GeneralizedAlpha())
        np.testing.assert_allclose(run.position(tip)[-1, :2], place, atol=5e-6)


def test_slider_crank_follows_its_closed_form():
    """The slider stays on x(angle) to 1e-8 of the stroke at rtol 1e-9; the loop stays closed."""
    scene, piston, j1 = loaded_slider_crank()
    run = scene.simulate(0.05, rtol=1e-9, integrator=fm.GeneralizedAlpha())
    stroke = 2.0 * CRANK
    x = run.position(piston.frame())
    assert np.abs(x[:, 0] - slider_position(run.beta(j1))).max() < 1e-8 * stroke
    assert np.abs(x[:, 1:]).max() < 1e-8 * stroke
    assert run.stats.constraint_residual < 1e-10


def test_slider_crank_motion_against_the_one_dof_equation():
    """The crank's angle against the reduced equation of motion, integrated by SciPy."""
    from scipy.integrate import solve_ivp

    scene, _, j1 = loaded_slider_crank()
    run = scene.simulate(0.2, rtol=1e-8, integrator=fm.GeneralizedAlpha())

    def inertia(angle):
        # generalised inertia from the kinetic energy at unit crank speed, piece by piece
        c, s = np.cos(angle), np.sin(angle)
        sine = -CRANK * s / 0.3
        rate = -CRANK * c / (0.3 * np.sqrt(1.0 - sine**2))
        phi = np.arcsin(sine)
        vx = -CRANK * s - 0.14 * np.sin(phi) * rate
        vy = CRANK * c + 0.14 * np.cos(phi) * rate
        slider = -CRANK * s - 0.3 * np.sin(phi) * rate
        crank = 4e-4 + 0.4 * 0.03**2
        return crank + 0.8 * (vx**2 + vy**2) + 7.2e-3 * rate**2 + 0.3 * slider**2

    def equation(t, y):
        d = 1e-5
        slope = (inertia(y[0] + d) - inertia(y[0] - d)) / (2 * d)
        torque = 3.0 * np.sin(20.0 * t + 0.4)
        return y[1], (torque - 0.5 * slope * y[1] ** 2) / inertia(y[0])

    exact = solve_ivp(equation, (0.0, 0.2), (0.3, 10.0), method="DOP853", rtol=1e-11, atol=1e-12)
    assert run.beta(j1)[-1] == pytest.approx(exact.y[0, -1], abs=1e-6)
    assert run.beta_rate(j1)[-1] == pytest.approx(exact.y[1, -1], rel=2e-6)


def test_free_flight_keeps_momentum_and_energy():
    """A tumbling flexible body without gravity: momenta from particle sums."""
    cloud = particle_body(3, modes=4)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(cloud.record), name="body")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    free.velocity = (0.3, -0.2, 0.5, 3.0, -2.0, 4.0)
    run = scene.simulate(2.0, rtol=1e-7, integrator=fm.GeneralizedAlpha())
    p, R = run.position(body.frame()), run.rotation(body.frame())
    v, w = run.velocity(body.frame()), run.angular_velocity(body.frame())
    q, qd = run.q(body), run.v[:, run.scene.index.modes[body].v]
    local = cloud.x + np.einsum("kai,ti->tka", cloud.phi, q)
    arm = np.einsum("tab,tkb->tka", R, local)
    rate = np.einsum("tab,kbi,ti->tka", R, cloud.phi, qd)
    speed = v[:, None] + np.cross(w[:, None], arm) + rate
    linear = np.einsum("k,tka->ta", cloud.mass, speed)
    angular = np.einsum("k,tka->ta", cloud.mass, np.cross(p[:, None] + arm, speed))
    np.testing.assert_allclose(linear, np.tile(linear[0], (len(linear), 1)), atol=2e-6)
    np.testing.assert_allclose(angular, np.tile(angular[0], (len(angular), 1)), atol=2e-6)
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=1e-6)
    assert np.abs(q).max() > 0.01


def test_flexible_slider_crank_tends_to_the_rigid_one():
    """A rod of few modes, stiffened: the slider's deviation falls as 1 over the stiffness."""
    from dataclasses import replace

    from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody

    # a planar elastic rod of three particles and one bending mode
    mass, x = np.array([0.3, 0.2, 0.3]), np.array([[0.05, 0.02, 0.01], [0.15, 0, 0.0], [0.3, 0, 0]])
    phi = np.array([[0.5, -0.2, 0.0], [1.2, 0.6, 0.0], [0.7, 0.9, 0.0]])[:, :, None]
    phi /= np.sqrt(np.einsum("k,kai->", mass, phi**2))
    fields = np.concatenate([np.ones((1, 3)), x.T, phi[:, :, 0].T])
    tip = np.concatenate([phi[2, :, 0], [0.0, 0.0, 2.0]])[:, None]
    rod = ReducedBody(
        gram=(fields * mass) @ fields.T,
        stiffness=np.array([1e4]),
        damping=np.array([[40.0]]),
        interfaces=(
            InterfaceFrame("root", np.zeros(3), np.eye(3), np.zeros((6, 1))),
            InterfaceFrame("tip", np.array([0.3, 0.0, 0.0]), np.eye(3), tip),
        ),
        frame="root",
        partition=np.eye(1),
        partition_names=("mode 1",),
    )
    deviations = []
    for factor in (1e2, 1e4, 1e6):
        stiff = replace(
            rod, stiffness=rod.stiffness * factor, damping=rod.damping * np.sqrt(factor)
        )
        scene, piston, j1 = slider_crank(stiff)
        j1.prescribe(lambda t: (30.0 * t**2, 60.0 * t, 60.0))
        run = scene.simulate(0.3, rtol=1e-8, integrator=fm.GeneralizedAlpha())
        x = run.position(piston.frame())[:, 0]
        deviations.append(np.abs(x - slider_position(run.beta(j1)))[len(x) // 2 :].max())
    ratios = np.array(deviations[:-1]) / deviations[1:]
    assert deviations[0] > 1e-6
    np.testing.assert_allclose(ratios, 100.0, rtol=0.1)


def test_fixed_step_that_cannot_converge_stops_and_keeps_the_past():
    scene, _, _ = loaded_slider_crank()
    with pytest.raises(fm.SimulationError, match=r"stopped at t = .*fixed step.*smaller h") as caught:
        scene.simulate(30.0, h=1.0, rtol=1e-9, integrator=fm.GeneralizedAlpha())
    assert caught.value.trajectory.t[0] == 0.0
