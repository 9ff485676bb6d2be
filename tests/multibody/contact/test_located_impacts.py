"""Hard contacts by error control: impacts located as events, to rtol, against closed forms; what has no end."""

from __future__ import annotations

import numpy as np
import pytest
from hard_scenes import G, bouncing_ball, four_bar, times_of_bounces
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

METHODS = [fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.GeneralizedAlpha(), fm.EnergyMomentum()]


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
def test_times_of_bounces_are_met_to_rtol(method):
    """A fall of constant acceleration: what is left is the error of the method."""
    e = 0.7
    scene, _, pair = bouncing_ball(contact.Hard(restitution=e))
    times = times_of_bounces(5, e=e)
    run = scene.simulate(times[-1] + 0.01, rtol=1e-8, integrator=method)
    assert [one.name for one in run.events] == [pair.what] * 5
    assert [one.t for one in run.events] == pytest.approx(times, rel=1e-6)
    met = run.contacts([pair])[0]
    fall = G * times[0]
    hits = np.flatnonzero(met.impulse[:, 2])
    assert met.impulse[hits, 2] == pytest.approx(fall * (1.0 + e) * e ** np.arange(5), rel=1e-6)
    assert run.t[hits] == pytest.approx(run.t[hits - 1], abs=0.0)
    assert np.abs(met.force).max() == 0.0
    energy = run.energy().total
    assert energy[-1] - energy[0] == pytest.approx(met.normal_work[-1], rel=1e-6)
    assert met.gap.min() > -1e-9


def test_errors_fall_with_rtol_in_motion_that_is_not_a_parabola():
    """A mass on a spring at whose rest a stop stands: it comes back after half a swing, always."""
    errors = []
    omega = 3.0
    for rtol in (1e-4, 1e-7, 1e-10):
        scene = fm.System()
        block = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.01)), name="block")
        slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame())
        slide.position = 1.0
        scene.add_force(fm.force.JointSpring(slide, 2.0 * omega**2))
        wall = contact.HalfSpace(scene.ground.frame(p=(-0.1, 0.0, 0.0)), normal="x")
        scene.touch(wall, contact.Sphere(block.frame(), 0.1), contact.Hard(restitution=1.0))
        run = scene.simulate(10.0, rtol=rtol, integrator=fm.ExplicitRungeKutta())
        hits = np.array([one.t for one in run.events])
        exact = np.pi / omega * (np.arange(len(hits)) + 0.5)
        assert len(hits) == 10
        errors.append(np.abs(hits - exact).max())
    assert errors[0] < 1e-2
    assert errors[1] < 1e-2 * errors[0]
    assert errors[2] < 1e-2 * errors[1]


@pytest.mark.parametrize("backwards", [False, True])
def test_a_four_bar_with_a_stop_turns_back(backwards):
    scene, pair = four_bar(contact.Hard(restitution=0.4, mu=0.0), backwards=backwards)
    run = scene.simulate(1.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    (hit,) = run.events
    assert hit.t == pytest.approx(np.deg2rad(40.0), rel=1e-8)
    speed = 0.5 * np.array([np.sin(np.deg2rad(30.0)), -np.cos(np.deg2rad(30.0)), 0.0])
    before, after = run.velocity(pair.frame_G)[[hit.row, hit.row + 1]]
    assert before == pytest.approx(speed, rel=1e-8, abs=1e-12)
    assert after == pytest.approx(-0.4 * speed, rel=1e-8, abs=1e-12)
    assert run.stats.constraint_residual < 1e-7


def bounces_on_a_table(amplitude, omega, *, e, height, t_end):
    """Times of impacts of a point that falls on a table at amplitude cos(omega t): parabolas, and roots between."""
    begin, z, v, found = 0.0, height, 0.0, []
    while True:
        fine = np.linspace(0.0, t_end - begin, 200001)[1:]
        gap = z + v * fine - 0.5 * G * fine**2 - amplitude * np.cos(omega * (begin + fine))
        under = np.flatnonzero(gap < 0.0)
        if not len(under):
            return np.array(found)
        k = under[0]

        def apart(s, begin=begin, z=z, v=v):
            return z + v * s - 0.5 * G * s**2 - amplitude * np.cos(omega * (begin + s))

        flight = brentq(apart, fine[k - 1], fine[k], xtol=1e-15)
        begin, speed = begin + flight, v - G * flight
        table = -amplitude * omega * np.sin(omega * begin)
        z, v = amplitude * np.cos(omega * begin), table + e * (table - speed)
        found.append(begin)


def test_a_ball_bounces_on_a_table_that_shakes():
    """Against parabolas between impacts: located to rtol, by fixed steps within some steps."""
    amplitude, omega, e = 0.02, 20.0, 0.8
    exact = bounces_on_a_table(amplitude, omega, e=e, height=0.2, t_end=1.2)
    assert len(exact) >= 3
    for settings, error in (({"rtol": 1e-9, "integrator": fm.ExplicitRungeKutta()}, 1e-7), ({"h": 1e-4}, 2e-3)):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        table = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="table")
        lift = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), table.frame())
        lift.prescribe(fm.Sine(amplitude, omega, phase=np.pi / 2))
        ball = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.01)), name="ball")
        drop = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
        drop.position = 0.3
        law = contact.Hard(restitution=e)
        (pair,) = scene.touch(contact.HalfSpace(table.frame()), contact.Sphere(ball.frame(), 0.1), law)
        run = scene.simulate(1.2, **settings)
        met = run.contacts(pair)[0]
        assert run.t[np.flatnonzero(met.impulse[:, 2])] == pytest.approx(exact, abs=error)


def test_balls_that_meet_at_one_instant_share_the_blow():
    """One between two walls' worth of balls: two contacts at once are solved together, as by fixed steps."""
    ends = []
    for settings in ({"rtol": 1e-9, "integrator": fm.ExplicitRungeKutta()}, {"h": 1e-3}):
        scene = fm.System()
        balls = []
        for k, speed in enumerate((1.0, 0.0, -1.0)):
            body = scene.add(fm.RigidBody(1.0 + (k == 1), (4e-3,) * 3), name=f"ball {k}")
            slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
            slide.position, slide.velocity = 0.3 * (k - 1.0), speed
            balls.append(contact.Sphere(body.frame(), 0.1))
        for k in range(2):
            scene.touch(balls[k], balls[k + 1], contact.Hard(restitution=0.5))
        run = scene.simulate(0.5, **settings)
        ends.append(run.v[-1])
    assert ends[0] == pytest.approx([-0.5, 0.0, 0.5], abs=1e-9)
    assert ends[1] == pytest.approx(ends[0], abs=1e-5)


def test_friction_acts_in_impacts():
    """A ball that strikes sliding: mu times the normal impulse, or what makes it roll, 2/7 of its slip."""
    for mu, share in ((0.03, None), (0.9, 2.0 / 7.0)):
        scene, drop, pair = bouncing_ball(contact.Hard(restitution=0.5, mu=mu))
        drop.velocity = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        run = scene.simulate(0.4, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
        impulse = run.contacts([pair])[0].impulse.sum(axis=0)
        normal = 1.5 * np.sqrt(2.0 * G * 0.5)
        friction = mu * normal if share is None else share * 1.0
        assert impulse == pytest.approx([-friction, 0.0, normal], rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_what_comes_to_rest_ends_by_name(e):
    """Impacts accumulate at t0 (1 + e) / (1 - e): the run ends there, with the contact, the time and a remedy."""
    scene, _, pair = bouncing_ball(contact.Hard(restitution=e))
    with pytest.raises(SimulationError, match=r"hard contact of sphere.*MoreauJean") as caught:
        scene.simulate(5.0, rtol=1e-8, integrator=fm.ExplicitRungeKutta())
    run = caught.value.trajectory
    assert run.t[-1] == pytest.approx(np.sqrt(1.0 / G) * (1.0 + e) / (1.0 - e), rel=1e-5)
    assert run.contacts([pair])[0].gap.min() > -1e-8


def test_a_restart_between_impacts_goes_on_to_the_bit():
    scene, *_ = bouncing_ball(contact.Hard(restitution=0.8))
    whole = scene.simulate(1.5, rtol=1e-7, integrator=fm.ExplicitRungeKutta(), checkpoints=[0.7])
    rest = scene.simulate(1.5, rtol=1e-7, integrator=fm.ExplicitRungeKutta(), restart=whole.checkpoints[0])
    assert np.array_equal(whole.x[-1], rest.x[-1])
    assert np.array_equal(whole.v[-1], rest.v[-1])
    assert [one.t for one in rest.events] == [one.t for one in whole.events if one.t > 0.7]


def test_variants_that_run_again_meet_the_floor_too():
    scene, drop, _ = bouncing_ball(contact.Hard(restitution=0.8))
    machine = scene.compile(parameters={"place": fm.parameter.InitialPosition(drop)})
    for height in (0.3, 0.4, 0.5):
        place = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
        run = machine.simulate(0.6, rtol=1e-8, integrator=fm.ExplicitRungeKutta(), place=place)
        assert run.events[0].t == pytest.approx(np.sqrt(2.0 * (height - 0.1) / G), rel=1e-7)
        assert run.x[:, 2].min() > 0.1 - 1e-9


def test_events_of_a_user_stand_beside_impacts():
    scene, drop, pair = bouncing_ball(contact.Hard(restitution=1.0))
    top = fm.Event(lambda m: m.beta_rate(drop)[2], direction=fm.Direction.FALLING, name="top")
    run = scene.simulate(1.2, rtol=1e-9, integrator=fm.ExplicitRungeKutta(), events=[top])
    fall = np.sqrt(1.0 / G)
    told = [(one.name, one.t) for one in run.events]
    assert [name for name, _ in told] == ["top", pair.what, "top", pair.what]
    assert [t for _, t in told] == pytest.approx([0.0, fall, 2.0 * fall, 3.0 * fall], rel=1e-7, abs=1e-12)


def test_what_impacts_as_events_do_not_know_is_refused_by_name():
    def begins(height, speed=0.0):
        scene, drop, _ = bouncing_ball(contact.Hard(restitution=0.5), height=height)
        drop.velocity = (0.0, 0.0, speed, 0.0, 0.0, 0.0)
        return scene

    ways = {"integrator": fm.ExplicitRungeKutta()}
    with pytest.raises(SceneError, match=r"overlaps by 0\.01 m"):
        begins(-0.01).simulate(0.1, **ways)
    for speed in (0.0, -1.0):
        with pytest.raises(SceneError, match=r"touches at t = 0 s and does not part.*MoreauJean"):
            begins(0.0, speed).simulate(0.1, **ways)
    assert len(begins(0.0, 1.0).simulate(0.3, **ways).events) == 1
    with pytest.raises(SceneError, match="MoreauJean"):
        begins(0.1).simulate(0.1, h=1e-3, **ways)
    scene = begins(0.1)
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="body")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame()).position = (3.0, 0, 0, 1, 0, 0, 0)
    ends = [contact.Sphere(body.frame(p=(x, 0.0, 0.0)), 0.1) for x in (-0.5, 0.5)]
    scene.touch(ends, contact.Sphere(scene.ground.frame(), 0.1), contact.Hard())
    with pytest.raises(SceneError, match="MoreauJean"):
        scene.simulate(0.1, **ways)


def test_reactions_and_drives_are_known_between_impacts():
    """A pendulum that strikes a wall where it hangs: N = m g + m v^2 / L just before."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    bob = scene.add(fm.RigidBody(2.0, (1e-9, 1e-9, 1e-9)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame(p=(0.0, 1.0, 0.0)))
    hinge.position = 0.5
    wall = contact.HalfSpace(scene.ground.frame(p=(-0.1, 0.0, 0.0)), normal="x")
    scene.touch(wall, contact.Sphere(bob.frame(), 0.1), contact.Hard(restitution=0.5))
    run = scene.simulate(1.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    hit = run.events[0].row
    assert run.reaction(hinge)[hit, 1] == pytest.approx(2.0 * G * (1.0 + 2.0 * (1.0 - np.cos(0.5))), rel=1e-6)


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("radius", [0.02, 0.002])
@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_an_arm_does_not_pass_through_a_peg(method, radius, rtol):
    """Its tip turns on a circle of 1 m at 3 rad/s and comes back from a peg whose middle it would cross."""
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    hinge.position, hinge.velocity = 0.0, 3.0
    peg = contact.Sphere(scene.ground.frame(p=(np.cos(1.5), np.sin(1.5), 0.0)), radius)
    scene.touch(peg, contact.Vertex(arm.frame(p=(1.0, 0.0, 0.0))), contact.Hard(restitution=1.0))
    run = scene.simulate(0.9, rtol=rtol, integrator=method)
    (hit,) = run.events
    assert 3.0 * hit.t == pytest.approx(1.5 - 2.0 * np.arcsin(0.5 * radius), abs=10.0 * rtol)
    assert run.beta_rate(hinge)[-1] == pytest.approx(-3.0, rel=1e-6)
