"""Explicit central differences: the discrete oscillator's closed form, its limit, orders, loops, tolerance."""

from __future__ import annotations

import numpy as np
import pytest
from classic_machines import euler_top, heavy_top, loaded_slider_crank, rods_double_pendulum
from machines import CRANK, slider_position
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import SceneError

METHOD = fm.CentralDifference()


def oscillator(rate, *, damping=0.0):
    """A mass of 2 kg on a spring, let go at 1 m."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.JointSpring(slide, 2.0 * rate**2, 0.0, damping))
    slide.position = 1.0
    return scene, slide


def test_an_oscillator_moves_as_the_difference_equation_does():
    """x_n = cos(n W), cos W = 1 - (w h)^2 / 2: the solution of x_n+1 - 2 x_n + x_n-1 = -(w h)^2 x_n."""
    scene, slide = oscillator(5.0)
    h = 0.2 * 1.3
    run = scene.simulate(400 * h, h=h, integrator=METHOD)
    turn = np.arccos(1.0 - 0.5 * (5.0 * h) ** 2)
    np.testing.assert_allclose(run.beta(slide), np.cos(turn * np.arange(401)), atol=1e-10)


@pytest.mark.parametrize(("share", "holds"), [(0.99, True), (1.01, False)])
def test_the_limit_is_two_over_the_fastest_rate(share, holds):
    """BENCHMARKS F10."""
    scene, slide = oscillator(50.0)
    h = share * 2.0 / 50.0
    if not holds:
        with pytest.raises(SceneError, match=r"beyond the stability .* Take h = 0\.04 s at most"):
            scene.simulate(200 * h, h=h, integrator=METHOD)
        return
    run = scene.simulate(200 * h, h=h, integrator=METHOD)
    # below the limit the amplitude is bounded by 1 / sin W of the difference equation
    assert np.abs(run.beta(slide)).max() < 1.0 / np.sqrt(1.0 - share**4) + 1.0


def observed_orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize("closed", [False, True])
def test_order_on_a_top(closed):
    """Attitude, spin and, as a free body in a loop, the force at its tip."""
    spin = (2.0, 12.0, -4.0)
    q, w, force = euler_top(0.5, spin)
    scene, _ = heavy_top(closed=closed, spin=spin)
    errors = []
    for n in (200, 400, 800):
        run = scene.simulate(0.5, h=0.5 / n, integrator=METHOD)
        found = [np.abs(run.x[-1, -4:] - q).max(), np.abs(run.v[-1, -3:] - w).max()]
        if closed:
            found.append(np.abs(run.multipliers[-1] + force).max())
            assert run.stats.constraint_residual < 1e-12
        errors.append(found)
    orders = observed_orders(errors)
    assert orders[-1].min() > 1.9, (errors, orders)


def test_order_of_a_flexible_body():
    """Modal coordinates, their rates and the joint's, against a method of order 8."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(particle_body(3, modes=4, damping=0.5).record))
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    fine = scene.simulate(0.5, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    errors = []
    for n in (250, 500, 1000):
        run = scene.simulate(0.5, h=0.5 / n, integrator=METHOD)
        errors.append([np.abs(run.x[-1] - fine.x[-1]).max(), np.abs(run.v[-1] - fine.v[-1]).max()])
    orders = observed_orders(errors)
    assert orders[-1].min() > 1.9, (errors, orders)


def test_energy_of_a_double_pendulum_does_not_wander():
    """20 s of a chaotic motion: the energy stays within what a step of this size makes of it."""
    scene, _ = rods_double_pendulum((0.0, 0.0))
    ranges = []
    for h in (2e-3, 1e-3):
        energy = scene.simulate(20.0, h=h, integrator=METHOD).energy().total
        ranges.append(np.ptp(energy))
        late, early = np.ptp(energy[len(energy) // 2 :]), np.ptp(energy[: len(energy) // 2])
        assert late < 3.0 * early
    assert ranges[1] < 0.4 * ranges[0]


def test_energy_of_a_spinning_top_does_not_drift():
    """20 s of a motion of gyroscopic forces: with the velocity of the step's end in them the energy returns each turn.

    With the velocity predicted there it rises by 5e-5 in this time.
    """
    scene, _ = heavy_top(spin=(2.0, 12.0, -4.0))
    run = scene.simulate(20.0, h=1e-3, integrator=METHOD)
    energy = run.energy().total / run.energy().kinetic.max()
    early, late = energy[run.t < 2.0], energy[run.t > 18.0]
    assert abs(late.mean() - early.mean()) < 1e-6


def test_loops_stay_closed():
    scene, piston, j1 = loaded_slider_crank()
    run = scene.simulate(0.2, rtol=1e-4, integrator=METHOD)
    x = run.position(piston.frame())
    assert np.abs(x[:, 0] - slider_position(run.beta(j1))).max() < 1e-13 * 2.0 * CRANK * 10.0
    assert np.abs(x[:, 1:]).max() < 1e-13


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-5])
def test_a_top_keeps_its_tolerance(rtol):
    """Some 7 rad of rotation, each with rtol."""
    spin = (2.0, 12.0, -4.0)
    q, w, _ = euler_top(0.5, spin)
    scene, _ = heavy_top(spin=spin)
    run = scene.simulate(0.5, rtol=rtol, integrator=METHOD)
    assert np.abs(run.x[-1] - q).max() < 7.0 * rtol
    assert np.abs(run.v[-1] - w).max() < 7.0 * rtol * 13.0
    assert run.stats.steps < 1200.0 * np.sqrt(1e-3 / rtol)


@fm.compiled
def hardening(t, beta, rate):
    return -1e7 * (1.0 + 50.0 * t) * beta - 0.1 * rate


def test_the_limit_is_followed():
    """A spring that hardens fifty-fold, of a mass at rest, while another one flies."""
    scene, slide = oscillator(1.0)
    heavy = scene.add(fm.RigidBody(1e3, (1.0, 1.0, 1.0)), name="heavy")
    other = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), heavy.frame())
    scene.add_force(fm.force.JointLaw(slide, hardening))
    other.velocity, slide.position = 1.0, 0.0  # m/s, m
    run = scene.simulate(0.5, rtol=1e-2, integrator=METHOD)
    limit = 2.0 / np.sqrt(1e7 * (1.0 + 50.0 * run.t) / 2.0)
    steps = np.diff(run.t)
    late = (run.t[:-1] > 0.1) & (run.t[1:] < 0.499)  # before, it changes by half within some twenty steps
    assert (steps[late] < limit[:-1][late]).all()
    assert np.median(steps[late] / limit[:-1][late]) > 0.8
    assert run.stats.rejected < 10


def test_the_limit_of_a_flexible_body():
    """Steps at a loose tolerance are those that the fastest vibration allows, by the linear machine's eigenvalues."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(particle_body(3, modes=4, damping=0.01).record))
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    fastest = np.abs(scene.linearize().eigenvalues()).max()
    hinge.velocity = 1e-3
    run = scene.simulate(20.0, rtol=1e-2, integrator=METHOD)
    assert 0.8 < np.median(np.diff(run.t)) * fastest / 2.0 < 0.95


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-5])
def test_vibrations_are_measured_by_their_own_radians(rtol):
    """A flexible pendulum to its tolerance, in steps that its vibrations ask for, not their velocities' errors."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(particle_body(3, modes=4, damping=0.5).record))
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    fine = scene.simulate(0.5, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    run = scene.simulate(0.5, rtol=rtol, integrator=METHOD)
    assert np.abs(run.x[-1] - fine.x[-1]).max() < rtol
    assert run.stats.steps < 2.0 * np.sqrt(1.0 / rtol)


def test_error_control_keeps_below_the_limit():
    """A spring too fast for the tolerance to see its amplitude holds the step at its limit, not the run up."""
    scene, slide = oscillator(1e3, damping=100.0)
    run = scene.simulate(0.5, rtol=1e-2, integrator=METHOD)
    assert np.abs(run.beta(slide)).max() <= 1.01


def test_a_step_beyond_the_limit_tells():
    scene, _ = oscillator(1e3)
    with pytest.raises(SceneError, match=r"the step h = 0\.05 s is beyond the stability .* Take h = 0\.002 s at most"):
        scene.simulate(20.0, h=0.05, integrator=METHOD)
