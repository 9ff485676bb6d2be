"""Friction that follows the joint's own reaction, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kane.bearing import friction_forces
from flexmbd.multibody.kane.force_response import ForceResponse
from flexmbd.multibody.kernels.base.native import lapack_addresses
from flexmbd.run.stopped import SimulationError

MU = 0.2
METHODS = {
    "radau": fm.RadauIIA(),
    "explicit": fm.ExplicitRungeKutta(),
    "alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
}


def sled(*, push=0.0, mu=MU, regularisation=1e-6, angle=0.0):
    """A block of 2 kg that slides along x, which is inclined by an angle, pressed across it by ``push`` (N)."""
    gravity = 9.81 * np.array([-np.sin(angle), -np.cos(angle), 0.0])
    scene = fm.System(gravity=tuple(gravity))
    block = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    if push:
        scene.add_force(fm.force.FrameForce(block.frame(), (0.0, 0.0, push)))
    scene.add_force(fm.force.BearingFriction(slide, mu, regularisation))
    return scene, slide


def pendulum(*, radius=0.05, mu=MU, regularisation=1e-3):
    """A bob of 1.5 kg at 0.8 m with an inertia of its own, on a pin; angle from the vertical."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(fm.RigidBody(1.5, (0.03, 0.03, 0.05), (0.0, -0.8, 0.0)), name="bob")
    pin = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame(), name="pin")
    scene.add_force(fm.force.BearingFriction(pin, mu, regularisation, radius))
    return scene, pin


def pendulum_motion(t, start, *, radius=0.05, mu=MU, regularisation=1e-3):
    """By hand: J a = -m g l sin(x) - mu r N tanh(w / w0), N of the bob's acceleration."""
    m, length, g = 1.5, 0.8, 9.81
    inertia = 0.05 + m * length**2

    def rates(_, state):
        x, w = state

        def torque(a):
            along = m * (length * w * w + g * np.cos(x))
            across = m * (length * a + g * np.sin(x))
            return -mu * radius * np.hypot(along, across) * np.tanh(w / regularisation)

        a = 0.0
        for _ in range(100):
            a = (-m * g * length * np.sin(x) + torque(a)) / inertia
        return [w, a]

    return solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-11, atol=1e-12, method="DOP853").y


@pytest.mark.parametrize("method", sorted(METHODS))
def test_a_block_under_a_cross_load(method):
    """Deceleration mu N / m, N = hypot(weight, cross load)."""
    scene, slide = sled(push=30.0)
    slide.velocity = 3.0
    run = scene.simulate(0.5, h=0.01, integrator=METHODS[method])
    deceleration = MU * np.hypot(2.0 * 9.81, 30.0) / 2.0
    np.testing.assert_allclose(run.beta_rate(slide), 3.0 - deceleration * run.t, atol=1e-9)
    np.testing.assert_allclose(run.beta(slide), 3.0 * run.t - 0.5 * deceleration * run.t**2, atol=1e-9)
    np.testing.assert_allclose(run.reaction(slide)[:, 0], -MU * np.hypot(2.0 * 9.81, 30.0), rtol=1e-9)
    assert np.abs(run.drive(slide)).max() < 1e-9  # friction is no drive


@pytest.mark.parametrize(("tangent", "slides"), [(0.15, False), (0.3, True)])
def test_a_block_on_an_incline(tangent, slides):
    """It slides where tan(angle) > mu, at g (sin - mu cos); else it creeps at most at the regularisation speed."""
    angle = np.arctan(tangent)
    scene, slide = sled(angle=angle, regularisation=1e-5)
    run = scene.simulate(1.0, rtol=1e-7)
    if slides:
        a = 9.81 * (np.sin(angle) - MU * np.cos(angle))
        assert run.beta_rate(slide)[-1] == pytest.approx(-a, abs=1e-4)
    else:
        assert abs(run.beta_rate(slide)[-1]) == pytest.approx(1e-5 * np.arctanh(tangent / MU), rel=1e-3)


@pytest.mark.parametrize("regularisation", [1e-2, 1e-4, 1e-6, 1e-7])
def test_a_finer_regularisation_asks_for_no_more_steps(regularisation):
    """The derivatives see the layer in which the friction changes its sign, however thin it is."""
    angle = np.arctan(0.15)
    scene, slide = sled(angle=angle, regularisation=regularisation)
    run = scene.simulate(1.0, rtol=1e-7, integrator=fm.RadauIIA(), max_steps=40)
    creep = -regularisation * np.arctanh(0.15 / MU)
    assert run.beta_rate(slide)[-1] == pytest.approx(creep, rel=1e-6)


@pytest.mark.parametrize("method", ["radau", "explicit"])
def test_the_bearing_of_a_pendulum(method):
    """Against equations by hand in which the pin's force and the acceleration are found together."""
    scene, pin = pendulum(regularisation=0.3)
    pin.position = 1.2
    run = scene.simulate(2.0, rtol=1e-8, integrator=METHODS[method])
    x, w = pendulum_motion(run.t, [1.2, 0.0], regularisation=0.3)
    np.testing.assert_allclose(run.beta(pin), x, atol=2e-7)
    np.testing.assert_allclose(run.beta_rate(pin), w, atol=1e-6)
    lost = -np.diff(run.energy().total[[0, -1]])
    assert lost > 0.5  # J, of about 7.5


def test_a_pin_with_two_frictions():
    """They add up: against the equations by hand with all of it."""
    scene, pin = pendulum(mu=0.25 * MU, regularisation=0.3)
    scene.add_force(fm.force.BearingFriction(pin, 0.75 * MU, 0.3, 0.05))
    pin.position = 1.2
    run = scene.simulate(2.0, rtol=1e-8, integrator=fm.ExplicitRungeKutta())
    x, _ = pendulum_motion(run.t, [1.2, 0.0], regularisation=0.3)
    np.testing.assert_allclose(run.beta(pin), x, atol=2e-7)


def test_the_order_is_the_method_s():
    """The friction is found anew at each stage, so that errors fall by 2^5 a halving, as without it."""
    errors = []
    for h in (0.04, 0.02):
        scene, pin = pendulum(regularisation=2.0, radius=0.2)
        pin.velocity = 6.0
        run = scene.simulate(0.4, h=h, integrator=fm.RadauIIA(), rtol=1e-12)
        x, _ = pendulum_motion(np.array([0.0, run.t[-1]]), [0.0, 6.0], regularisation=2.0, radius=0.2)
        errors.append(abs(run.beta(pin)[-1] - x[-1]))
    assert errors[0] < 1e-5
    assert 4.5 < np.log2(errors[0] / errors[1]) < 6.5


def test_two_bearings_know_of_each_other():
    """Two links of a double pendulum: torques are those of the reactions that the motion itself has."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    first = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.03), (0.0, -0.3, 0.0)), name="first")
    second = scene.add(fm.RigidBody(0.7, (0.02, 0.02, 0.03), (0.0, -0.2, 0.0)), name="second")
    pins = [
        scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), first.frame()),
        scene.connect(fm.joint.Revolute("z"), first.frame(p=(0.0, -0.6, 0.0)), second.frame()),
    ]
    pins[0].position, pins[1].velocity = 1.0, 4.0
    for pin in pins:
        scene.add_force(fm.force.BearingFriction(pin, 0.4, 0.5, 0.1))
    run = scene.simulate(0.6, rtol=1e-7, integrator=fm.ExplicitRungeKutta())  # whose accelerations are no iteration's
    for pin in pins:
        reaction = run.reaction(pin)
        normal = np.hypot(reaction[:, 0], reaction[:, 1])
        np.testing.assert_allclose(
            reaction[:, 5], -0.4 * 0.1 * normal * np.tanh(run.beta_rate(pin) / 0.5), atol=1e-9 * normal.max()
        )


def test_a_loop_of_a_slider_crank():
    """The guide's friction, by the guide's own reaction as the run tells it."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.4, (2e-4, 3e-4, 4e-4), (0.03, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(0.8, (3e-4, 7e-3, 7.2e-3), (0.14, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, (1e-4, 1e-4, 1e-4)), name="piston")
    turn = fm.joint.Revolute("z")
    main = scene.connect(turn, scene.ground.frame(), crank.frame())
    big = scene.connect(turn, crank.frame(p=(0.08, 0.0, 0.0)), rod.frame())
    guide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide")
    scene.connect(fm.joint.PointOnLine("z"), rod.frame(p=(0.3, 0.0, 0.0)), piston.frame(), name="small")
    main.position, main.velocity, big.position = 0.6, 20.0, -0.7
    scene.add_force(fm.force.BearingFriction(guide, 0.3, 0.2))
    run = scene.simulate(0.2, rtol=1e-7)
    reaction = run.reaction(guide)
    normal = np.hypot(reaction[:, 1], reaction[:, 2])
    assert normal.max() > 5.0
    friction = -0.3 * normal * np.tanh(run.beta_rate(guide) / 0.2)
    np.testing.assert_allclose(reaction[:, 0], friction, atol=1e-8 * normal.max())


def spatial_loop(unit):
    """A slider-crank whose rod swings out of the plane, between a ball and a cross; a metre is ``unit`` long here."""
    scene = fm.System(gravity=(0.0, -9.81 * unit, 0.0))
    crank, rod, piston = (
        scene.add(fm.RigidBody(mass, tuple(np.array(inertia) * unit**2), (place * unit, 0.0, 0.0)), name=name)
        for name, mass, inertia, place in (
            ("crank", 0.4, (2e-4, 3e-4, 4e-4), 0.03),
            ("rod", 0.8, (3e-4, 7e-3, 7.2e-3), 0.14),
            ("piston", 0.3, (1e-4, 1e-4, 1e-4), 0.0),
        )
    )
    main = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame(), name="main")
    scene.connect(fm.joint.Spherical(), crank.frame(p=(0.08 * unit, 0.0, 0.02 * unit)), rod.frame())
    guide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide")
    cross, end = fm.joint.Universal("y", "z"), rod.frame(p=(0.3 * unit, 0.0, 0.0))
    scene.connect(cross, end, piston.frame(), name="small", way=fm.Way.CONSTRAINTS)
    main.position, main.velocity = 0.6, 20.0
    scene.add_force(fm.force.BearingFriction(guide, 0.3, 0.2 * unit))
    scene.add_force(fm.force.BearingFriction(main, 0.3, 0.2, 0.02 * unit))
    return scene


@pytest.mark.parametrize("unit", [1e3, 2.0**20, 2.0**-20, 2.0**30])
def test_friction_does_not_depend_on_the_unit_of_length(unit):
    """Rows in metres and rows in radians of one loop, however small or large the numbers of the former are."""
    expected, found = (spatial_loop(one).start().a[0] for one in (1.0, unit))
    assert abs(expected) > 100.0
    assert found == pytest.approx(expected, rel=1e-11)


def test_a_joint_that_locks_is_named():
    """A stiff arm pushed at an angle against its guide: the more friction, the more it is pressed."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    carriage = scene.add(fm.RigidBody(0.1, (0.01, 0.01, 0.01)), name="carriage")
    arm = scene.add(fm.RigidBody(5.0, (1e-3, 1e-3, 1e-3), (0.3, 0.4, 0.0)), name="arm")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), carriage.frame(), name="slide")
    scene.connect(fm.joint.Revolute("z"), carriage.frame(), arm.frame(), name="hinge")
    slide.velocity = -1.0
    scene.add_force(fm.force.BearingFriction(slide, 3.0, 1e-3))
    with pytest.raises((SceneError, SimulationError), match="slide"):
        scene.simulate(1.0, rtol=1e-6)


def test_friction_that_would_grow_by_itself_is_none():
    """Two joints that press each other: what is found fulfils the law and falls back when it is disturbed."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(300):
        here, slopes, sliding = rng.normal(size=(2, 2)), rng.normal(size=(2, 2, 2)), rng.uniform(-1.5, 1.5, 2)

        def law(f, here=here, slopes=slopes, sliding=sliding):
            return -sliding * np.linalg.norm(here + np.tensordot(f, slopes, 1), axis=1)

        f = friction_forces(lapack_addresses(), sliding, here, slopes)
        if f is not None:
            found += 1
            np.testing.assert_allclose(law(f), f, atol=1e-11)
            step = 1e-6
            jacobian = np.array([(law(f + step * e) - law(f - step * e)) / (2.0 * step) for e in np.eye(2)]).T
            assert np.linalg.det(np.eye(2) - jacobian) > 0.0
    assert 100 < found < 300


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda s, slide, pin: fm.force.BearingFriction(pin, 0.1, 1e-3), "radius"),
        (lambda s, slide, pin: fm.force.BearingFriction(slide, 0.1, 1e-3, 0.1), "no pin"),
        (lambda s, slide, pin: fm.force.BearingFriction(slide, -0.1, 1e-3), "coefficient"),
        (lambda s, slide, pin: fm.force.BearingFriction(slide, 0.1, 0.0), "regularisation"),
    ],
)
def test_frictions_that_are_none(make, text):
    scene = fm.System()
    block, bob = (scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1))) for _ in range(2))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    pin = scene.connect(fm.joint.Revolute("x"), block.frame(), bob.frame(), name="pin")
    with pytest.raises(SceneError, match=text):
        scene.add_force(make(scene, slide, pin))


def test_other_joints_and_unknown_loads_are_refused():
    scene, _ = sled()
    ball = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="ball")
    joint = scene.connect(fm.joint.Spherical(), scene.ground.frame(), ball.frame(), name="ball joint")
    with pytest.raises(SceneError, match="Spherical has no bearing"):
        scene.add_force(fm.force.BearingFriction(joint, 0.1, 1e-3))
    scene.add_force(fm.force.KaneForce(lambda m: [], name="wind"))
    with pytest.raises(SceneError, match=r"'slide'.*KaneForce 'wind'"):
        scene.compile()


def test_where_nothing_slides_nothing_is_solved(monkeypatch):
    """An equilibrium asks for the friction at rest a hundred times for each of its steps."""
    scene, slide = sled(push=30.0, angle=0.1)
    scene.add_force(fm.force.JointSpring(slide, 100.0))
    asked, evaluate = [], ForceResponse.evaluate

    def counted(self, t, x, v, forces):
        asked.append(v)
        return evaluate(self, t, x, v, forces)

    monkeypatch.setattr(ForceResponse, "evaluate", counted)
    point = scene.equilibrium()
    assert point.beta(slide) == pytest.approx(-2.0 * 9.81 * np.sin(0.1) / 100.0, rel=1e-9)
    assert all(v.any() for v in asked)


def test_friction_beyond_numbers_is_one_error():
    scene, slide = sled(push=1e300, mu=1e300)
    slide.velocity = 1.0
    with pytest.raises(SceneError, match="the friction of joints at t = 0 s cannot be computed"):
        scene.simulate(0.1)
