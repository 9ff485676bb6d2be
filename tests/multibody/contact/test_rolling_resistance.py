"""Balls that rolling and spinning resistance slow and hold, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

MASS, RADIUS, G = 0.17, 0.0286, 9.81
INERTIA = 0.4 * MASS * RADIUS**2
METHODS = {
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "explicit": fm.ExplicitRungeKutta(),
}


def placed(*, rolling=0.0, spinning=0.0, mu=0.5, slope=0.0, velocity=(0.0,) * 6, size=1.0, turned=(1.0, 0.0, 0.0, 0.0)):
    """A solid ball pressed by its weight, on a plane that falls along x by an angle; velocity: of its centre, spin."""
    mass, radius, depth = MASS * size**3, RADIUS * size, 1e-6 * size
    scene = fm.System(gravity=tuple(G * size * np.array([np.sin(slope), 0.0, -np.cos(slope)])))
    ball = scene.add(fm.RigidBody(mass, (INERTIA * size**5,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    load = mass * G * size * np.cos(slope)
    free.position = (0.0, 0.0, radius - depth, *turned)
    free.velocity = velocity
    k = load / depth
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.5, speed=1e-3 * size)
    rough = contact.Friction(
        mu, stiffness=k, damping=0.3 * np.sqrt(k * mass), load=load, rolling=rolling * size, spinning=spinning * size
    )
    floor, sphere = contact.HalfSpace(scene.ground.frame()), contact.Sphere(ball.frame(), radius)
    pair = scene.touch(floor, sphere, law, friction=rough)
    return scene, ball, pair


@pytest.mark.parametrize("method", METHODS)
def test_a_rolling_ball_is_slowed_by_five_sevenths_of_the_arm_over_the_radius_and_stops(method):
    f, v = 2e-3, 0.3
    a = 5.0 / 7.0 * f * G / RADIUS
    scene, ball, _ = placed(rolling=f, velocity=(v, 0.0, 0.0, 0.0, v / RADIUS, 0.0))
    run = scene.simulate(1.0, rtol=1e-6 if method != "alpha" else 1e-5, integrator=METHODS[method])
    t = np.array([0.2, 0.4])
    assert run.velocity(ball.frame(), t=t)[:, 0] == pytest.approx(v - a * t, rel=2e-4)
    assert run.position(ball.frame())[-1, 0] == pytest.approx(v**2 / (2.0 * a), rel=5e-4)
    assert abs(run.velocity(ball.frame())[-1, 0]) < 1e-6 * v


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_at_all_sizes(size):
    f, v = 2e-3, 0.3
    a = 5.0 / 7.0 * f * G / RADIUS
    scene, ball, _ = placed(rolling=f, velocity=(v * size, 0.0, 0.0, 0.0, v / RADIUS, 0.0), size=size)
    run = scene.simulate(1.0, rtol=1e-6)
    assert run.position(ball.frame())[-1, 0] / size == pytest.approx(v**2 / (2.0 * a), rel=5e-4)


def test_a_spinning_ball_stops_where_the_moment_has_taken_its_spin():
    f, w = 1e-3, 30.0
    alpha = f * MASS * G / INERTIA
    scene, ball, _ = placed(spinning=f, velocity=(0.0, 0.0, 0.0, 0.0, 0.0, w))
    run = scene.simulate(1.5 * w / alpha, rtol=1e-6)
    t = 0.5 * w / alpha
    assert run.angular_velocity(ball.frame(), t=np.array([t]))[0, 2] == pytest.approx(0.5 * w, rel=1e-4)
    assert abs(run.angular_velocity(ball.frame())[-1, 2]) < 1e-6 * w
    assert np.linalg.norm(run.position(ball.frame())[-1, :2]) < 1e-9
    assert np.diff(run.energy().total).max() < 1e-9 * run.energy().total[0]  # it makes none


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_on_an_incline_it_rests_up_to_the_arm_over_the_radius(share):
    """Held where tan(slope) < f / R; beyond that it rolls at 5/7 g (sin - f / R cos)."""
    f = 2e-3
    slope = np.arctan(share * f / RADIUS)
    scene, ball, _ = placed(rolling=f, slope=slope)
    run = scene.simulate(2.0, rtol=1e-6)
    t = np.array([1.0, 2.0])
    x, vx = run.position(ball.frame(), t=t)[:, 0], run.velocity(ball.frame(), t=t)[:, 0]
    if share < 1.0:
        assert abs(x[1] - x[0]) < 1e-9 * RADIUS
        assert abs(x[1]) < 1e-4 * RADIUS
    else:
        a = 5.0 / 7.0 * G * (np.sin(slope) - f / RADIUS * np.cos(slope))
        assert vx[1] - vx[0] == pytest.approx(a, rel=1e-6)


def test_rolling_is_resisted_alike_in_all_directions_and_frames():
    """The ball's axes lie anywhere: its spin is given in them."""
    f, v, spin = 2e-3, 0.3, 5.0
    places = []
    for angle in (0.0, 0.7, 2.5):
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        turn = Rotation.from_rotvec([0.3, -0.2 * angle, angle])
        w = turn.inv().apply([-v / RADIUS * along[1], v / RADIUS * along[0], spin])
        q = np.roll(turn.as_quat(), 1)
        scene, ball, _ = placed(rolling=f, spinning=f, velocity=(*(v * along), *w), turned=tuple(q))
        run = scene.simulate(0.6, rtol=1e-7)
        end = run.position(ball.frame())[-1]
        places.append((along @ end, np.cross(along, end)[2]))
        assert np.diff(run.energy().total).max() < 1e-9 * run.energy().total[0]
    assert places[0][0] == pytest.approx(v**2 / (2.0 * 5.0 / 7.0 * f * G / RADIUS), rel=5e-4)
    assert np.array(places[1:]) == pytest.approx(np.array([places[0]] * 2), abs=1e-5 * v)


def test_a_point_neither_rolls_nor_spins():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0,) * 3), name="b")
    rough = contact.Friction(0.3, stiffness=1e5, damping=10.0, load=10.0, rolling=1e-3)
    with pytest.raises(SceneError, match="a point neither rolls nor spins"):
        scene.touch(
            contact.HalfSpace(scene.ground.frame()), contact.Vertex(body.frame()), contact.PowerLaw(k=1e5),
            friction=rough,
        )  # fmt: skip


def test_arms_are_not_negative():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0,) * 3), name="b")
    rough = contact.Friction(0.3, stiffness=1e5, damping=10.0, load=10.0, spinning=-1e-3)
    with pytest.raises(SceneError, match="spinning"):
        scene.touch(
            contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), 0.1), contact.PowerLaw(k=1e5),
            friction=rough,
        )  # fmt: skip
