"""Joints and couplings given wrongly: one clear error that names the thing."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import AssemblyError, SceneError

JOINT = fm.joint


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: JOINT.Screw(0.1, (0.0, 0.0, 0.0)), "no direction"),
        (lambda: JOINT.Cylindrical((0.0, 0.0, 0.0)), "no direction"),
        (lambda: JOINT.Planar("w"), "not known"),
        (lambda: JOINT.PointOnLine((0.0, np.nan, 0.0)), "no direction"),
        (lambda: JOINT.PointOnPlane((0.0, 0.0)), "no direction"),
        (lambda: JOINT.ConstantVelocity((0.0, 0.0, 0.0)), "no direction"),
        (lambda: JOINT.Universal("x", "x"), "right angles"),
        (lambda: JOINT.Universal("x", (1.0, 1.0, 0.0)), "right angles"),
        (lambda: JOINT.Universal((0.0, 0.0, 0.0), "y"), "no direction"),
        (lambda: JOINT.Screw(0.0), "Revolute"),
        (lambda: JOINT.Screw(np.inf), "pitch"),
        (lambda: JOINT.Distance(0.0), "length"),
        (lambda: JOINT.RollingDisc(-0.1), "radius"),
        (lambda: fm.Penalty(0.0), "stiffness"),
        (lambda: fm.Penalty(1.0, -1.0), "damping"),
        (lambda: fm.AugmentedLagrangian(1.0, tol=0.0), "tol"),
    ],
)
def test_joints_that_are_none(make, text):
    with pytest.raises(SceneError, match=text):
        make()


def pair(joint=None, **choice):
    """Two bodies on the ground, the second by ``joint``."""
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name) for name in ("one", "two")]
    first = scene.connect(JOINT.Revolute(), scene.ground.frame(), bodies[0].frame())
    second = scene.connect(joint or JOINT.Revolute(), scene.ground.frame(), bodies[1].frame(), name="two's", **choice)
    return scene, bodies, first, second


def test_a_joint_asked_to_go_where_it_cannot():
    with pytest.raises(SceneError, match="two's\": a Distance has no coordinates"):
        pair(JOINT.Distance(1.0), way=fm.Way.COORDINATES)
    with pytest.raises(SceneError, match="leave out `enforce`"):
        pair(way=fm.Way.COORDINATES, enforce=fm.Multipliers())
    scene, bodies, *_ = pair()
    scene.connect(
        JOINT.Revolute(), bodies[0].frame(), bodies[1].frame(), name="both", way=fm.Way.COORDINATES
    )
    scene.connect(JOINT.Fixed(), bodies[0].frame(), bodies[1].frame(), name="third", way=fm.Way.COORDINATES)
    with pytest.raises(SceneError, match=r"'(third|both)' cannot go by coordinates"):
        scene.compile()


@pytest.mark.parametrize("choice", [fm.Penalty(1e5), fm.AugmentedLagrangian(1e5)])
def test_rolling_needs_damping_where_it_yields(choice):
    scene, bodies, *_ = pair(JOINT.Free())
    scene.connect(JOINT.RollingDisc(0.5), scene.ground.frame(), bodies[1].frame(), name="roll", enforce=choice)
    with pytest.raises(SceneError, match="roll: no slip along x: holds velocities alone"):
        scene.compile()


def test_couplings_that_are_none():
    scene, bodies, first, second = pair()
    slide = scene.connect(JOINT.Prismatic(), bodies[0].frame(), bodies[1].frame(), name="slide")
    ball = scene.connect(JOINT.Spherical(), bodies[0].frame(), bodies[1].frame(), name="ball")
    for make, text in (
        (lambda: JOINT.Gear(first, second, 0.0), "ratio"),
        (lambda: JOINT.Gear(first, first, 2.0), "itself"),
        (lambda: JOINT.Gear(first, slide, 2.0), "'slide' is a Prismatic"),
        (lambda: JOINT.Gear(first, ball, 2.0), "'ball' is a Spherical"),
        (lambda: JOINT.RackAndPinion(first, second, 0.1), "is a Revolute"),
        (lambda: JOINT.RackAndPinion(first, slide, np.nan), "radius"),
    ):
        with pytest.raises(SceneError, match=text):
            make()
    gear = JOINT.Gear(first, second, 2.0)
    _, _, strange, _ = pair()
    with pytest.raises(SceneError, match="not in this scene"):
        scene.couple(JOINT.Gear(strange, second, 2.0))
    scene.couple(gear)
    with pytest.raises(SceneError, match="already"):
        scene.couple(gear)
    scene.couple(JOINT.RackAndPinion(first, slide, 0.1))
    with pytest.raises(SceneError, match="'slide' is held by constraints and has no coordinate to couple"):
        scene.compile()


def test_gears_that_contradict_prescribed_motions():
    scene, _, first, second = pair()
    scene.couple(JOINT.Gear(first, second, 2.0))
    first.prescribe(fm.Sine(1.0, 2.0))
    second.prescribe(fm.Sine(1.0, 2.0))
    with pytest.raises(AssemblyError, match="gear 'revolute ground-one' to \"two's\""):
        scene.start()


def test_constraints_that_contradict_each_other():
    """Two rods hold one point at distances that no place has."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    fly = scene.connect(JOINT.Free(), scene.ground.frame(), body.frame())
    fly.position = [0.5, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0]
    scene.connect(JOINT.Distance(0.5), scene.ground.frame(), body.frame(), name="short")
    scene.connect(JOINT.Distance(0.6), scene.ground.frame((3.0, 0.0, 0.0)), body.frame(), name="far")
    with pytest.raises(AssemblyError, match=r"(short|far): distance"):
        scene.start()


def test_a_force_on_a_coordinate_of_a_joint_held_by_constraints():
    scene, _, _, second = pair(way=fm.Way.CONSTRAINTS)
    scene.add_force(fm.force.JointSpring(second, 1.0))
    with pytest.raises(SceneError, match="has no coordinate"):
        scene.compile()


def test_a_reaction_of_another_scene():
    scene, *_ = pair()
    _, _, strange, _ = pair()
    run = scene.simulate(1e-3, h=1e-3)
    with pytest.raises(SceneError, match="another scene"):
        run.reaction(strange)


def test_explain_tells_links_ways_and_penalties():
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name) for name in "abc"]
    scene.connect(JOINT.Planar(), scene.ground.frame(), bodies[0].frame())
    scene.connect(JOINT.Cylindrical(), bodies[0].frame(), bodies[1].frame(), way=fm.Way.CONSTRAINTS)
    scene.connect(JOINT.Universal(), bodies[1].frame(), bodies[2].frame(), enforce=fm.Penalty(1e5))
    text = scene.explain()
    assert "3 bodies and 2 massless links, 15 velocities" in text
    assert "cylindrical a-b: Cylindrical, 4 of 4 rows, by constraints as asked" in text
    assert "universal b-c: Universal, yields to a penalty, no multipliers" in text


@pytest.mark.parametrize("joint", [fm.joint.RollingDisc, fm.joint.Distance])
def test_a_parameter_may_be_an_array_without_axes(joint):
    """Seen as a TypeError of sets where a loop closes."""
    closed = []
    for size in (0.5, np.array(0.5)):
        scene = fm.System()
        body = scene.add(fm.RigidBody(1.0, (0.1,) * 3))
        scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        scene.connect(joint(size), scene.ground.frame(p=(0.0, 0.0, -0.4)), body.frame(), name="loop")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fm.StartWarning)
            closed.append(scene.start().x)
    assert np.array_equal(*closed)
