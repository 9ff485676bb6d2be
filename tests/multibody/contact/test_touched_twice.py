"""A pair of shapes that touches already is refused by name: a second contact would double what it does."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

LAWS = [contact.PowerLaw(k=1e4), contact.Hard()]


def bodies(count=3):
    scene = fm.System()
    found = []
    for k in range(count):
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=f"body {k}")
        joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        joint.position = (3.0 * k, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0)
        found.append(body)
    return scene, found


@pytest.mark.parametrize("law", LAWS)
def test_one_pair_is_refused_whichever_way_and_by_copies_of_its_shapes(law):
    scene, (one, *_) = bodies()
    floor, ball = contact.HalfSpace(scene.ground.frame()), contact.Sphere(one.frame(), 0.5)
    scene.touch(floor, ball, law)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    alike = contact.Sphere(one.frame(R=turn), 0.5)
    beside = contact.HalfSpace(scene.ground.frame(p=(1.0, 2.0, 0.0)))
    for again in ((floor, ball), (ball, floor), (floor, alike), (beside, ball), ([floor], [ball])):
        with pytest.raises(SceneError, match="touch already"):
            scene.touch(*again, law)
    scene.touch(floor, contact.Sphere(one.frame(p=(1.0, 0.0, 0.0)), 0.5), law)
    scene.touch(floor, contact.Sphere(one.frame(), 0.4), law)
    scene.touch(contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -1.0))), ball, law)
    assert len(scene.simulate(0.01, h=1e-3).t) == 11


@pytest.mark.parametrize("law", LAWS)
def test_lists_that_share_a_pair_are_refused(law):
    scene, made = bodies(4)
    floor = contact.HalfSpace(scene.ground.frame())
    a, b, c, d = (contact.Sphere(body.frame(), 0.5) for body in made)
    scene.touch([a, b], floor, law)
    scene.touch([a, b], [a, b, c], law)
    for again in (([b, c], floor), ([c, a], [b, d]), (a, floor), (b, a), ([c, d], [a, d])):
        with pytest.raises(SceneError, match="touch already"):
            scene.touch(*again, law)
    with pytest.raises(SceneError, match="twice in a list"):
        scene.touch([c, contact.Sphere(made[2].frame(), 0.5)], floor, law)
    scene.touch([c, d], floor, law)
    scene.touch(c, d, law)
    again = copy.deepcopy(scene)
    with pytest.raises(SceneError, match="touch already"):
        scene.touch(d, c, law)
    assert len(again.simulate(0.01, h=1e-3).t) == 11


def test_what_a_joint_keeps_out_of_a_list_may_touch_as_a_pair():
    scene, (one, two, _) = bodies()
    scene.connect(fm.joint.Spherical(), one.frame(p=(1.5, 0, 0)), two.frame(p=(-1.5, 0, 0)))
    law = contact.PowerLaw(k=1e4)
    a, b = contact.Sphere(one.frame(), 0.5), contact.Sphere(two.frame(), 0.5)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch([a, b, floor], [a, b, floor], law)
    scene.touch(a, b, law)


def test_a_call_that_was_refused_leaves_nothing_behind():
    scene, (one, two, _) = bodies()
    a, b = contact.Sphere(one.frame(), 0.5), contact.Sphere(two.frame(), 0.5)
    with pytest.raises(SceneError, match="k = -1"):
        scene.touch(a, b, contact.PowerLaw(k=-1.0))
    assert len(scene.touch(a, b, contact.PowerLaw(k=1.0))) == 1


def test_equal_lists_touch_within_themselves_once():
    """Copies of a list's shapes are the list: a pair is no second pair the other way round."""
    scene, made = bodies(3)
    one, other = ([contact.Sphere(body.frame(), 0.5) for body in made] for _ in range(2))
    assert len(scene.touch(one, other, contact.PowerLaw(k=1e4))) == 3
