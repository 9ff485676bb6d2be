"""Arguments of other types than are asked for, and attributes that are changed when the body is made."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError


def pendulum(body=None):
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bar = scene.add(body or fm.RigidBody(1.0, (0.01, 0.02, 0.02), com=(0.5, 0, 0)), name="bar")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bar.frame(), name="hinge")
    hinge.position = 0.3
    return scene, bar, hinge


def solid(**more):
    return fm.PseudoRigidBody(fm.Solid.box((1.0, 1.0, 1.0), density=1.0), fm.StVenantKirchhoff(1e3, 0.3), **more)


def test_what_is_changed_later_is_what_counts():
    """Mass, centre and inertia of a compiled scene's body: the acceleration is m g d cos / (I + m d^2) of the new."""
    scene, bar, _ = pendulum()
    mass, inertia, place = 1.0, 0.02, 0.5
    for name, value in (("inertia", (0.01, 5.0, 5.0)), ("mass", 3.0), ("com", (0.25, 0.0, 0.0))):
        scene.start()
        setattr(bar, name, value)
        mass, inertia, place = bar.mass, bar.inertia[1], bar.com[0]
        expected = mass * 9.81 * place * np.cos(0.3) / (inertia + mass * place**2)
        assert scene.start().a[0] == pytest.approx(expected, rel=1e-12)
    tensor = np.diag([0.01, 5.0, 5.0])
    bar.inertia = tensor
    tensor[1, 1] = tensor[2, 2] = 0.5  # in place
    assert scene.start().a[0] == pytest.approx(3.0 * 9.81 * 0.25 * np.cos(0.3) / (0.5 + 3.0 / 16), rel=1e-12)
    np.testing.assert_allclose(bar.principal_axes()[0], [0.01, 0.5, 0.5])
    scene.gravity = (0.0, 0.0, -1.0)
    assert scene.start().a[0] == pytest.approx(3.0 * 0.25 * np.cos(0.3) / (0.5 + 3.0 / 16), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("mass", -1.0, r"rigid body 'bar': mass must be positive, got -1\.0"),
        ("inertia", (1.0, 1.0, 5.0), "rigid body 'bar': principal inertias"),
        ("com", (0.0, 0.0), "rigid body 'bar': com must be three finite numbers"),
    ],
)
def test_what_is_wrong_later_is_told_when_the_scene_is_compiled(name, value, fault):
    scene, bar, _ = pendulum()
    setattr(bar, name, value)
    with pytest.raises(SceneError, match=fault):
        scene.compile()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("solid", fm.Solid.box((2.0, 1.0, 1.0), density=1.0)),
        ("material", fm.StVenantKirchhoff(1e6, 0.3)),
        ("damping", 0.5),
        ("rigid", True),
    ],
)
def test_what_frames_follow_from_cannot_be_changed(name, value):
    body = solid()
    with pytest.raises(SceneError, match=f"PseudoRigidBody without a name: its {name} cannot be changed"):
        setattr(body, name, value)
    body.stretch = 1.1 * np.eye(3)  # which is where it starts
    assert body.start()[0].any()


def test_a_record_cannot_be_changed():
    record = solid().reduced()
    body = fm.FlexibleBody(record, name="arm")
    with pytest.raises(SceneError, match="FlexibleBody arm: its record cannot be changed, as its frames follow"):
        body.record = record


WRONG = {
    "mass": (lambda _: fm.RigidBody("abc", (1, 1, 1)), "rigid body: mass must be positive, got 'abc'"),
    "mass of several": (lambda _: fm.RigidBody([1.0, 2.0], (1, 1, 1)), r"mass must be positive, got \[1\.0, 2\.0\]"),
    "digits": (lambda _: fm.RigidBody("5", (1, 1, 1)), "rigid body: mass must be positive, got '5'"),
    "inertia": (lambda _: fm.RigidBody(1.0, "abc"), r"inertia must be \(3,\) or \(3, 3\) and finite, got 'abc'"),
    "com": (lambda _: fm.RigidBody(1.0, (1, 1, 1), (0, None, 0)), "com must be three finite numbers"),
    "p": (lambda p: p[1].frame("end"), r"p must be three finite numbers \(m\), got 'end'"),
    "R": (lambda p: p[1].frame(R="xyz"), "R: expected a finite rotation matrix"),
    "density": (lambda _: fm.Solid.box((1, 1, 1), density="steel"), "density must be positive"),
    "sides": (lambda _: fm.Solid.box("abc", density=1.0), "sides of a box must be three positive numbers"),
    "damping": (lambda _: solid(damping="none"), "damping must not be negative, got none"),
    "body": (lambda p: p[0].add(5), "a body must be a RigidBody, .* or ExactBeam, got 5"),
    "body's class": (lambda p: p[0].add(fm.RigidBody), "got the class RigidBody itself; call it"),
    "joint's class": (
        lambda p: p[0].connect(fm.joint.Fixed, p[0].ground.frame(), p[1].frame()),
        "a joint must be a joint as fm.joint.Revolute.*, got the class Fixed itself",
    ),
    "no frame": (
        lambda p: p[0].connect(fm.joint.Fixed(), p[0].ground, p[1].frame()),
        r"what a joint connects must be a frame as body.frame\(\), or bodies with at=, got Ground",
    ),
    "position": (lambda p: setattr(p[2], "position", "up"), r"position of a Revolute takes 1 finite number\(s\)"),
    "truth as position": (lambda p: setattr(p[2], "position", True), r"takes 1 finite number\(s\), got True"),
    "numpy's truth": (lambda p: setattr(p[2], "velocity", np.bool_(True)), r"takes 1 finite number\(s\)"),
    "truths": (lambda p: setattr(p[2], "position", np.array([True])), r"takes 1 finite number\(s\)"),
    "truth among numbers": (lambda _: fm.RigidBody(1.0, (1, 1, 1), (0.0, True, 0.0)), "com must be three finite numb"),
    "truth as mass": (lambda _: fm.RigidBody(True, (1, 1, 1)), "mass must be positive, got True"),
    "truth as motion": (lambda p: p[2].prescribe(True), "bool is not a function of time"),
    "truth as torque": (
        lambda p: (p[0].add_force(fm.force.JointTorque(p[2], np.bool_(1))), p[0].start()), "not a function of time"
    ),
    "truth as stiffness": (lambda p: p[0].add_force(fm.force.JointSpring(p[2], True)), "stiffness = True is not a fin"),
    "truth in a table": (lambda p: p[2].prescribe(fm.Table([0, 1], [0.0, True])), "a table needs numbers t and y"),
    "truth as rtol": (lambda p: p[0].simulate(1.0, rtol=True), "rtol = True must lie between"),
    "truth as step": (lambda p: p[0].simulate(1.0, h=True), "the step h = True s must be positive"),
    "truth as end": (lambda p: p[0].simulate(True), "t_end = True s must lie after"),
    "truth as limit": (lambda p: p[0].simulate(1.0, max_steps=True), "max_steps = True must be a positive whole"),
    "truth as force": (
        lambda p: p[0].add_force(fm.force.FrameForce(p[1].frame(), (True, 0.0, 0.0))), "a component is not a finite num"
    ),
    "truth as pitch": (lambda _: fm.joint.Screw(True), "pitch"),
    "truth as period of checkpoints": (
        lambda p: p[0].simulate(1.0, checkpoint_file="a.h5", checkpoint_every=True), "checkpoint_every = True s must be"
    ),
    "axis": (lambda _: fm.joint.Revolute(("a", 0, 1)), "has no direction; give three numbers"),
    "ratio": (lambda p: fm.joint.Gear(p[2], p[2], "two"), "the ratio must be finite and not 0, got 'two'"),
    "force": (lambda p: p[0].add_force(5), "a force must be a force element as .*, got 5"),
    "coupling": (lambda p: p[0].couple(p[2]), r"a coupling must be fm.joint.Gear\(...\) or "),
    "stiffness": (lambda p: p[0].add_force(fm.force.JointSpring(p[2], "soft")), "stiffness = soft is not a finite num"),
    "limit": (lambda p: p[0].add_force(fm.force.JointStop(p[2], "a", "b", 1.0)), "lower = a must lie below upper = b"),
    "components": (lambda p: p[0].add_force(fm.force.FrameForce(p[1].frame(), 3.0)), "force takes three components"),
    "sine": (lambda p: p[2].prescribe(fm.Sine("a", 1.0)), "motion of joint 'hinge': a sine takes finite numbers"),
    "endless sine": (lambda p: p[2].prescribe(fm.Sine(np.inf, 1.0)), "a sine takes finite numbers"),
    "gravity": (lambda _: fm.System(gravity="down"), "gravity must be three finite numbers"),
    "gravity later": (
        lambda p: (setattr(p[0], "gravity", -9.81), p[0].start()), "gravity must be three finite numbers"
    ),
    "t_end": (lambda p: p[0].simulate("1 s"), "t_end = 1 s s must lie after the start"),
    "step": (lambda p: p[0].simulate(1.0, h="small"), "the step h = small s must be positive and finite"),
    "rtol": (lambda p: p[0].simulate(1.0, rtol=1e-300), r"rtol = 1e-300 must lie between 2\.2e-14, a hundred times"),
    "rtol in words": (lambda p: p[0].simulate(1.0, rtol="fine"), "rtol = fine must lie between"),
    "checkpoints": (lambda p: p[0].simulate(1.0, checkpoints=["a"]), "checkpoints must be a list of times"),
    "method's class": (
        lambda p: p[0].simulate(1.0, integrator=fm.RadauIIA), "got the class RadauIIA itself; call it"
    ),
    "no method": (
        lambda p: p[0].simulate(1.0, integrator=None), r"integrator must be a method, as fm.RadauIIA\(\), or .* None"
    ),
    "no method to explain": (lambda p: p[0].explain(integrator=3), "integrator must be a method"),
    "one event": (
        lambda p: p[0].simulate(1.0, events=fm.Event(lambda m: 1.0)), r"events must be a list of events, \[event\]"
    ),
    "no event": (lambda p: p[0].simulate(1.0, events=[lambda m: 1.0]), "an event must be an fm.Event"),
    "about": (lambda p: p[0].simulate(1.0, about=p[0].start()), r"about must be what scene.equilibrium\(\) gives"),
    "linear about": (lambda p: p[0].linearize(about=0.0), r"about must be what scene.equilibrium\(\) gives, or a traj"),
    "input": (lambda p: p[0].linearize(inputs=[1.0]), "an input must be a force element, or a joint"),
    "restart": (lambda p: p[0].simulate(1.0, restart="a.h5"), "restart must be a checkpoint"),
    "bar of progress": (lambda p: p[0].simulate(1.0, progress="no"), "progress must be True or False, got 'no'"),
    "stop": (lambda _: fm.Event(lambda m: 1.0, stop="no"), "stop must be True or False"),
    "subcycle": (lambda _: fm.CentralDifference(subcycle="off"), "subcycle must be True or False"),
    "monotone": (lambda p: p[2].prescribe(fm.Table([0, 1], [0, 1], monotone="no")), "monotone must be True or False"),
    "rigid": (lambda _: solid(rigid="no"), "rigid must be True or False"),
    "way": (lambda p: setattr(p[2], "way", "constraints"), "its way must be fm.Way.COORDINATES or CONSTRAINTS"),
    "enforce": (lambda p: setattr(p[2], "enforce", 1e6), r"what enforces it must be fm.Multipliers\(\), "),
    "enforce without constraints": (
        lambda p: (setattr(p[2], "way", fm.Way.COORDINATES), setattr(p[2], "enforce", fm.Multipliers())),
        "goes by coordinates, which leave nothing to enforce",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_named(what):
    call, fault = WRONG[what]
    with pytest.raises(SceneError, match=fault):
        call(pendulum())


def test_a_refused_change_of_a_joint_changes_nothing():
    scene, _, hinge = pendulum()
    with pytest.raises(SceneError):
        hinge.enforce = "penalty"
    assert hinge.enforce is None
    hinge.enforce = fm.Penalty(1e6)
    assert len(scene.start().scene.plan.penalties) > 0


def test_a_position_and_a_velocity_are_unset_by_none():
    """So a joint that was set may be prescribed after all."""
    scene, _, hinge = pendulum()
    hinge.velocity = 2.0
    hinge.prescribe(fm.Sine(0.1, 3.0, offset=0.5))
    with pytest.raises(SceneError, match="leave out the position, or set it to None"):
        scene.start()
    hinge.position = hinge.velocity = None
    assert (hinge.position, hinge.velocity) == (None, None)
    assert scene.start().x[0] == pytest.approx(0.5)


def test_a_method_of_the_users_own_is_taken_by_what_it_has():
    """No base class is asked for: what answers the protocol is an integrator."""
    scene, *_ = pendulum()
    rule = fm.ExplicitRungeKutta()
    own = SimpleNamespace(name="mine", order=rule.order, check=rule.check, stepper=rule.stepper)
    assert scene.simulate(0.1, integrator=own).stats.integrator == "mine"


def test_what_is_given_as_an_array_may_be_used_again():
    """Places and axes of frames, and positions of joints, are those of when they were given."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    place, axes, frames = np.zeros(3), np.eye(3), []
    for _ in range(3):
        frames.append(body.frame(p=place, R=axes))
        place[0] += 0.5
        axes[:] = axes @ [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    assert [frame.p_BF_B[0] for frame in frames] == [0.0, 0.5, 1.0]
    assert [frame.R_BF[0, 0] for frame in frames] == [1.0, 0.0, -1.0]
    joint = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    given = np.array([1.0, 0.0, 0.0, 0.0])
    joint.position = given
    given[0] = 2.0
    assert joint.position[0] == 1.0
