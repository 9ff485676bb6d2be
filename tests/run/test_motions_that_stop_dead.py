"""Prescribed motions whose rate jumps: the impulse, in which all of the machine takes part."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly
from spring_interior import ExplicitSprings, as_continuum, chain

import flexmbd as fm

SPEED, STOP = 0.5, 0.4
BOB, ARM, INERTIA = 0.7, 0.4, 0.03
RAMP_THEN_HELD = {
    "table": fm.Table([0.0, STOP], [0.0, SPEED * STOP]),
    "data": PPoly([[SPEED, 0.0], [0.0, SPEED * STOP]], [0.0, STOP, 9.0]),
    "python": fm.Piecewise(lambda t: (SPEED * min(t, STOP), SPEED if t <= STOP else 0.0, 0.0), breaks=[STOP]),
}
METHODS = [fm.RadauIIA(), fm.GeneralizedAlpha(), fm.ExplicitRungeKutta(), fm.EnergyMomentum()]


def cart_and_bob(motion, *, way=fm.Way.COORDINATES, angle=0.4):
    """A driven cart with a bob on a hinge, at ``angle`` below the x axis."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    cart = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name="cart")
    bob = scene.add(fm.RigidBody(BOB, (0.01, INERTIA, INERTIA), (ARM, 0.0, 0.0)), name="bob")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), way=way, name="slide")
    slide.prescribe(motion)
    hinge = scene.connect(fm.joint.Revolute("y"), cart.frame(), bob.frame(), name="hinge")
    hinge.position = angle
    return scene, hinge, cart


def around(run, hinge):
    """The hinge's angle at the stop, its rate there and just after it."""
    row = int(np.searchsorted(run.t, STOP))
    assert run.t[row] == STOP
    after = run.t[row] + 1e-9
    return run.beta(hinge)[row], run.beta_rate(hinge)[row], run.beta_rate(hinge, t=[after])[0]


@pytest.mark.parametrize("motion", RAMP_THEN_HELD)
@pytest.mark.parametrize("way", fm.Way)
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_cart_that_stops_dead_throws_its_bob(method, way, motion):
    """Angular momentum about the hinge: (I + m c^2) dw = m c sin(angle) dv."""
    scene, hinge, cart = cart_and_bob(RAMP_THEN_HELD[motion], way=way)
    run = scene.simulate(2 * STOP, rtol=1e-6, integrator=method)
    angle, before, after = around(run, hinge)
    thrown = -BOB * ARM * np.sin(angle) * SPEED / (INERTIA + BOB * ARM**2)
    assert abs(thrown) > 0.1
    assert after - before == pytest.approx(thrown, rel=1e-6)
    assert np.abs(run.velocity(cart.frame())[-1]).max() < 1e-9


@pytest.mark.parametrize("way", fm.Way)
def test_a_motion_that_sets_out_at_once_and_fixed_steps(way):
    """A table held before its first point; the break lies within a step."""
    scene, hinge, _ = cart_and_bob(fm.Table([STOP, 1.0], [0.0, SPEED * (1.0 - STOP)]), way=way)
    run = scene.simulate(2 * STOP, h=0.03, integrator=fm.RadauIIA())
    angle, before, after = around(run, hinge)
    assert after - before == pytest.approx(
        BOB * ARM * np.sin(angle) * SPEED / (INERTIA + BOB * ARM**2), rel=1e-6
    )


def test_loops_take_part():
    """A crank that stops within a time goes to one that stops dead as that time goes to nothing; a bob on its rod."""

    speed, begin, end = 8.0, 0.1, 0.3 + 0.8
    stops_dead = PPoly([[speed, 0.0], [0.3, end]], [0.0, begin, 9.0])

    def braked(time):
        deceleration = speed / time
        pieces = [[0.0, -0.5 * deceleration, 0.0], [speed, speed, 0.0], [0.3, end, end + 0.5 * speed * time]]
        return PPoly(pieces, [0.0, begin, begin + time, 9.0])

    def state(motion):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        turn = fm.joint.Revolute("z")
        parts = [scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.02), (0.1, 0.0, 0.0))) for _ in range(4)]
        crank, rod, slider, bob = parts
        scene.connect(turn, scene.ground.frame(), crank.frame()).prescribe(motion)
        scene.connect(turn, crank.frame((0.1, 0, 0)), rod.frame())
        scene.connect(turn, rod.frame((0.4, 0, 0)), slider.frame())
        scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame())
        hinge = scene.connect(turn, rod.frame((0.2, 0.05, 0)), bob.frame())
        scene.add_force(fm.force.JointSpring(hinge, 50.0, 0.0))
        run = scene.simulate(0.2, rtol=1e-9, integrator=fm.RadauIIA())
        return np.array([run.beta(hinge)[-1], run.beta_rate(hinge)[-1]])

    dead = state(stops_dead)
    far, near = (np.abs(state(braked(time)) - dead) for time in (1e-4, 1e-5))
    assert (near < 0.15 * far).all()
    assert near.max() < 1e-3


@pytest.mark.parametrize("way", fm.Way)
def test_a_motion_that_leaps_is_refused(way):
    scene, _, _ = cart_and_bob(PPoly([[0.0, 0.1]], [0.0, STOP, 9.0]), way=way)
    with pytest.raises(fm.SimulationError, match=r"slide.* jumps by .*1\.000e-01 .* at t = 0\.4 s") as caught:
        scene.simulate(2 * STOP)
    assert caught.value.trajectory.t[-1] == STOP


def test_bodies_with_history_take_no_impulse():
    scene = fm.System()
    _, (a, _) = as_continuum(scene, chain(ExplicitSprings, stiffness=2e3))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), a)
    slide.prescribe(fm.Table([0.0, 1e-3], [0.0, 1e-3]))
    with pytest.raises(fm.SimulationError, match="bodies with history take no impulse"):
        scene.simulate(2e-3)
