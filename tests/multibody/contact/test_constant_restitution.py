"""Impacts that leave the same share of every speed."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

METHODS = {"radau": fm.RadauIIA(), "alpha": fm.GeneralizedAlpha(), "explicit": fm.ExplicitRungeKutta()}
LAWS = {
    "Hertz": lambda e: contact.Hertz(E=2.1e11, restitution=e, speed=None),
    "spring": lambda e: contact.PowerLaw(k=1e6, restitution=e, speed=None),
}


def leaves(e, speed, *, law, method):
    """The share of its speed with which a ball leaves a fixed one that it meets head-on."""
    scene = fm.System()
    ball = scene.add(fm.RigidBody(0.1, (1e-5,) * 3), name="ball")
    slide = scene.connect(fm.joint.Translation(), scene.ground.frame(), ball.frame())
    slide.position, slide.velocity = (0.02 + 1e-3, 0.0, 0.0), (-speed, 0.0, 0.0)
    fixed = contact.Sphere(scene.ground.frame(), 0.01)
    scene.touch(fixed, contact.Sphere(ball.frame(), 0.01), LAWS[law](e))
    run = scene.simulate(3e-3 / speed / e + 2e-2, rtol=1e-6, integrator=METHODS[method])
    return run.velocity(ball.frame())[-1, 0] / speed


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("e", [0.1, 0.7, 0.95])
def test_an_impact_leaves_its_share_of_every_speed(law, method, e):
    for speed in (0.01, 1.0, 10.0):
        assert leaves(e, speed, law=law, method=method) == pytest.approx(e, abs=1e-4)


def bouncing(e, *, friction=None, speed=0.0, k=1e6):
    """A ball that falls by 0.1 m."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(0.1, (0.4 * 0.1 * 0.02**2,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.0, 0.0, 0.02 + 0.1, 1.0, 0.0, 0.0, 0.0)
    free.velocity = (speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    law = contact.PowerLaw(k=k, restitution=e, speed=None)
    scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(ball.frame(), 0.02), law, friction=friction)
    return scene, ball


def test_each_bounce_is_as_high_as_the_square_of_the_restitution_says():
    e, fall = 0.6, np.sqrt(2.0 * 0.1 / 9.81)
    scene, ball = bouncing(e, k=1e11)
    low, t = fall, []
    for k in range(1, 4):
        t.append(low + e**k * fall)
        low += 2.0 * e**k * fall
    run = scene.simulate(low, rtol=1e-8)
    heights = run.position(ball.frame(), t=np.array(t))[:, 2] - 0.02
    assert heights == pytest.approx(0.1 * e ** (2.0 * np.arange(1, 4)), rel=1e-3)  # an impact takes 3 us


@pytest.mark.parametrize("rolling", [0.0, 1e-4])
def test_what_bounces_comes_to_rest(rolling):
    rough = contact.Friction(0.4, stiffness=1e6, damping=60.0, load=1.0, rolling=rolling) if rolling else None
    scene, ball = bouncing(0.5, friction=rough, speed=0.05 if rolling else 0.0)
    run = scene.simulate(3.0, rtol=1e-6, integrator=fm.RadauIIA())
    z = run.position(ball.frame())[-1, 2] - 0.02
    assert z == pytest.approx(-0.1 * 9.81 / 1e6, rel=1e-3)
    assert np.linalg.norm(run.velocity(ball.frame())[-1]) < 1e-7


def test_two_balls_part_at_their_share_whatever_their_masses():
    scene = fm.System()
    balls = []
    for name, m, x, v in (("a", 0.3, -0.03, 2.0), ("b", 0.1, 0.03, -0.7)):
        ball = scene.add(fm.RigidBody(m, (1e-4,) * 3), name=name)
        slide = scene.connect(fm.joint.Translation(), scene.ground.frame(), ball.frame())
        slide.position, slide.velocity = (x, 0.0, 0.0), (v, 0.0, 0.0)
        balls.append(ball)
    law = contact.Hertz(E=2.1e11, restitution=0.4, speed=None)
    scene.touch(*(contact.Sphere(ball.frame(), 0.02) for ball in balls), law)
    run = scene.simulate(0.05, rtol=1e-7)
    a, b = (run.velocity(ball.frame())[-1, 0] for ball in balls)
    assert b - a == pytest.approx(0.4 * 2.7, rel=1e-4)
    assert 0.3 * a + 0.1 * b == pytest.approx(0.3 * 2.0 - 0.1 * 0.7, rel=1e-9)


@pytest.mark.parametrize("rough", [False, True])
def test_what_is_pressed_in_at_the_start_has_met_nothing(rough):
    friction = contact.Friction(0.4, stiffness=1e6, damping=60.0, load=1.0) if rough else None
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(0.1, (1e-5,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.0, 0.0, 0.02 - 1e-6, 1.0, 0.0, 0.0, 0.0)
    law = contact.PowerLaw(k=1e6, restitution=0.5, speed=None)
    scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(ball.frame(), 0.02), law, friction=friction)
    with pytest.raises(SceneError, match="begin apart, or give the law a speed"):
        scene.simulate(0.1)


def test_a_run_is_stepped_through_contact_as_it_is_run():
    scene, ball = bouncing(0.5)
    whole = scene.simulate(0.5, h=1e-4, integrator=fm.RadauIIA())
    parts = scene.stepper(h=1e-4, integrator=fm.RadauIIA())
    for _ in range(1000):
        parts.step(5e-4)
    assert whole.position(ball.frame())[-1, 2] == pytest.approx(parts.now.position(ball.frame())[2], rel=1e-9)
