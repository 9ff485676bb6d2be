"""Linear machines whose coordinates differ by many orders of magnitude: nothing is measured by what is beside it."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError

G = 9.81


def pendulum_on_a_slider(mass, length, stiffness, *, carriage=1.0, unit=1.0):
    """A bob under a slider that a spring holds, and a wheel that turns freely; lengths in ``unit`` (m)."""
    scene = fm.System(gravity=(0.0, 0.0, -G * unit))
    slider = scene.add(fm.RigidBody(carriage, (0.1 * unit**2,) * 3), name="slider")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, stiffness))
    inertia = np.full(3, mass * (length * unit) ** 2 * 0.1)
    bob = scene.add(fm.RigidBody(mass, inertia, com=(0, 0, -length * unit)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), slider.frame(), bob.frame(), name="hinge")
    wheel = scene.add(fm.RigidBody(carriage, (0.1 * unit**2,) * 3), name="wheel")
    scene.connect(fm.joint.Revolute("y"), slider.frame(p=(unit, 0, 0)), wheel.frame(), name="axle")
    return scene, hinge


@pytest.mark.parametrize(
    ("mass", "length", "stiffness"),
    [(1e-3, 1e-2, k) for k in (1e3, 1e6, 1e9, 1e10, 1e12)] + [(1.0, 1.0, 1e15), (1e-18, 1e-7, 1e6), (1e-9, 1e-3, 1e6)],
)
def test_a_pendulum_swings_whatever_holds_its_slider(mass, length, stiffness):
    """The eigenvalues of ((M + m, m l), (m l, 1.1 m l^2)) and (k, m g l), by the formula of a quadratic equation.

    M with the wheel. The product and the sum of the two squares are free of cancellation.
    """
    scene, _ = pendulum_on_a_slider(mass, length, stiffness)
    linear = scene.linearize(about=scene.equilibrium())
    whole, pull = 2.0 + mass, mass * length
    a = whole * 1.1 * mass * length**2 - pull**2
    b = stiffness * 1.1 * mass * length**2 + whole * pull * G
    fast = (b + np.sqrt(b * b - 4.0 * a * stiffness * pull * G)) / (2.0 * a)
    squares = np.sort([fast, stiffness * pull * G / (a * fast)])
    np.testing.assert_allclose(linear.frequencies(), np.sqrt(squares) / (2.0 * np.pi), rtol=1e-7)
    np.testing.assert_array_equal(linear.eigenvalues()[:2], 0.0)  # the wheel's
    turns = linear.coordinates.index("axle.angle")
    np.testing.assert_array_equal(linear.K[turns], 0.0)
    np.testing.assert_array_equal(linear.K[:, turns], 0.0)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_the_unit_of_length_does_not_matter(unit):
    scene, _ = pendulum_on_a_slider(1e-3, 1e-2, 1e9, unit=unit)
    found = scene.linearize(about=scene.equilibrium()).frequencies()
    assert found[0] == pytest.approx(np.sqrt(G / (1.1 * 1e-2)) / 2 / np.pi, rel=1e-6)


def test_a_slow_mode_is_drawn_beside_a_fast_one():
    scene, hinge = pendulum_on_a_slider(1.0, 1.0, 1e15)
    linear = scene.linearize()
    swing = int(np.flatnonzero(linear.eigenvalues().imag > 0.0)[0])
    run = linear.mode_motion(swing, amplitude=0.1)
    assert np.abs(run.beta(hinge)).max() == pytest.approx(0.1, rel=1e-6)


def test_a_light_part_out_of_balance_is_told_beside_a_heavy_one():
    scene, hinge = pendulum_on_a_slider(1e-6, 1e-2, 1e9, carriage=1e6)
    scene.linearize()
    hinge.position = 0.1
    with pytest.raises(SceneError, match=r"the motion is not steady: at 'hinge\.angle' a force of"):
        scene.linearize()


@pytest.mark.parametrize("damping", [0.0, 1e-6])
@pytest.mark.parametrize(("axis", "free"), [("y", False), ("y", True), ("z", False)])
def test_a_hinged_blade_with_and_without_a_damper(axis, free, damping):
    """Southwell: flap sqrt((I - small + e m c) / I) omega, lag sqrt(e m c / I) omega; a free hub moves with the lag."""
    omega, offset, mass, arm, small = 30.0, 0.2, 2.0, 0.5, 1e-4
    about_hinge = 0.1 + mass * arm**2
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    blade = scene.add(fm.RigidBody(mass, (small, 0.1, 0.1), (arm, 0, 0)), name="blade")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame(), name="turn")
    hinge = scene.connect(fm.joint.Revolute(axis), hub.frame(p=(offset, 0, 0)), blade.frame(), name="hinge")
    if free:
        turn.velocity = omega
    else:
        turn.prescribe(lambda t: (omega * t, omega, 0.0))
    if damping:
        scene.add_force(fm.force.JointDamper(hinge, damping))
    moment = offset * mass * arm + (about_hinge - small if axis == "y" else 0.0)
    found = scene.linearize().frequencies()
    np.testing.assert_allclose(found, [omega * np.sqrt(moment / about_hinge) / (2.0 * np.pi)], rtol=1e-9)


@pytest.mark.parametrize("stiffness", [1e3, 1e15])
def test_a_pendulum_that_turns_through_its_weight_is_not_steady(stiffness):
    """On a hub that turns about a level axis the weight's direction changes, whatever spring stands beside it."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    block = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, stiffness))
    hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    turn = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), hub.frame(), name="turn")
    turn.prescribe(lambda t: (np.pi / 2 + 0.5 * t, 0.5, 0.0))
    blade = scene.add(fm.RigidBody(1e-3, (1e-9, 1e-7, 1e-7), (0.01, 0, 0)), name="blade")
    scene.connect(fm.joint.Revolute("z"), hub.frame(p=(0.1, 0, 0)), blade.frame(), name="hinge")
    with pytest.raises(SceneError, match=r"the motion is not steady: along it the stiffness of 'hinge\.angle' changes"):
        scene.linearize()


def test_a_rotor_whose_angle_is_a_table():
    """Its acceleration is round-off of the spline; the blade's flap is that of a constant speed."""
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
    blade = scene.add(fm.RigidBody(2.0, (1e-4, 0.1, 0.1), (0.5, 0, 0)), name="blade")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), hub.frame(), name="turn")
    t = np.linspace(0.0, 1.0, 7)
    turn.prescribe(fm.Table(t, 30.0 * t, beyond=fm.Beyond.LINEAR))
    scene.connect(fm.joint.Revolute("y"), hub.frame(p=(0.2, 0, 0)), blade.frame(), name="hinge")
    expected = 30.0 * np.sqrt((0.6 - 1e-4 + 0.2) / 0.6) / (2.0 * np.pi)
    np.testing.assert_allclose(scene.linearize(t=0.4).frequencies(), [expected], rtol=1e-9)
    turn.prescribe(fm.Table(t, 30.0 * t + 0.1 * t**2))
    with pytest.raises(SceneError, match=r"prescribed with an acceleration of 0\.2"):
        scene.linearize(t=0.4)


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e5])
def test_laws_of_the_users_bend_within_the_machines_own_size(length):
    """f = -k s sinh(x / s) - c u tanh(v / u), s and u a tenth of the machine's size and speed: k and c at rest."""
    mass, k = 3.0, 50.0
    c = 0.02 * np.sqrt(k * mass)
    s, u = 0.1 * length, 0.1 * length * np.sqrt(k / mass)
    law = lambda t, x, v: -k * s * np.sinh(x / s) - c * u * np.tanh(v / u)  # noqa: E731
    scene = fm.System()
    slider = scene.add(fm.RigidBody(mass, np.full(3, 0.5 * mass * length**2)), name="slider")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="slide")
    scene.add_force(fm.force.JointLaw(slide, law))
    value = scene.linearize().eigenvalues()[0]
    exact = -0.5 * c / mass + 1j * np.sqrt(k / mass - (0.5 * c / mass) ** 2)
    assert value.real == pytest.approx(exact.real, rel=1e-6)
    assert abs(value.imag) == pytest.approx(exact.imag, rel=1e-6)
