"""Joints that are constraints alone, couplings, screws and universal joints against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import flexmbd as fm

BOTH = pytest.mark.parametrize("way", list(fm.Way), ids=["coordinates", "constraints"])
G = 9.81


@BOTH
def test_a_screw_falls_over_many_turns(way):
    """angle'' = -m g p / (I + m p^2) with g along the axis; 12 turns and more."""
    pitch, mass, inertia = 0.05, 2.0, 0.03
    scene = fm.System(gravity=(0.0, -G, 0.0))
    nut = scene.add(fm.RigidBody(mass, (0.1, inertia, 0.1)), name="nut")
    screw = scene.connect(fm.joint.Screw(pitch, "y"), scene.ground.frame(), nut.frame(), way=way)
    run = scene.simulate(3.5, h=2e-3)
    rate2 = -mass * G * pitch / (inertia + mass * pitch**2)
    angle = 0.5 * rate2 * run.t**2
    assert abs(angle[-1]) > 12 * 2.0 * np.pi
    np.testing.assert_allclose(run.position(nut.frame())[:, 1], pitch * angle, atol=1e-9 * abs(angle[-1]))
    np.testing.assert_allclose(run.angular_velocity(nut.frame())[:, 1], rate2 * run.t, rtol=1e-9)
    # along the axis the thread carries the weight but for the fall, and twists the nut by I angle''
    expected = [0.0, mass * (pitch * rate2 + G), 0.0, 0.0, inertia * rate2, 0.0]
    np.testing.assert_allclose(run.reaction(screw)[[0, -1]], [expected, expected], atol=1e-8)


def shafts(joint, bend):
    """Two shafts that meet at ``bend``, the first at unit speed, the second free to turn."""
    scene = fm.System()
    turned = Rotation.from_euler("x", bend).as_matrix()
    first = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.2)), name="first")
    second = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.2)), name="second")
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), first.frame())
    out = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(R=turned), second.frame())
    drive.prescribe(lambda t: (t, 1.0, 0.0))
    scene.connect(joint, first.frame(), second.frame())
    return scene, out


def test_a_universal_joint_s_speed_changes_twice_a_turn():
    """tan(out) = tan(in) cos(bend), the driving arm starting along the axis of the bend."""
    bend = 0.7
    scene, out = shafts(fm.joint.Universal("x", "y"), bend)
    run = scene.simulate(7.0, h=2e-3)
    t = run.t
    # the arm of the first shaft starts along x, the axis of the bend
    expected = np.unwrap(np.arctan2(np.sin(t) * np.cos(bend), np.cos(t)))
    turned = run.beta(out) - run.beta(out)[0]
    np.testing.assert_allclose(turned, expected, atol=1e-9)
    speed = np.cos(bend) / (1.0 - np.sin(bend) ** 2 * np.sin(t) ** 2)
    np.testing.assert_allclose(run.beta_rate(out), speed, atol=1e-9)


def test_a_constant_velocity_joint_keeps_the_speeds_equal():
    scene, out = shafts(fm.joint.ConstantVelocity("z"), 0.7)
    run = scene.simulate(7.0, h=1e-2)
    np.testing.assert_allclose(run.beta_rate(out), 1.0, atol=1e-9)
    np.testing.assert_allclose(run.beta(out) - run.beta(out)[0], run.t, atol=1e-9)


def test_gears_share_a_torque():
    """(I1 + r^2 I2) angle1'' = T; teeth pass on r I2 angle2''."""
    scene = fm.System()
    wheels = [scene.add(fm.RigidBody(1.0, (1.0, 1.0, i)), name=f"wheel {i}") for i in (0.2, 0.05)]
    turns = [scene.connect(fm.joint.Revolute(), scene.ground.frame((k, 0, 0)), w.frame()) for k, w in enumerate(wheels)]
    turns[0].position, turns[1].position = 0.3, 1.0
    gear = scene.couple(fm.joint.Gear(*turns, ratio=-3.0))
    scene.add_force(fm.force.JointTorque(turns[0], 0.5))
    run = scene.simulate(2.0, h=1e-2)
    rate2 = 0.5 / (0.2 + 9.0 * 0.05)
    angle = 0.5 * rate2 * run.t**2
    np.testing.assert_allclose(run.beta(turns[0]), 0.3 + angle, atol=1e-10)
    np.testing.assert_allclose(run.beta(turns[1]), 1.0 - 3.0 * angle, atol=1e-10)
    # nu (ratio, -1) is asked of the joints: the second gets nu = I2 angle2''
    np.testing.assert_allclose(run.multipliers[:, 0], 0.05 * -3.0 * rate2, atol=1e-9)
    assert gear.name in scene.explain()


def test_a_rack_pulls_its_pinion():
    """(m + I / r^2) x'' = -m g on a vertical rack; a cylindrical joint's angle may be the pinion."""
    mass, inertia, radius = 2.0, 0.03, 0.1
    scene = fm.System(gravity=(0.0, 0.0, -G))
    pinion = scene.add(fm.RigidBody(1.0, (inertia, inertia, inertia)), name="pinion")
    rack = scene.add(fm.RigidBody(mass, (1.0, 1.0, 1.0)), name="rack")
    turn = scene.connect(fm.joint.Cylindrical("y"), scene.ground.frame(), pinion.frame())
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), rack.frame())
    scene.couple(fm.joint.RackAndPinion(turn, slide, radius))
    run = scene.simulate(1.0, h=1e-2)
    fall = -0.5 * mass * G / (mass + inertia / radius**2) * run.t**2
    np.testing.assert_allclose(run.beta(slide), fall, atol=1e-10)
    np.testing.assert_allclose(run.beta(turn)[:, 1], fall / radius, atol=1e-9)
    np.testing.assert_allclose(run.beta(turn)[:, 0], 0.0, atol=1e-12)


def disc_scene(radius=0.5, mass=3.0):
    """A thin disc flying above the plane z = 0, which it is to roll on."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    axial = 0.5 * mass * radius**2
    disc = scene.add(fm.RigidBody(mass, (0.5 * axial, 0.5 * axial, axial)), name="disc")
    fly = scene.connect(fm.joint.Free(), scene.ground.frame(), disc.frame())
    roll = scene.connect(fm.joint.RollingDisc(radius), scene.ground.frame(), disc.frame())
    return scene, disc, fly, roll


def as_quaternion(rotation):
    return np.roll(rotation.as_quat(), 1)


def test_an_upright_disc_rolls_straight():
    """At constant speed, the plane carrying the weight and nothing else."""
    scene, disc, fly, roll = disc_scene()
    upright = Rotation.from_euler("x", -90, degrees=True)  # the axis along y
    fly.position = [0.0, 0.0, 0.5, *as_quaternion(upright)]
    fly.velocity = [2.0, 0.0, 0.0, 0.0, 0.0, 4.0]
    run = scene.simulate(1.0, h=1e-2, rtol=1e-11)
    expected = np.column_stack([2.0 * run.t, 0.0 * run.t, 0.5 + 0.0 * run.t])
    np.testing.assert_allclose(run.position(disc.frame()), expected, atol=1e-9)
    force = np.einsum("kij,kj->ki", run.rotation(disc.frame()), run.reaction(roll)[:, :3])
    np.testing.assert_allclose(force, [[0.0, 0.0, 3.0 * G]] * len(run.t), atol=1e-8)
    assert "hold velocities alone" in scene.explain()


def test_a_leaning_disc_rolls_round_a_circle():
    """Steady precession, its spin from the balance of moments about the moving point of contact.

    Leaning by ``lean`` from upright, the disc turns about the vertical at ``turning``; the rate of its
    moment of momentum about the contact is that of the weight (Greenwood, section on the rolling disc).
    """
    radius, mass = 0.5, 3.0
    lean, turning = 0.3, 2.0
    i1, i3 = 0.25 * mass * radius**2, 0.5 * mass * radius**2
    s, c = np.sin(lean), np.cos(lean)
    scene, disc, fly, _ = disc_scene(radius, mass)
    # axes: e1 horizontal along the track, e2 up the disc's slope, n the disc's axis = e1 x e2
    e1, e2, n = np.array([1.0, 0, 0]), np.array([0.0, s, c]), np.array([0.0, -c, s])
    # w = spin n + turning c e2: of the vertical turning only the part across the axis is not in the spin
    w2 = turning * c
    z = np.array([0.0, 0.0, 1.0])

    def imbalance(spin):
        velocity = np.cross(spin * n, radius * e2)
        rate = turning * np.cross(z, i3 * spin * n + i1 * w2 * e2)
        acceleration = turning * np.cross(z, velocity)
        return (rate + np.cross(radius * e2, mass * (acceleration + G * z)))[0]

    spin = -imbalance(0.0) / (imbalance(1.0) - imbalance(0.0))  # linear in the spin
    velocity = np.cross(spin * n, radius * e2)
    R = np.column_stack([e1, e2, n])
    assert np.linalg.det(R) == pytest.approx(1.0)
    fly.position = [0.0, 0.0, radius * c, *as_quaternion(Rotation.from_matrix(R))]
    fly.velocity = [*velocity, *(R.T @ (spin * n + w2 * e2))]
    run = scene.simulate(2.0, h=1e-3, rtol=1e-10)
    reach = velocity[0] / turning
    centre = np.array([0.0, reach, radius * c])
    expected = centre + reach * np.column_stack([np.sin(turning * run.t), -np.cos(turning * run.t), 0 * run.t])
    np.testing.assert_allclose(run.position(disc.frame()), expected, atol=3e-6)
    energy = run.energy().total
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_a_wobbling_disc_keeps_its_energy_and_does_not_slip():
    """A start off every steady motion: rolling does no work, and the lowest point stands still."""
    scene, disc, fly, _ = disc_scene()
    lean = Rotation.from_euler("xy", [-1.2, 0.1])
    n = lean.as_matrix()[:, 2]
    fly.position = [0.0, 0.0, 0.5 * np.hypot(n[0], n[1]), *as_quaternion(lean)]
    spin = np.array([0.5, 0.2, 3.0])
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    fly.velocity = [*np.cross(lean.apply(spin), 0.5 * up / np.linalg.norm(up)), *spin]  # it rolls
    run = scene.simulate(2.0, h=1e-3, rtol=1e-10)
    energy = run.energy().total
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    axis = run.rotation(disc.frame())[:, :, 2]
    up = np.array([0.0, 0.0, 1.0]) - axis[:, 2:] * axis
    arm = -0.5 * up / np.linalg.norm(up, axis=1)[:, None]
    contact = run.velocity(disc.frame()) + np.cross(run.angular_velocity(disc.frame()), arm)
    np.testing.assert_allclose(contact, 0.0, atol=1e-9)
    np.testing.assert_allclose(run.position(disc.frame())[:, 2] + arm[:, 2], 0.0, atol=1e-9)
    assert np.ptp(axis[:, 2]) > 0.1


def test_a_distance_is_a_pendulum_s_rod():
    """A mass on a massless rod: the plane pendulum's equation, and the rod's tension."""
    length, mass = 0.8, 1.5
    scene = fm.System(gravity=(0.0, 0.0, -G))
    bob = scene.add(fm.RigidBody(mass, (0.01, 0.01, 0.01)), name="bob")
    fly = scene.connect(fm.joint.Free(), scene.ground.frame(), bob.frame())
    rod = scene.connect(fm.joint.Distance(length), scene.ground.frame(), bob.frame(), name="rod")
    fly.position = [length, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    run = scene.simulate(1.0, h=5e-4, rtol=1e-10)

    def pendulum(_t, y):
        return [y[1], -G / length * np.sin(y[0])]

    angle, rate = solve_ivp(pendulum, (0.0, 1.0), [np.pi / 2, 0.0], t_eval=run.t, rtol=1e-11, atol=1e-12).y
    expected = length * np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
    np.testing.assert_allclose(run.position(bob.frame()), expected, atol=2e-6)
    tension = mass * (length * rate**2 + G * np.cos(angle))
    np.testing.assert_allclose(np.linalg.norm(run.reaction(rod)[:, :3], axis=1), abs(tension), atol=2e-4)
    np.testing.assert_allclose(run.multipliers[:, 0], tension, atol=2e-4)


def test_a_point_slides_down_a_line_and_over_a_plane():
    """Along a slope of 3 in 4 it falls with 0.6 g; across the plane's normal it does not move."""
    for joint, down in ((fm.joint.PointOnLine((4.0, 0.0, -3.0)), 0.6), (fm.joint.PointOnPlane((3.0, 0.0, 4.0)), 0.6)):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        bead = scene.add(fm.RigidBody(0.7, (0.01, 0.02, 0.03)), name="bead")
        fly = scene.connect(fm.joint.Free(), scene.ground.frame(), bead.frame())
        scene.connect(joint, scene.ground.frame(), bead.frame())
        fly.velocity = [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]  # it tumbles freely
        run = scene.simulate(1.0, h=2e-3)
        fall = 0.5 * down * G * run.t[:, None] ** 2 * [0.8, 0.0, -0.6]
        np.testing.assert_allclose(run.position(bead.frame()), fall, atol=1e-8)
