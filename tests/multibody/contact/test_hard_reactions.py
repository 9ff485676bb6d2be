"""Reactions and drives beside hard contacts, impulses over their steps included, against statics and impulse laws."""

from __future__ import annotations

import numpy as np
import pytest
from hard_scenes import G, four_bar

import flexmbd as fm
from flexmbd import contact


def rod(scene, name="rod", length=1.0, mass=1.0):
    inertia = mass * length**2 / 12.0
    return scene.add(fm.RigidBody(mass, (1e-3 * inertia, inertia, inertia)), name=name)


@pytest.mark.parametrize("flipped", [False, True])
def test_a_rod_that_leans_on_a_floor_is_borne_by_half_its_weight_at_each_end(flipped):
    scene = fm.System(gravity=(0.0, 0.0, -G))
    bar = rod(scene)
    ends = [scene.ground.frame(p=(0.0, 0.0, 0.5)), bar.frame(p=(-0.5, 0.0, 0.0))]
    hinge = scene.connect(fm.joint.Revolute("y"), *(reversed(ends) if flipped else ends))
    hinge.position = -np.deg2rad(30.0) if flipped else np.deg2rad(30.0)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch(floor, contact.Vertex(bar.frame(p=(0.5, 0.0, 0.0))), contact.Hard())
    run = scene.simulate(0.1, h=1e-3)
    push = run.reaction(hinge)[-1]
    turn = np.deg2rad(30.0)
    # on the child, in its axes: the bar, turned, by the ground, or the ground by the bar
    wanted = (0.0, 0.0, -0.5 * G) if flipped else (-0.5 * G * np.sin(turn), 0.0, 0.5 * G * np.cos(turn))
    assert push[:3] == pytest.approx(wanted, rel=1e-7, abs=1e-9)
    assert push[3:] == pytest.approx(np.zeros(3), abs=1e-9)
    assert run.drive(hinge) == pytest.approx(np.zeros(len(run.t)), abs=1e-9)


def test_a_hinge_takes_its_share_of_a_blow_on_a_rod():
    """Of a rod that turns at 1 rad/s and is stopped at its tip: (1 + e) m L / 6, along the blow."""
    e, h = 0.5, 1e-4
    scene = fm.System()
    bar = rod(scene)
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bar.frame(p=(-0.5, 0.0, 0.0)))
    hinge.position, hinge.velocity = 0.02, -1.0
    wall = contact.HalfSpace(scene.ground.frame(), normal="y")
    (pair,) = scene.touch(wall, contact.Vertex(bar.frame(p=(0.5, 0.0, 0.0))), contact.Hard(restitution=e))
    run = scene.simulate(0.03, h=h)
    assert run.contacts(pair)[0].impulse[:, 1].sum() == pytest.approx((1.0 + e) / 3.0, rel=1e-3)
    assert h * run.reaction(hinge)[:, 1].sum() == pytest.approx((1.0 + e) / 6.0, rel=1e-2)


@pytest.mark.parametrize("listed", [False, True])
def test_the_drive_of_a_table_bears_what_stands_on_it(listed):
    """At rest both weights; while it shakes the accelerations too."""
    amplitude, omega = 0.05, 10.0
    for motion in (fm.Sine(0.0, 1.0), fm.Sine(amplitude, omega, phase=np.pi / 2)):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        table = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="table")
        lift = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), table.frame())
        lift.prescribe(motion)
        load = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.01)), name="load")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), load.frame())
        free.position = (0.3, 0.0, motion.amplitude + 0.1, 1.0, 0.0, 0.0, 0.0)
        top, block = contact.HalfSpace(table.frame()), contact.Box(load.frame(), (0.2, 0.2, 0.2))
        law = contact.Hard(mu=0.5)
        scene.touch([top], [block, contact.Sphere(load.frame(), 0.05)], law) if listed else scene.touch(top, block, law)
        run = scene.simulate(1.0, h=1e-3, rtol=1e-9)
        acceleration = -motion.amplitude * motion.omega**2 * np.cos(motion.omega * run.t)
        drive, push = run.drive(lift), run.reaction(lift)
        assert drive[3:] == pytest.approx(3.0 * (G + acceleration)[3:], abs=3.0 * 0.6e-3 * amplitude * omega**3)
        assert push[:, 2] == pytest.approx(drive, rel=1e-9)
        assert push[-1, 4] == pytest.approx(-0.3 * 2.0 * drive[-1] / 3.0, rel=5e-3)
        assert run.reaction(free) == pytest.approx(np.zeros((len(run.t), 6)), abs=1e-5)


def test_a_four_bar_that_rests_on_a_plane_loads_its_joints_by_half_of_a_crank():
    """The plane bears 3 m g; each pin holds the coupler down by m g / 2, each ground joint its crank up by as much."""
    scene, _ = four_bar(contact.Hard())
    scene.gravity = (0.0, -G, 0.0)
    run = scene.simulate(1.5, h=1e-3)
    first, lift, second, fourth = joints_of(scene)
    turn = np.deg2rad(30.0)
    up = 0.5 * G * np.array([np.sin(turn), np.cos(turn), 0.0])
    for pin in (lift, fourth):
        assert run.reaction(pin)[-1, :3] == pytest.approx([0.0, -0.5 * G, 0.0], abs=1e-6)
    for ground in (first, second):
        assert run.reaction(ground)[-1, :3] == pytest.approx(up, abs=1e-6)


def test_the_joints_of_a_four_bar_take_their_shares_of_a_blow():
    """Each crank of inertia m L^2 / 3 turns by the part of its pin's impulse across it, the rest is half of the blow's.

    So by symmetry, as the coupler neither turns nor is stopped along the cranks.
    """
    h, turn = 2e-4, np.deg2rad(30.0)
    scene, pair = four_bar(contact.Hard(restitution=0.4))
    run = scene.simulate(1.0, h=h)
    first, lift, second, fourth = joints_of(scene)
    blow = (2.0 / 12.0 + 2.0 / 4.0) * 1.4 / (0.5 * np.cos(turn))
    across, along = np.array([-np.sin(turn), np.cos(turn), 0.0]), np.array([np.cos(turn), np.sin(turn), 0.0])
    on_crank = 1.4 / 6.0 * across + 0.5 * blow * np.sin(turn) * along
    hit = int(np.argmax(run.contacts(pair)[0].impulse[:, 1]))
    for pin in (lift, fourth):
        assert h * run.reaction(pin)[hit, :3] == pytest.approx(-on_crank, abs=3e-3)
    for ground in (first, second):  # m dv of the crank's middle, L / 2 from the ground; in the crank's axes
        wanted = np.array([-0.5 * blow * np.sin(turn), 0.25 * 1.4 - 1.4 / 6.0, 0.0])
        assert h * run.reaction(ground)[hit, :3] == pytest.approx(wanted, abs=3e-3)


def joints_of(scene):
    """The joints of ``four_bar``, as it makes them."""
    return list(scene.compile().connections)
