"""Where loops are cut: joints with most constraints along the tree, those that are asked for first."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError


def loop(*joints):
    """Bodies in a ring with the ground, joined by these joints in order."""
    scene = fm.System()
    bodies = [scene.ground]
    for k in range(len(joints) - 1):
        bodies.append(scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=f"body {k + 1}"))
    made = []
    for k, joint in enumerate(joints):
        after = bodies[(k + 1) % len(bodies)]
        made.append(scene.connect(joint, bodies[k].frame(), after.frame(), name=f"joint {k}"))
    return scene, made


def closing(scene):
    return [c.name for c in scene.compile().scene.topology.closures]


TURN, BALL, SLIDE = fm.joint.Revolute("z"), fm.joint.Spherical(), fm.joint.Prismatic("x")


@pytest.mark.parametrize("place", range(4))
def test_a_loop_is_cut_at_the_joint_with_fewest_rows(place):
    joints = [TURN] * 4
    joints[place] = BALL
    scene, _ = loop(*joints)
    assert closing(scene) == [f"joint {place}"]
    assert len(scene.compile().scene.plan.rows) == 3


def test_equal_joints_are_taken_in_the_order_they_were_made():
    scene, _ = loop(TURN, TURN, TURN, SLIDE)
    assert closing(scene) == ["joint 3"]


@pytest.mark.parametrize("wish", ["position", "velocity", "motion", "torque", "way"])
def test_a_joint_whose_coordinate_is_wanted_is_in_the_tree(wish):
    scene, made = loop(TURN, TURN, TURN, TURN)
    last = made[3]
    if wish == "position":
        last.position = 0.1
    elif wish == "velocity":
        last.velocity = 0.1
    elif wish == "motion":
        last.prescribe(1.0)
    elif wish == "torque":
        scene.add_force(fm.force.JointTorque(last, 1.0))
    else:
        scene, made = loop(TURN, TURN, TURN)
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="spare")
        scene.connect(TURN, made[0].child, body.frame(), name="joint 4")
        last = scene.connect(
            TURN, scene.ground.frame(), body.frame(), name="joint 3", way=fm.Way.COORDINATES
        )
    assert last.name not in closing(scene)


def test_a_body_flies_by_coordinates_only_where_no_joint_carries_it():
    """Two flying bodies joined by a hinge: one free joint and the hinge, not two and five multipliers."""
    scene = fm.System()
    one, two = (scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=name) for name in ("one", "two"))
    for body in (one, two):
        scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    scene.connect(TURN, one.frame(), two.frame())
    compiled = scene.compile().scene
    assert compiled.nv == 7
    assert len(compiled.plan.rows) == 0


def test_a_long_chain_is_spanned_whatever_order_its_joints_were_made_in():
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=f"link {k}") for k in range(400)]
    ends = [scene.ground, *bodies]
    order = np.random.default_rng(1).permutation(len(bodies))
    for k in order:
        scene.connect(TURN, ends[k].frame(), ends[k + 1].frame(), name=f"joint {k}")
    topology = scene.compile().scene.topology
    assert [b.connection.name for b in topology.branches] == [f"joint {k}" for k in range(400)]


def test_bodies_that_nothing_connects_are_named():
    scene, _ = loop(TURN, TURN, TURN)
    for name in ("stray", "lost"):
        scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=name)
    with pytest.raises(SceneError, match="nothing connects 'stray', 'lost' to the ground"):
        scene.compile()


@pytest.mark.parametrize("first", ["foot", "hand"])
def test_a_body_that_flies_carries_what_is_asked_to_go_by_coordinates(first):
    """A ball goes from parent to child alone: of two bodies held by constraints the parent flies, made first or not."""
    scene = fm.System()
    arm, ball = (scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=name) for name in ("arm", "ball"))
    for name in ("foot", "hand") if first == "foot" else ("hand", "foot"):
        if name == "foot":
            scene.connect(TURN, scene.ground.frame(), arm.frame(), name="foot", way=fm.Way.CONSTRAINTS)
        else:
            scene.connect(fm.joint.PointOnPlane("z"), scene.ground.frame(), ball.frame(), name="hand")
    asked = scene.connect(BALL, arm.frame(), ball.frame(), way=fm.Way.COORDINATES)
    assert asked.name not in closing(scene)
    assert sorted(closing(scene)) == ["foot", "hand"]


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (2, 0, 1)])
def test_what_hangs_on_a_driven_body_stands_behind_it(order):
    """Two bars make a triangle with the ground and a carriage that a motion leads: 2 x 0.4 cos(angle) apart."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    names = ("left", "carriage", "right")
    bodies = {names[k]: scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=names[k]) for k in order}
    left, carriage, right = (bodies[name] for name in names)
    angle, tip = np.arccos(0.5 / 0.8), (0.4, 0.0, 0.0)
    scene.connect(TURN, scene.ground.frame(), left.frame()).position = angle
    slide = scene.connect(SLIDE, scene.ground.frame((0.5, 0.0, 0.0)), carriage.frame())
    slide.prescribe(fm.Sine(0.05, 3.0))
    hinge = scene.connect(TURN, carriage.frame(), right.frame(), way=fm.Way.COORDINATES)
    hinge.position = np.pi - angle
    scene.connect(TURN, left.frame(tip), right.frame(tip))
    run = scene.simulate(0.1, rtol=1e-8)
    apart = 0.5 + 0.05 * np.sin(3.0 * run.t)
    np.testing.assert_allclose(0.8 * run.rotation(left.frame())[:, 0, 0], apart, atol=1e-9)
