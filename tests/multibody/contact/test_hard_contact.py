"""Hard contacts by Moreau's and Jean's method against closed forms: impacts, rest, friction, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

G = 9.81


def scene_of(gravity=(0.0, 0.0, -G)):
    scene = fm.System(gravity=gravity)
    return scene, contact.HalfSpace(scene.ground.frame())


def free_body(scene, name, mass, inertia, place, velocity=(0.0,) * 6, turn=(1.0, 0.0, 0.0, 0.0)):
    body = scene.add(fm.RigidBody(mass, inertia), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, *turn), velocity
    return body


def ball(scene, name, radius, place, velocity=(0.0,) * 6, mass=1.0):
    inertia = 0.4 * mass * radius**2
    return free_body(scene, name, mass, (inertia,) * 3, place, velocity)


def box(scene, name, sides, place, velocity=(0.0,) * 6, density=1000.0, turn=(1.0, 0.0, 0.0, 0.0)):
    mass = density * np.prod(sides)
    squares = np.square(sides)
    return free_body(scene, name, mass, tuple(mass / 12.0 * (squares.sum() - squares)), place, velocity, turn)


@pytest.mark.parametrize("size", [1.0, 1000.0])
def test_a_bouncing_ball_comes_to_rest_after_a_geometric_series_of_impacts(size):
    """Times of fall 2 v e^k / g; errors of first order in h; at rest it stays at rest, pressed by its weight."""
    e, height = 0.6, 0.5 * size
    errors = []
    unit = np.sqrt(size)
    for h in (2e-3 * unit, 1e-3 * unit):
        scene, floor = scene_of()
        body = ball(scene, "ball", 0.1 * size, (0.0, 0.0, 0.1 * size + height))
        pair = scene.touch(floor, contact.Sphere(body.frame(), 0.1 * size), contact.Hard(restitution=e))
        run = scene.simulate(2.5 * unit, h=h)
        met = run.contacts(pair)[0]
        first = np.sqrt(2.0 * height / G)
        times = first + np.concatenate([[0.0], 2.0 * first * np.cumsum(e ** np.arange(1.0, 4.0))])
        hits = run.t[1:][(np.diff(met.normal_force > 0.0) & (met.normal_force[1:] > 0.0))][:4]
        errors.append(np.abs(hits - times).max() / unit)
        assert met.normal_force[-1] == pytest.approx(G, rel=1e-9)
        assert np.abs(run.v[-200:]).max() < 1e-12 * np.sqrt(G * size)
        assert abs(met.gap[-1]) < 1e-12 * size
        assert met.gap.min() > -1e-12 * size - 0.5 * h * np.sqrt(2.0 * G * height)
        lost = met.normal_work[-1] + met.friction_work[-1]
        energy = run.energy().total
        assert energy[-1] - energy[0] == pytest.approx(lost, rel=1e-3)
        assert (np.diff(energy) < 1e-9 * energy[0]).all()
    assert errors[0] < 2.0 * 2e-3 / (1.0 - e)
    assert errors[1] < 0.8 * errors[0]


def test_an_elastic_ball_keeps_its_energy():
    scene, floor = scene_of()
    body = ball(scene, "ball", 0.1, (0.0, 0.0, 0.6))
    scene.touch(floor, contact.Sphere(body.frame(), 0.1), contact.Hard(restitution=1.0))
    energy = scene.simulate(5.0, h=1e-3).energy().total
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-11


@pytest.mark.parametrize("size", [1e-2, 10.0])
@pytest.mark.parametrize("mu", [0.3, 0.9])
def test_a_block_on_an_incline_sticks_or_slides(size, mu):
    """Below atan(mu) it sticks without creep, above it slides with g (sin a - mu cos a): on its four corners."""
    a = np.deg2rad(30.0)
    scene, floor = scene_of((G * np.sin(a), 0.0, -G * np.cos(a)))
    block = box(scene, "block", (size, size, 0.5 * size), (0.0, 0.0, 0.25 * size))
    pair = scene.touch(floor, contact.Box(block.frame(), (size, size, 0.5 * size)), contact.Hard(mu=mu))
    unit = np.sqrt(size)
    run = scene.simulate(0.5 * unit, h=1e-2 * unit)
    speed = max(0.0, np.sin(a) - mu * np.cos(a)) * G * 0.5 * unit
    assert run.velocity(block.frame())[-1] == pytest.approx([speed, 0.0, 0.0], abs=1e-6 * G * unit)
    assert run.position(block.frame())[-1, 0] == pytest.approx(0.25 * speed * unit, rel=1e-2, abs=1e-7 * size)
    force = sum(met.force[-1] for met in run.contacts(pair))
    mass = 500.0 * size**3
    assert force / (mass * G) == pytest.approx(
        [-min(np.sin(a), mu * np.cos(a)), 0.0, np.cos(a)], abs=1e-6
    )


def test_a_billiard_ball_ends_rolling_at_five_sevenths():
    scene, floor = scene_of()
    body = ball(scene, "ball", 0.0286, (0.0, 0.0, 0.0286), (2.0, 0.0, 0.0, 0.0, 0.0, 0.0), mass=0.17)
    pair = scene.touch(floor, contact.Sphere(body.frame(), 0.0286), contact.Hard(mu=0.2))
    run = scene.simulate(0.6, h=1e-3)
    met = run.contacts(pair)[0]
    assert run.velocity(body.frame())[-1, 0] == pytest.approx(10.0 / 7.0, rel=1e-7)
    assert np.abs(met.slip[-1]).max() < 1e-7
    assert met.friction_work[-1] == pytest.approx(-0.5 * 0.17 * 4.0 * 2.0 / 7.0, rel=1e-6)
    rolls = run.t[np.argmax(np.linalg.norm(met.slip, axis=1) < 1e-7)]
    assert rolls == pytest.approx(2.0 * 2.0 / (7.0 * 0.2 * G), abs=2e-3)


@pytest.mark.parametrize(("gap", "after"), [(0.05, [0.0, 0.0, 0.0, 1.0]), (0.0, [-0.5, 0.5, 0.5, 0.5])])
def test_a_cradle_apart_passes_the_blow_on_and_together_shares_it(gap, after):
    """Newton's law at each contact by itself: of balls that touch, none is left behind by the one before it."""
    scene, _ = scene_of((0.0, 0.0, 0.0))
    speeds = [(1.0 if k == 0 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(4)]
    balls = [ball(scene, f"ball {k}", 0.1, (k * (0.2 + gap), 0.0, 0.0), speeds[k]) for k in range(4)]
    shapes = [contact.Sphere(one.frame(), 0.1) for one in balls]
    scene.touch(shapes, shapes, contact.Hard(restitution=1.0))
    run = scene.simulate(0.5, h=1e-3, rtol=1e-9)
    assert [run.velocity(one.frame())[-1, 0] for one in balls] == pytest.approx(after, abs=1e-6)


def test_spheres_that_meet_keep_their_momenta():
    """Linear and angular momentum to round-off, with friction, off centre, and spinning."""
    scene, _ = scene_of((0.0, 0.0, 0.0))
    a = ball(scene, "a", 0.1, (-0.3, 0.05, 0.02), (2.0, 0.0, 0.1, 3.0, -2.0, 5.0), mass=1.3)
    b = ball(scene, "b", 0.15, (0.2, 0.0, 0.0), (-1.0, 0.3, 0.0, 0.0, 4.0, -1.0), mass=0.7)
    law = contact.Hard(restitution=0.4, mu=0.5)
    pair = scene.touch(contact.Sphere(a.frame(), 0.1), contact.Sphere(b.frame(), 0.15), law)
    run = scene.simulate(0.3, h=1e-3)
    momentum = run.momentum()
    assert np.linalg.norm(run.contacts(pair)[0].force, axis=1).max() > 0.0
    for part in (momentum.linear, momentum.angular):
        assert np.abs(part - part[0]).max() < 1e-13 * np.abs(part[0]).max()


def test_pendulum_against_a_wall_by_the_mass_of_its_tree():
    """A rod of two hinges strikes a wall with its end: the end's normal speed is reversed, the rest follows M."""
    scene, _ = scene_of()
    rods = [scene.add(fm.RigidBody(1.0, (1e-3, 1.0 / 12.0, 1.0 / 12.0)), name=f"rod {k}") for k in range(2)]
    left, right = ((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    first = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rods[0].frame(p=left))
    second = scene.connect(fm.joint.Revolute("y"), rods[0].frame(p=right), rods[1].frame(p=left))
    first.position, second.position = 0.3, 0.2
    floor = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -1.2)))
    tip = rods[1].frame(p=right)
    pair = scene.touch(floor, contact.Vertex(tip), contact.Hard(restitution=0.5, mu=0.3))
    run = scene.simulate(1.0, h=2.5e-4)
    met = run.contacts(pair)[0]
    hit = int(np.argmax(met.normal_force > 0.0))
    assert hit > 0
    before, after = run.velocity(tip)[[hit - 1, hit]]
    assert after[2] == pytest.approx(-0.5 * before[2], rel=2e-3)
    assert met.gap.min() > -2e-3
    impulse = met.force[hit] * 2.5e-4
    assert np.linalg.norm(impulse[:2]) <= 0.3 * impulse[2] * (1.0 + 1e-9)
    energy = run.energy().total
    works = met.normal_work + met.friction_work
    assert np.abs(energy - energy[0] - works).max() < 2e-2 * np.abs(works[-1])


@pytest.mark.parametrize("degrees", [45.0, 80.0])
def test_painleves_rod_is_refused_by_name_where_it_is_one(degrees):
    """A uniform rod that slides on its tip: mu beyond (1 + 3 cos^2 t) / (3 sin t cos t) has no right force."""
    angle = np.deg2rad(degrees)
    c, s = np.cos(angle), np.sin(angle)
    critical = (1.0 + 3.0 * c**2) / (3.0 * s * c)
    for share in (0.9, 1.1):
        scene, floor = scene_of()
        turn = (np.cos(0.5 * angle), 0.0, np.sin(0.5 * angle), 0.0)
        rod = free_body(scene, "rod", 1.0, (1e-4, 1 / 3, 1 / 3), (0.0, 0.0, s), (10.0, 0, 0, 0, 0, 0), turn)
        scene.touch(floor, contact.Vertex(rod.frame(p=(1.0, 0.0, 0.0))), contact.Hard(mu=share * critical))
        if share < 1.0:
            scene.simulate(5e-3, h=1e-3)
            continue
        with pytest.raises(SimulationError, match=rf"Painlev.*mu = {share * critical:.4g}"):
            scene.simulate(5e-3, h=1e-3)


def test_a_restart_goes_on_to_the_bit():
    scene, floor = scene_of()
    block = box(scene, "block", (0.3, 0.2, 0.1), (0.0, 0.0, 0.4), (1.0, 0.3, 0.0, 1.0, 2.0, 0.5))
    scene.touch(floor, contact.Box(block.frame(), (0.3, 0.2, 0.1)), contact.Hard(restitution=0.3, mu=0.4))
    whole = scene.simulate(1.0, h=1e-3, checkpoints=[0.4])
    rest = scene.simulate(1.0, h=1e-3, restart=whole.checkpoints[0])
    assert np.array_equal(whole.x[-1], rest.x[-1])
    assert np.array_equal(whole.v[-1], rest.v[-1])


def test_a_tumbling_box_comes_to_rest_on_a_face():
    """Dropped askew: it ends on a face, on redundant corners whose forces sum to its weight, and loses energy alone."""
    scene, floor = scene_of()
    sides = (0.3, 0.2, 0.1)
    turn = np.array([0.9, 0.2, 0.3, -0.1])
    block = box(scene, "block", sides, (0.0, 0.0, 0.5), turn=tuple(turn / np.linalg.norm(turn)))
    pair = scene.touch(floor, contact.Box(block.frame(), sides), contact.Hard(restitution=0.2, mu=0.5))
    run = scene.simulate(3.0, h=1e-3)
    height = run.position(block.frame())[-1, 2]
    assert min(abs(height - 0.5 * side) for side in sides) < 1e-9
    assert np.abs(run.v[-1]).max() < 1e-8
    force = sum(met.force[-1] for met in run.contacts(pair))
    assert force == pytest.approx([0.0, 0.0, 6.0 * G], abs=1e-5)
    energy = run.energy().total
    assert np.diff(energy).max() < 1e-4 * energy[0]


def test_free_bodies_spin_without_gain():
    """A body of three inertias about its middle axis: momentum to round-off, energy within h^2, however long."""
    swing = []
    for h in (4e-3, 2e-3):
        scene, floor = scene_of((0.0, 0.0, 0.0))
        body = free_body(scene, "body", 1.0, (0.01, 0.02, 0.025), (0.0, 0.0, 9.0), (0, 0, 0, 0.01, 10.0, 0.01))
        scene.touch(floor, contact.Vertex(body.frame()), contact.Hard())
        run = scene.simulate(20.0, h=h)
        energy, momentum = run.energy().kinetic, run.momentum().spin
        assert np.abs(momentum - momentum[0]).max() < 1e-11 * np.abs(momentum[0]).max()
        swing.append(np.abs(energy / energy[0] - 1.0))
        half = len(energy) // 2
        assert swing[-1][half:].max() < 1.01 * swing[-1][:half].max()
    assert swing[0].max() / swing[1].max() == pytest.approx(4.0, rel=0.1)


def test_what_does_not_go_is_refused_by_name():
    scene, floor = scene_of()
    body = scene.add(fm.RigidBody(1.0, (4e-3, 4e-3, 4e-3)), name="ball")
    joint = scene.connect(fm.joint.Translation(), scene.ground.frame(), body.frame())
    joint.position = (0.0, 0.0, 0.1)
    sphere = contact.Sphere(body.frame(), 0.1)
    with pytest.raises(SceneError, match="makes energy"):
        scene.touch(floor, sphere, contact.Hard(restitution=1.1))
    with pytest.raises(SceneError, match="mu"):
        scene.touch(floor, sphere, contact.Hard(mu=-0.1))
    with pytest.raises(SceneError, match="leave `friction` out"):
        scene.touch(floor, sphere, contact.Hard(), friction=contact.Friction(0.1, 1.0, 1.0, 1.0))
    scene.touch(floor, sphere, contact.Hard())
    for method in (fm.RadauIIA(), fm.GeneralizedAlpha(), fm.ExplicitRungeKutta(), fm.EnergyMomentum()):
        with pytest.raises(SceneError, match="MoreauJean"):
            scene.simulate(0.1, h=1e-3, integrator=method)
    with pytest.raises(SceneError, match="h=1e-3"):
        scene.simulate(0.1)
    with pytest.raises(SceneError, match="hard contacts"):
        scene.equilibrium()
    with pytest.raises(SceneError, match="hard contacts"):
        scene.linearize()
    assert "1 hard contact watched" in scene.explain(h=1e-3)


_FLAT = np.array([(-1.0, 0.1, -1.0), (1.0, 0.1, -1.0), (1.0, 0.1, 1.0), (-1.0, 0.1, 1.0)])


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("kind", ["profile", "triangles"])
def test_a_ball_rests_on_shapes_that_have_a_table(kind, size):
    """It falls on a flat one, where it bears its weight at the radius above the surface."""
    scene = fm.System(gravity=(0.0, -9.81 * size, 0.0))
    ball = scene.add(fm.RigidBody(2.0, (1e-3 * size**2,) * 3))
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.0, 0.2 * size, 0.0, 1.0, 0.0, 0.0, 0.0)
    ground = scene.ground.frame()
    if kind == "profile":
        shape = contact.Profile(ground, size * np.array([(-1.0, -0.1), (1.0, -0.1), (1.0, 0.1), (-1.0, 0.1)]))
    else:
        shape = contact.TriangleSurface(ground, size * _FLAT, [(0, 2, 1), (0, 3, 2)], open=True)
    pair = scene.touch(shape, contact.Sphere(ball.frame(), 0.05 * size), contact.Hard(mu=0.3))
    run = scene.simulate(1.0, h=1e-3)
    assert run.position(ball.frame())[-1] == pytest.approx([0.0, 0.15 * size, 0.0], abs=1e-9 * size)
    assert run.contacts(pair)[0].normal_force[-1] == pytest.approx(2.0 * 9.81 * size, rel=1e-9)


def test_a_contact_whose_normal_nothing_can_move_along_exerts_nothing():
    """A wheel that touches a wall with a point beside its axle, along which it cannot move: it goes on turning."""
    scene, _ = scene_of((0.0, 0.0, 0.0))
    turn = np.array([[0.8, 0.0, 0.6], [0.36, 0.8, -0.48], [-0.48, 0.6, 0.64]])
    wheel = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.2)), name="wheel")
    axle = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(R=turn), wheel.frame())
    axle.velocity = 3.0
    wall = contact.HalfSpace(scene.ground.frame(p=tuple(turn @ (0.0, 0.0, 0.1)), R=turn))
    pair = scene.touch(wall, contact.Vertex(wheel.frame(p=(0.3, 0.2, 0.1 - 1e-9))), contact.Hard(mu=0.3))
    run = scene.simulate(0.5, h=1e-2)
    assert run.beta_rate(axle) == pytest.approx(3.0, abs=1e-12)
    assert np.abs(run.contacts(pair)[0].force).max() == 0.0
