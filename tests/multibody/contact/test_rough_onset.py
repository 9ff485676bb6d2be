"""Rough contacts that begin while they slide, that turn as they slide, on point masses; what is pressed in too deep."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import RangeWarning, SceneError

MASS, RADIUS, INERTIA, SPEED = 0.17, 0.0286, 5.562e-5, 2.0
ROLLS = SPEED / (1.0 + INERTIA / (MASS * RADIUS**2))  # m/s
METHODS = {
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy": fm.EnergyMomentum(),
    "explicit": fm.ExplicitRungeKutta(),
    "explicit 8": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
}


def dropped(*, mu=0.2, size=1.0):
    """A billiard ball that falls by two centimetres with 2 m/s sideways, where its weight dents the floor by 1 um."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81 * size))
    mass = MASS * size**3
    ball = scene.add(fm.RigidBody(mass, (INERTIA * size**5,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.0, 0.0, (RADIUS + 0.02) * size, 1.0, 0.0, 0.0, 0.0)
    free.velocity = (SPEED * size, 0.0, 0.0, 0.0, 0.0, 0.0)
    load = 1.7 * size**4
    law = contact.PowerLaw.bearing(load, depth=1e-6 * size, restitution=0.5, speed=0.3 * size)
    k = load / (1e-6 * size)
    rough = contact.Friction(mu, stiffness=k, damping=0.1 * np.sqrt(k * mass), load=load)
    floor = contact.HalfSpace(scene.ground.frame())
    pair = scene.touch(floor, contact.Sphere(ball.frame(), RADIUS * size), law, friction=rough if mu > 0.0 else None)
    return scene, ball, pair


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_that_is_dropped_sliding_rolls_away_in_no_more_steps_than_without_friction(method):
    for rtol in (1e-3, 1e-5, 1e-7, 1e-9) if method not in ("alpha", "energy") else (1e-3, 1e-4, 1e-5):
        runs = []
        for mu in (0.0, 0.2):
            scene, ball, _ = dropped(mu=mu)
            runs.append(scene.simulate(0.5, rtol=rtol, integrator=METHODS[method]))
        smooth, rough = runs
        assert len(rough.t) < 1.5 * len(smooth.t) + 100
        vx = rough.velocity(ball.frame())[-1, 0]
        assert vx == pytest.approx(ROLLS, rel=1e-4 if rtol > 1e-5 or method == "energy" else 1e-9)
        if rtol < 1e-6:
            energy = rough.energy().total
            assert np.diff(energy).max() < 1e-10 * energy[0]  # friction makes none
            assert rough.position(ball.frame())[-1, 0] == pytest.approx(0.8015009, rel=2e-7)  # all methods alike


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_it_does_so_at_all_sizes(size):
    scene, ball, _ = dropped(size=size)
    run = scene.simulate(0.5, rtol=1e-5)
    assert run.velocity(ball.frame())[-1, 0] / size == pytest.approx(ROLLS, rel=1e-9)
    assert run.position(ball.frame())[-1, 0] / size == pytest.approx(0.8015009, rel=1e-5)


@pytest.mark.parametrize("h", [1e-3, 2e-4, 1e-4])
@pytest.mark.parametrize("method", ["radau", "alpha"])
def test_fixed_steps_meet_a_floor_sliding(method, h):
    """Each collision takes a millisecond: a step as long may miss how fast it leaves, and not that it ends rolling."""
    scene, ball, _ = dropped()
    run = scene.simulate(0.5, h=h, integrator=METHODS[method])
    assert np.isfinite(run.x).all()
    if h < 1e-3:
        assert run.velocity(ball.frame())[-1, 0] == pytest.approx(ROLLS, rel=1e-8)
        assert run.position(ball.frame())[-1, 0] == pytest.approx(0.8015009, rel=1e-5)


@pytest.mark.parametrize("method", ["radau", "explicit 8"])
def test_the_error_falls_with_the_tolerance_where_the_sliding_turns(method):
    """A ball that spins aside falls onto the floor and its bristle, a soft one, is turned as it slides."""
    ends = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.RigidBody(1.0, (4e-3, 4e-3, 4e-3)), name="ball")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position, free.velocity = (0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0), (0.3, 0.1, 0.0, 1.0, 5.0, 2.0)
        rough = contact.Friction(0.3, stiffness=1e5, damping=50.0, load=10.0)
        floor = contact.HalfSpace(scene.ground.frame())
        law = contact.PowerLaw(k=1e5, restitution=0.6)
        scene.touch(floor, contact.Sphere(body.frame(), 0.1), law, friction=rough)
        run = scene.simulate(0.5, rtol=rtol, integrator=METHODS[method])
        ends.append(run.position(body.frame())[-1])
    errors = [np.linalg.norm(end - ends[-1]) for end in ends[:-1]]
    assert errors[0] < 1e-4
    assert errors[2] < 1e-6


def test_what_is_nearly_as_much_as_holds_it_does_not_make_it_creep():
    """Pushed to and fro between 0.2 and 0.95 of what it takes to slide, five hundred times."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    rough = contact.Friction(0.5, stiffness=1e7, damping=2e3, load=10.0)
    pressed = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, 1e-6)))
    scene.touch(pressed, contact.Vertex(body.frame()), contact.PowerLaw(k=1e7), friction=rough)
    push = fm.compiled(lambda t: 5.0 * (0.575 + 0.375 * np.sin(2.0 * np.pi * 50.0 * t)) * min(1.0, 10.0 * t))
    scene.add_force(fm.force.JointForce(slide, push))
    run = scene.simulate(10.0, rtol=1e-6)
    x = run.beta(slide, t=np.array([0.5, 1.0, 5.0, 10.0]))
    assert np.ptp(x) < 1e-3 * 5.0 / 1e7


@pytest.mark.parametrize("touches", [lambda frame: contact.Sphere(frame, 0.02), contact.Vertex])
def test_a_point_mass_slides_until_it_stops(touches):
    """After v^2 / (2 mu g): it has no spin to take up."""
    mu, g, v, load, depth = 0.3, 9.81, 1.0, 0.5 * 9.81, 1e-6
    scene = fm.System(gravity=(0.0, 0.0, -g))
    point = scene.add(fm.PointMass(0.5), name="point")
    shape = touches(point.frame())
    fly = scene.connect(fm.joint.Translation(), scene.ground.frame(), point.frame())
    fly.position = (0.0, 0.0, (0.0 if isinstance(shape, contact.Vertex) else shape.radius) - depth)
    fly.velocity = (v, 0.0, 0.0)
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.5, speed=1e-3)
    k = load / depth
    rough = contact.Friction(mu, stiffness=k, damping=0.1 * np.sqrt(0.5 * k), load=load)
    scene.touch(contact.HalfSpace(scene.ground.frame()), shape, law, friction=rough)
    run = scene.simulate(0.6, rtol=1e-7)
    assert run.position(point.frame())[-1, 0] == pytest.approx(v**2 / (2.0 * mu * g), rel=1e-5)
    assert abs(run.velocity(point.frame())[-1, 0]) < 1e-9


def test_point_masses_that_are_spheres_bounce_off_each_other():
    scene = fm.System()
    points = [scene.add(fm.PointMass(1.0), name=name) for name in "ab"]
    for x, speed, point in zip((0.0, 0.1), (1.0, 0.0), points, strict=True):
        fly = scene.connect(fm.joint.Translation(), scene.ground.frame(), point.frame())
        fly.position, fly.velocity = (x, 0.0, 0.0), (speed, 0.0, 0.0)
    scene.touch(*(contact.Sphere(point.frame(), 0.02) for point in points), contact.Hertz(E=2.1e11, restitution=0.6))
    run = scene.simulate(0.2, rtol=1e-8)
    assert [run.velocity(point.frame())[-1, 0] for point in points] == pytest.approx([0.2, 0.8], abs=1e-5)


@pytest.mark.parametrize("make", [lambda f: contact.Box(f, (1.0, 1.0, 1.0)), lambda f: contact.Capsule(f, 0.1, 0.2)])
def test_what_turns_with_its_frame_is_not_on_a_point_mass(make):
    scene = fm.System()
    point = scene.add(fm.PointMass(1.0), name="p")
    floor = contact.HalfSpace(scene.ground.frame())
    with pytest.raises(SceneError, match="point mass 'p' has no orientation"):
        scene.touch(floor, make(point.frame()), contact.PowerLaw(k=1.0))
    with pytest.raises(SceneError, match="a HalfSpace turns with its frame: point mass 'p'"):
        scene.touch(contact.HalfSpace(point.frame()), contact.Vertex(scene.ground.frame()), contact.PowerLaw(k=1.0))


@pytest.mark.parametrize(("k", "told"), [(1e4, True), (1e8, False)])
def test_a_law_too_soft_for_a_thin_box_is_told(k, told, recwarn):
    scene = fm.System()
    ball = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position, free.velocity = (0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -20.0, 0.0, 0.0, 0.0)
    box = contact.Box(scene.ground.frame(), (1.0, 1.0, 0.01))
    scene.touch(box, contact.Sphere(ball.frame(), 0.02), contact.PowerLaw(k=k))
    run = scene.simulate(0.1)
    assert (run.position(ball.frame())[-1, 2] < 0.0) == told
    found = [one for one in recwarn if issubclass(one.category, RangeWarning)]
    assert [("the law is too soft" in str(one.message)) for one in found] == [True] * told


def test_what_does_not_touch_leaves_a_steady_motion_and_an_equilibrium_as_they_are():
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    rotor = scene.add(fm.RigidBody(1.0, (1e-2, 1e-2, 2e-2)), name="rotor")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rotor.frame())
    mass = scene.add(fm.RigidBody(1.0, (1e-2, 1e-2, 1e-2)), name="mass")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), mass.frame())
    scene.add_force(fm.force.JointSpring(slide, stiffness=100.0, damping=1.0))
    floor = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -1.0)))
    rough = contact.Friction(0.3, stiffness=1e6, damping=50.0, load=10.0)
    spheres = [contact.Sphere(body.frame(p=(0.1, 0.0, 0.0)), 0.05) for body in (rotor, mass)]
    scene.touch(floor, spheres, contact.PowerLaw(k=1e6), friction=rough)
    assert scene.equilibrium().position(mass.frame())[2] == pytest.approx(-0.1, rel=1e-9)
    turn.velocity, slide.position = 10.0, -0.1
    swings = scene.linearize().eigenvalues()
    assert np.sort_complex(swings[np.abs(swings) > 1.0]) == pytest.approx(-0.5 + np.array([-1j, 1j]) * np.sqrt(99.75))
