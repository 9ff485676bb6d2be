"""Joints by one place and axis of the drawing: the same machine as by frames on both bodies; and what is refused."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.forms import beam_timoshenko

JOINT = fm.joint
GRAVITY = (0.4, -1.1, -9.81)
AXIS = (1.0, 2.0, -0.5)
AT = np.array([0.5, -0.1, 0.3])
POSES = {
    "carrier": (np.array([0.2, 0.1, -0.3]), Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()),
    "body": (np.array([0.7, 0.0, 0.2]), Rotation.from_rotvec([-1.1, 0.4, 0.2]).as_matrix()),
}

# by the drawing: the joint between, its axis; by frames whose axes are the ground's: the same joint
JOINTS = {
    "revolute": (JOINT.Revolute(), AXIS, JOINT.Revolute(AXIS)),
    "own axis": (JOINT.Revolute("y"), None, JOINT.Revolute("y")),
    "turned axis": (JOINT.Revolute("y"), "z", JOINT.Revolute("z")),
    "prismatic": (JOINT.Prismatic("x"), AXIS, JOINT.Prismatic(AXIS)),
    "screw": (JOINT.Screw(0.05), AXIS, JOINT.Screw(0.05, AXIS)),
    "cylindrical": (JOINT.Cylindrical(), AXIS, JOINT.Cylindrical(AXIS)),
    "planar": (JOINT.Planar(), AXIS, JOINT.Planar(AXIS)),
    "universal": (JOINT.Universal("x", "z"), None, JOINT.Universal("x", "z")),
    "spherical": (JOINT.Spherical(), None, JOINT.Spherical()),
    "fixed": (JOINT.Fixed(), None, JOINT.Fixed()),
    "free": (JOINT.Free(), None, JOINT.Free()),
    "generic": (JOINT.Generic("xz", "y"), None, JOINT.Generic("xz", "y")),
    "point on line": (JOINT.PointOnLine(), AXIS, JOINT.PointOnLine(AXIS)),
    "point on plane": (JOINT.PointOnPlane(), AXIS, JOINT.PointOnPlane(AXIS)),
    "constant velocity": (JOINT.ConstantVelocity(), AXIS, JOINT.ConstantVelocity(AXIS)),
}


def on(body, pose, at):
    """A marker at a place of the drawing, with the ground's axes there."""
    p, R = pose
    return body.frame(p=R.T @ (np.asarray(at) - p), R=R.T)


def machine(name, *, drawn, way=None):
    """A swinging carrier and a body on it by the joint in question."""
    scene = fm.System(gravity=GRAVITY)
    carrier = fm.RigidBody(1.3, np.diag([0.05, 0.06, 0.07]), (0.2, 0.05, -0.1))
    body = fm.RigidBody(0.9, np.diag([0.02, 0.03, 0.04]), (0.1, 0.05, -0.02))
    for part, called in ((carrier, "carrier"), (body, "body")):
        p, R = POSES[called]
        scene.add(part, name=called, **({"p": p, "R": R} if drawn else {}))
    joint, axis, same = JOINTS[name]
    foot = np.array([0.1, 0.2, 0.0])
    if drawn:
        hinge = scene.connect(JOINT.Revolute(), scene.ground, carrier, at=foot, axis="y")
        studied = scene.connect(joint, carrier, body, at=AT, axis=axis, way=way)
    else:
        ends = on(carrier, POSES["carrier"], foot), on(carrier, POSES["carrier"], AT), on(body, POSES["body"], AT)
        hinge = scene.connect(JOINT.Revolute("y"), scene.ground.frame(foot), ends[0])
        studied = scene.connect(same, *ends[1:], way=way)
    hinge.velocity = 1.2
    if studied.velocity is None and studied.joint.velocity_names and way is None:
        studied.velocity = np.linspace(0.3, 0.7, len(studied.joint.velocity_names))
    return scene, body, hinge


@pytest.mark.parametrize("name", JOINTS)
def test_the_same_machine_as_by_frames(name):
    """By coordinates, and held by constraints; at the start both bodies lie as drawn."""
    for choice in ({}, {"way": fm.Way.CONSTRAINTS}):
        ends = []
        for drawn in (True, False):
            scene, body, hinge = machine(name, drawn=drawn, **choice)
            run = scene.simulate(0.1, h=2e-3, integrator=fm.ExplicitRungeKutta())
            ends.append(np.concatenate([run.position(body.frame())[-1], run.rotation(body.frame())[-1].ravel()]))
            assert abs(run.beta(hinge)[-1]) > 1e-3
            if drawn:
                np.testing.assert_allclose(run.position(body.frame())[0], POSES["body"][0], atol=1e-12)
                np.testing.assert_allclose(run.rotation(body.frame())[0], POSES["body"][1], atol=1e-12)
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_a_whole_drawing_elsewhere_moves_alike():
    """Turned and moved with its gravity, it has the same joint coordinates."""
    runs = []
    for p, R in ((np.zeros(3), np.eye(3)), (np.array([3.0, -2.0, 5.0]), POSES["body"][1])):
        scene = fm.System(gravity=R @ GRAVITY)
        one, two = (
            scene.add(fm.RigidBody(mass, (0.02, 0.03, 0.04), (0.1, 0.0, 0.05)), p=p, R=R) for mass in (1.0, 0.6)
        )
        first = scene.connect(JOINT.Revolute(), scene.ground, one, at=p, axis=R @ (0.0, 1.0, 0.3))
        second = scene.connect(JOINT.Cylindrical("x"), one, two, at=p + R @ AT, axis=R @ AXIS)
        run = scene.simulate(0.3, h=3e-3, integrator=fm.ExplicitRungeKutta())
        runs.append(np.column_stack([run.beta(first), run.beta(second)]))
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-12)
    assert np.abs(runs[0][-1]).min() > 1e-2


def test_a_loop_drawn():
    """A slider-crank drawn at 1 rad, whose slider is where its closed form has it once the crank has turned on."""
    r, length, drawn, turned = 0.1, 0.3, 1.0, 0.7
    pin = r * np.array([np.cos(drawn), np.sin(drawn), 0.0])
    end = np.array([pin[0] + np.sqrt(length**2 - pin[1] ** 2), 0.0, 0.0])
    scene = fm.System()
    crank, rod, slider = (scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name=n) for n in ("crank", "rod", "slider"))
    hinge = scene.connect(JOINT.Revolute(), scene.ground, crank, at=(0.0, 0.0, 0.0), axis="z")
    scene.connect(JOINT.Revolute(), crank, rod, at=pin, axis="z")
    scene.connect(JOINT.Revolute(), rod, slider, at=end, axis="z")
    slide = scene.connect(JOINT.Prismatic(), scene.ground, slider, at=end, axis="x", way=fm.Way.COORDINATES)
    start = scene.start()
    assert np.abs(start.x).max() < 1e-15  # all joint coordinates are zero in the drawing
    hinge.position = turned
    angle = drawn + turned
    place = r * np.cos(angle) + np.sqrt(length**2 - (r * np.sin(angle)) ** 2)
    assert scene.at_start().beta(slide)[0] == pytest.approx(place - end[0], abs=1e-12)


def test_interfaces_of_a_flexible_body():
    """Joints lie at its interfaces, with axes of the drawing; its mesh says where it is drawn, in variants too."""
    record = particle_body(3, modes=3).record
    tip = record.interface("tip")
    p, R = POSES["body"]
    places = [p + R @ interface.p_BI_B for interface in (record.interface("root"), tip)]
    runs, copies = [], []
    for drawn in (True, False):
        scene = fm.System(gravity=GRAVITY)
        arm = fm.FlexibleBody(record)
        bob = scene.add(fm.RigidBody(0.3, (0.01, 0.012, 0.015), (0.0, 0.2, 0.1)), name="bob", p=places[1])
        if drawn:
            scene.add(arm, name="arm", p=p, R=R)
            scene.connect(JOINT.Revolute(), scene.ground, arm, at=places[0], axis=AXIS)
            rounded = np.round(places[1], 4)  # as a drawing has it
            last = scene.connect(JOINT.Revolute("x"), arm, bob, at=rounded, axis="z")
        else:
            scene.add(arm, name="arm")
            root = record.interface("root")
            turn = np.linalg.inv(R @ root.R_BI)
            ground = scene.ground.frame(p=places[0], R=turn.T)
            scene.connect(JOINT.Revolute(tuple(turn @ AXIS)), ground, arm.frame("root"))
            turn = (R @ tip.R_BI).T
            last = scene.connect(JOINT.Revolute(tuple(turn[:, 2])), arm.frame("tip"), bob.frame(R=turn.T))
        last.velocity = 2.0
        run = scene.simulate(0.2, h=2e-3, integrator=fm.ExplicitRungeKutta())
        runs.append([run.position(bob.frame(p=(0.1, 0.0, 0.2))), run.rotation(bob.frame())])
        machine = scene.compile(parameters={"arm": fm.parameter.BodyRecord(arm)})
        again = machine.simulate(0.2, h=2e-3, integrator=fm.ExplicitRungeKutta(), arm=replace(record, provenance={}))
        copies.append(again.position(bob.frame(p=(0.1, 0.0, 0.2))))
    for one, other in zip(*runs, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11)
    for one, copy in zip(runs, copies, strict=True):
        np.testing.assert_allclose(copy, one[0], atol=1e-12)


def test_a_mesh_says_where_its_body_is_drawn():
    """A record knows where its mesh has the body frame, so that the drawing's places are those of the mesh."""
    kept = particle_body(3, modes=2).record
    p, R = POSES["carrier"]
    record = fm.ReducedBody(**{
        **{name: getattr(kept, name) for name in (
            "gram", "stiffness", "damping", "interfaces", "frame", "partition", "partition_names", "provenance")},
        "p_MB_M": p, "R_MB": R,
    })  # fmt: skip
    scene = fm.System(gravity=GRAVITY)
    arm = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(JOINT.Revolute(), scene.ground, arm, at=p + R @ record.interface("root").p_BI_B, axis="z")
    start = scene.at_start()
    np.testing.assert_allclose(start.position(arm.frame("tip"))[0], p + R @ record.interface("tip").p_BI_B, atol=1e-12)


def test_beams_and_pickles():
    """A section of a beam is held where it is drawn; a scene that is pickled has its joints."""
    section = beam_timoshenko.Parameters.rectangle(
        2.1e11, 0.3, 7850.0, width=0.02, height=0.02, orientation=(0.0, 1.0, 0.0)
    )
    runs = []
    for drawn in (True, False):
        scene = fm.System(gravity=GRAVITY)
        points = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
        beam = fm.ExactBeam(points, {"span": [("root", "tip")]}, {"span": section}, 2)
        bob = fm.RigidBody(0.5, (0.01, 0.02, 0.02), (0.0, 0.0, -0.1))
        p, tip = np.array([0.3, 0.2, 0.1]), np.array([1.3, 0.2, 0.1])
        if drawn:
            scene.add(beam, name="beam", p=p)
            scene.add(bob, name="bob", p=tip)
            scene.connect(JOINT.Fixed(), scene.ground, beam, at=p)
            scene.connect(JOINT.Revolute(), beam, bob, at=tip, axis="y")
        else:
            scene.add(beam, name="beam")
            scene.add(bob, name="bob")
            scene.connect(JOINT.Fixed(), scene.ground.frame(p=p), beam.frame("root"))
            scene.connect(JOINT.Revolute("y"), beam.frame("tip"), bob.frame())
        run = pickle.loads(pickle.dumps(scene)).simulate(0.02, h=1e-3, integrator=fm.GeneralizedAlpha())
        runs.append(run.x[-1])
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-9)


def test_what_no_drawing_has():
    scene = fm.System()
    one, two = (scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name) for name in ("one", "two"))
    arm = scene.add(fm.FlexibleBody(particle_body(3, modes=3).record), name="arm", p=(5.0, 0.0, 0.0))
    hinge, at = JOINT.Revolute(), (0.1, 0.0, 0.0)
    for call, text in (
        (lambda: scene.connect(hinge, one.frame(), two, at=at), "connects bodies.*one is a frame"),
        (lambda: scene.connect(hinge, one, two), "with at="),
        (lambda: scene.connect(hinge, one.frame(), two.frame(), axis="z"), r"goes with `at`.*Revolute\(axis\)"),
        (lambda: scene.connect(hinge, one, fm.RigidBody(1.0, (1.0, 1.0, 1.0), name="three"), at=at), "'three'.*add it"),
        (lambda: scene.connect(hinge, one, "two", at=at), "body of the scene"),
        (lambda: scene.connect(hinge, one, one, at=at), "to itself"),
        (lambda: scene.connect(hinge, one, two, at=(0.1, 0.0)), "three finite numbers"),
        (lambda: scene.connect(hinge, one, two, at=(0.1, 0.0, np.nan)), "three finite numbers"),
        (lambda: scene.connect(hinge, one, two, at=at, axis=(0.0, 0.0, 0.0)), "one-two.*no direction"),
        (lambda: scene.connect(hinge, one, two, at=at, axis="w"), "not known"),
        (lambda: scene.connect(JOINT.Universal(), one, two, at=at, axis="x"), "Universal has no single axis"),
        (lambda: scene.connect(JOINT.Fixed(), one, two, at=at, axis="x"), "Fixed has no single axis"),
        (lambda: scene.connect(JOINT.Distance(1.0), one, two, at=at), "frames of a Distance lie apart"),
        (lambda: scene.connect(JOINT.RollingDisc(1.0), one, two, at=at), "frames of a RollingDisc lie apart"),
        (lambda: scene.connect(hinge, one, arm, at=at), "'arm' has no interface at.*nearest, arm.tip.*p=..."),
        (lambda: scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), p=(0.0, 1.0)), "place p"),
        (lambda: scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), R=2.0 * np.eye(3)), "not a rotation"),
    ):
        with pytest.raises(SceneError, match=text):
            call()
    assert len(scene._connections) == 0
    assert len(scene._bodies) == 3
