"""Groups of hard shapes, whose points are found in each step: towers, piles, and what pairs by themselves do."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.integrate.moreau import shape_groups
from flexmbd.multibody.kernels.contact.finding.shape_table import new_contact_points

G = 9.81
SIDES = np.array([1.0, 0.8, 0.6])


def free_body(scene, name, mass, inertia, place, velocity=(0.0,) * 6, turn=(1.0, 0.0, 0.0, 0.0)):
    body = scene.add(fm.RigidBody(mass, inertia), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, *turn), velocity
    return body


def box(scene, name, place, velocity=(0.0,) * 6, turn=(1.0, 0.0, 0.0, 0.0), sides=SIDES):
    mass, squares = 1000.0 * np.prod(sides), np.square(sides)
    body = free_body(scene, name, mass, tuple(mass / 12.0 * (squares.sum() - squares)), place, velocity, turn)
    return contact.Box(body.frame(), sides)


def heap(count=8):
    """Boxes askew above each other, in four columns, without overlaps, above a floor."""
    random = np.random.default_rng(3)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    shapes = []
    for k in range(count):
        turn = np.array([1.0, 0.0, 0.0, 0.0]) + 0.3 * random.normal(size=4)
        place = (1.6 * (k % 4), 0.05 * random.normal(), 1.0 + 1.5 * (k // 4))
        shapes.append(box(scene, f"box {k}", place, turn=tuple(turn / np.linalg.norm(turn))))
    law = contact.Hard(mu=0.5)
    floor = contact.HalfSpace(scene.ground.frame())
    return scene, shapes, (*scene.touch(shapes, floor, law), *scene.touch(shapes, shapes, law))


def test_a_tower_of_ten_boxes_stands_and_each_bears_those_above():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    shapes = [box(scene, f"box {k}", (0.0, 0.0, 0.3 + 0.6 * k)) for k in range(10)]
    law = contact.Hard(mu=0.5)
    (ground,) = scene.touch(shapes, contact.HalfSpace(scene.ground.frame()), law)
    (among,) = scene.touch(shapes, shapes, law)
    run = scene.simulate(0.2, h=5e-3)
    assert np.abs(run.x[-1] - run.x[0]).max() < 1e-7
    assert np.abs(run.v[-1]).max() < 1e-7
    last, weight = len(run.t) - 1, 480.0 * G
    below, between = run.contacts([ground, among])
    on = below.row == last
    assert on.sum() == 4
    assert below.force[on].sum(axis=0) == pytest.approx([0.0, 0.0, 10.0 * weight], abs=1e-4 * weight)
    for k in range(9):
        on = (between.row == last) & (between.pair == [k, k + 1]).all(axis=1)
        assert on.sum() == 4
        assert between.force[on].sum(axis=0) == pytest.approx([0.0, 0.0, -(9.0 - k) * weight], abs=1e-4 * weight)


def test_a_heap_settles_without_gain_overlap_or_more_than_coulombs_friction():
    scene, _, pairs = heap()
    run = scene.simulate(4.0, h=5e-3, rtol=1e-4)
    energy = run.energy()
    assert np.diff(energy.total).max() < 1e-6 * energy.total[0]
    among = run.contacts(pairs)
    works = sum(one.normal_work[-1] + one.friction_work[-1] for one in among)
    assert energy.total[-1] - energy.total[0] == pytest.approx(works, rel=2e-2)
    assert energy.kinetic[-1] < 2e-2 * energy.kinetic.max()
    for one in among:
        slides = np.linalg.norm(one.friction, axis=1) - 0.5 * one.normal_force
        assert slides.max() < 1e-9 * one.normal_force.max()
        assert one.normal_force.min() >= 0.0
    assert min(one.gap[one.row == len(run.t) - 1].min() for one in among) > -1e-3


def test_spheres_in_lists_do_what_they_do_in_pairs():
    ends = []
    for listed in (True, False):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        places = ((0.0, 0.0, 0.1), (0.05, 0.02, 0.35), (0.3, 0.0, 0.1))
        balls = [free_body(scene, f"ball {k}", 1.0, (4e-3,) * 3, place) for k, place in enumerate(places)]
        shapes = [contact.Sphere(one.frame(), 0.1) for one in balls]
        floor, law = contact.HalfSpace(scene.ground.frame()), contact.Hard(restitution=0.3, mu=0.4)
        if listed:
            scene.touch(shapes, floor, law)
            scene.touch(shapes, shapes, law)
        else:
            for k, one in enumerate(shapes):
                scene.touch(floor, one, law)
                for other in shapes[:k]:
                    scene.touch(one, other, law)
        ends.append(scene.simulate(0.5, h=1e-3, rtol=1e-9).x[-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)


def test_boxes_that_meet_keep_their_momentum():
    scene = fm.System()
    turn = np.array([0.9, 0.2, -0.3, 0.1])
    a = box(scene, "a", (-1.5, 0.1, 0.0), (2.0, 0.0, 0.1, 0.3, -0.2, 0.5))
    b = box(scene, "b", (0.4, 0.0, 0.2), (-1.0, 0.3, 0.0, 0.0, 0.4, -0.1), tuple(turn / np.linalg.norm(turn)))
    (pair,) = scene.touch(a, b, contact.Hard(restitution=0.4, mu=0.5))
    run = scene.simulate(1.0, h=1e-3)
    momentum = run.momentum()
    met = run.contacts(pair)[0]
    assert isinstance(met, contact.HardGroupSeries)
    assert len(met.row) > 0
    assert np.abs(np.diff(run.v[:, 0])).max() > 0.1
    assert np.abs(momentum.linear - momentum.linear[0]).max() < 1e-12 * np.abs(momentum.linear[0]).max()
    assert np.abs(momentum.angular - momentum.angular[0]).max() < 1e-12 * np.abs(momentum.angular[0]).max()


def test_room_for_points_grows_and_a_restart_goes_on_to_the_bit(monkeypatch):
    scene, _, _ = heap(6)
    whole = scene.simulate(0.8, h=5e-3, rtol=1e-4, checkpoints=[0.6])
    rest = scene.simulate(0.8, h=5e-3, rtol=1e-4, restart=whole.checkpoints[0])
    assert np.array_equal(whole.x[-1], rest.x[-1])
    monkeypatch.setattr(shape_groups, "new_contact_points", lambda room: new_contact_points(1))
    small = scene.simulate(0.8, h=5e-3, rtol=1e-4, checkpoints=[0.6])
    assert np.array_equal(whole.x[-1], small.x[-1])
    assert small.stats.rejected == 0


def test_what_joints_join_does_not_touch_and_what_does_not_go_is_refused():
    scene = fm.System()
    one = box(scene, "one", (0.0, 0.0, 0.0))
    hung = scene.add(fm.RigidBody(480.0, (40.0, 54.4, 65.6)))
    other = contact.Box(hung.frame(), SIDES)
    scene.connect(fm.joint.Revolute("z"), one.frame.body.frame(p=(0.45, 0, 0)), hung.frame(p=(-0.45, 0, 0)))
    (group,) = scene.touch([one, other], [one, other], contact.Hard())
    run = scene.simulate(0.01, h=1e-3)
    assert len(run.contacts(group)[0].row) == 0
    assert np.abs(run.v).max() == 0.0
    with pytest.raises(SceneError, match="ends of steps"):
        run.contacts(group, t=[0.005])
    with pytest.raises(SceneError, match="one body"):
        scene.touch([one], [one], contact.Hard())
    with pytest.raises(SceneError, match="point mass"):
        scene.touch([one, contact.Vertex(scene.add(fm.PointMass(1.0)).frame())], [one], contact.Hard())


@pytest.mark.parametrize("gravity", [0.0, G])
def test_what_moves_together_touches_without_impulses(gravity):
    """Two boxes face to face that fly, or fall, at one velocity: round-off between them is nothing to solve for."""
    scene = fm.System(gravity=(0.0, 0.0, -gravity))
    velocity = (3.0, 1.7, 0.3, 0.0, 0.0, 0.0)
    shapes = [box(scene, f"box {k}", (0.1 * k, 0.0, 100.3 + 0.6 * k), velocity) for k in range(2)]
    (pair,) = scene.touch(*shapes, contact.Hard(mu=0.5))
    run = scene.simulate(1.0, h=1e-2)
    exact = np.array([*velocity[:2], 0.3 - gravity, 0.0, 0.0, 0.0] * 2)
    assert run.v[-1] == pytest.approx(exact, abs=1e-9)
    assert len(run.contacts(pair)[0].row) > 0
