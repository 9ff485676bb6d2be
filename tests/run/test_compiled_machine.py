"""A machine compiled once: with other values it is to the bit the scene that is built with them."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
from flexmbd import parameter as vary
from flexmbd.errors import AssemblyError, SceneError
from flexmbd.force import Kinematics, inertia_forces

TILT = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
RECORDS = [particle_body(seed, modes=3, damping=2.0).record for seed in (1, 5)]
NOMINAL: dict[str, Any] = {
    "mass": 1.2, "inertia": (0.02, 0.05, 0.05), "com": (0.25, 0.0, 0.0), "place": (0.5, 0.0, 0.0), "axes": np.eye(3),
    "stiffness": 40.0, "rest": 0.0, "damping": 0.1, "length": 0.4, "pull": 30.0, "bush": (50.0,) * 3 + (5.0,) * 3,
    "force": (0.0, -1.0, 0.0), "torque": 0.3, "load": fm.Sine(0.5, 20.0), "table": fm.Table([0.0, 1.0], [0.0, 1.0]),
    "friction": 0.01, "stop": 2.0, "angle": 0.2, "spin": 1.0, "q": (0.0, 0.01, 0.0), "q_rate": (0.0, 0.0, 0.1),
    "drive": fm.Sine(0.2, 5.0), "record": RECORDS[0],
}  # fmt: skip
OTHER: dict[str, Any] = {
    "mass": 3.1, "inertia": np.diag([0.03, 0.05, 0.06]), "com": (0.3, 0.05, -0.02), "place": (1.7, 0.05, 0.0),
    "axes": TILT, "stiffness": 0.0, "rest": 0.4, "damping": 0.7, "length": 0.0, "pull": 90.0,
    "bush": np.diag([9.0, 8.0, 7.0, 3.0, 2.0, 1.0]), "force": (1.0, 2.0, 3.0), "torque": -0.6,
    "load": fm.Sine(0.1, 7.0, 0.3, 0.2), "table": fm.Table([0.0, 0.5], [1.0, -1.0]), "friction": 0.2, "stop": 0.21,
    "angle": -0.3, "spin": -4.0, "q": (0.02, 0.0, 0.0), "q_rate": (0.1, 0.2, 0.0), "drive": fm.Sine(0.1, 9.0, 0.4),
    "record": RECORDS[1],
}  # fmt: skip


@dataclass
class Built:
    scene: fm.System
    parameters: dict[str, Any]
    asked: Any
    joint: Any


def build(**values: Any) -> Built:
    """An arm on a hinge, a flexible body on it, a driven flap, and a strut that closes a loop by penalties."""
    given = {**NOMINAL, **values}
    scene = fm.System(gravity=(0.0, -9.81, 0.5))
    arm = scene.add(fm.RigidBody(given["mass"], given["inertia"], given["com"]), name="arm")
    tail = scene.add(fm.FlexibleBody(given["record"]), name="tail")
    flap = scene.add(fm.RigidBody(0.2, (0.01, 0.01, 0.01), (0.1, 0.0, 0.0)), name="flap")
    place, tip = arm.frame(given["place"], R=given["axes"]), tail.frame("tip")
    ground = scene.ground.frame()
    hinge = scene.connect(fm.joint.Revolute("z"), ground, arm.frame(), name="hinge")
    scene.connect(fm.joint.Universal(), place, tail.frame("root"), name="mount")
    slide = scene.connect(fm.joint.Prismatic("x"), ground, flap.frame(), name="slide")
    lever = scene.add(fm.RigidBody(0.3, (0.01, 0.01, 0.01)), name="lever")
    swing = scene.connect(fm.joint.Revolute("y"), place, lever.frame(), name="swing")
    stay = fm.Penalty(50.0, 1.0)
    scene.connect(fm.joint.Planar(), ground, lever.frame(), name="stay", enforce=stay)
    hinge.position, hinge.velocity = given["angle"], given["spin"]
    tail.q, tail.q_rate = given["q"], given["q_rate"]
    slide.prescribe(given["drive"])
    spring = scene.add_force(fm.force.JointSpring(hinge, given["stiffness"], given["rest"], given["damping"]))
    strut = scene.add_force(fm.force.SpringDamper(flap.frame(), tip, given["pull"], given["length"]))
    bush = scene.add_force(fm.force.Bushing(flap.frame(), place, given["bush"]))
    push = scene.add_force(fm.force.FrameForce(tip, given["force"]))
    torque = scene.add_force(fm.force.JointTorque(hinge, given["torque"]))
    load = scene.add_force(fm.force.JointTorque(swing, given["load"]))
    curve = scene.add_force(fm.force.FrameForce(place, (given["table"], 0.0, 1.0)))
    friction = scene.add_force(fm.force.JointFriction(swing, given["friction"], 0.1))
    stop = scene.add_force(fm.force.JointStop(hinge, -2.0, given["stop"], 100.0))
    parameters = {
        "mass": vary.Mass(arm), "inertia": vary.Inertia(arm), "com": vary.CentreOfMass(arm),
        "place": vary.FrameOrigin(place), "axes": vary.FrameAxes(place), "stiffness": vary.OfForce(spring, "stiffness"),
        "rest": vary.OfForce(spring, "rest"), "damping": vary.OfForce(spring, "damping"),
        "length": vary.OfForce(strut, "length"), "pull": vary.OfForce(strut, "stiffness"),
        "bush": vary.OfForce(bush, "stiffness"), "force": vary.OfForce(push, "force"),
        "torque": vary.OfForce(torque, "value"), "load": vary.OfForce(load, "value"),
        "table": vary.OfForce(curve, "force"), "friction": vary.OfForce(friction, "coulomb"),
        "stop": vary.OfForce(stop, "upper"), "angle": vary.InitialPosition(hinge), "spin": vary.InitialVelocity(hinge),
        "q": vary.ModalPosition(tail), "q_rate": vary.ModalVelocity(tail), "drive": vary.PrescribedMotion(slide),
        "record": vary.BodyRecord(tail),
    }  # fmt: skip
    return Built(scene, parameters, (place, tip, arm.frame()), swing)


def given(name: str, value: Any) -> Any:
    """The value that the machine's parameter takes: the curve is one component of a force."""
    return (value, 0.0, 1.0) if name == "table" else value


def refuse_difference(run: fm.Trajectory, asked: Built, anew: fm.Trajectory, built: Built) -> None:
    for name in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(run, name), getattr(anew, name), err_msg=name)
    assert run.scene.digest() == anew.scene.digest()
    for here, there in zip(asked.asked, built.asked, strict=True):
        np.testing.assert_array_equal(run.position(here), anew.position(there))
        np.testing.assert_array_equal(run.at(run.t[-1]).rotation(here), anew.at(anew.t[-1]).rotation(there))
    np.testing.assert_array_equal(run.energy().total, anew.energy().total)
    end, other = run.at(run.t[-1]), anew.at(anew.t[-1])
    parts = [inertia_forces(Kinematics(m.scene).move(m.t, m.x, m.v, m.a)) for m in (end, other)]
    np.testing.assert_array_equal(*parts)
    np.testing.assert_array_equal(run.reaction(asked.joint), anew.reaction(built.joint))


def simulate(machine: Any, **values: Any) -> fm.Trajectory:
    run: fm.Trajectory = machine.simulate(0.02, rtol=1e-4, integrator=fm.GeneralizedAlpha(), **values)
    return run


@pytest.fixture(scope="module")
def whole() -> tuple[Built, fm.CompiledMachine]:
    built = build()
    return built, built.scene.compile(parameters=built.parameters)


@pytest.mark.parametrize("name", OTHER)
def test_one_value(whole, name):
    built, machine = whole
    anew = build(**{name: OTHER[name]})
    run = simulate(machine, **{name: given(name, OTHER[name])})
    refuse_difference(run, built, simulate(anew.scene), anew)
    assert not np.array_equal(run.x[-1], simulate(machine).x[-1])  # and the value does something


def test_all_values_at_once_and_back(whole):
    built, machine = whole
    other = {name: value for name, value in OTHER.items() if name != "stop"}
    anew = build(**other)
    run = simulate(machine, **{name: given(name, value) for name, value in other.items()})
    refuse_difference(run, built, simulate(anew.scene), anew)
    anew = build()
    refuse_difference(simulate(machine), built, simulate(anew.scene), anew)


def test_a_trajectory_keeps_its_values(whole):
    """Two variants live side by side; each answers with its own numbers, also as a copy."""
    built, machine = whole
    runs = [simulate(machine, place=place) for place in ((0.3, 0.0, 0.0), (1.5, 0.0, 0.0))]
    frame = built.asked[0]
    assert [float(np.linalg.norm(run.position(frame)[0])) for run in runs] == pytest.approx([0.3, 1.5], abs=1e-12)
    for copied, marker in (copy.deepcopy((runs[1], frame)), pickle.loads(pickle.dumps((runs[1], frame)))):
        np.testing.assert_array_equal(copied.position(marker), runs[1].position(frame))
        assert copied.scene.digest() == runs[1].scene.digest()


def test_a_copied_machine_runs_alike(whole):
    machine = whole[1]
    twin = pickle.loads(pickle.dumps(machine))
    values = {name: given(name, value) for name, value in OTHER.items() if name != "stop"}
    np.testing.assert_array_equal(simulate(twin, **values).x, simulate(machine, **values).x)


def test_a_machine_stays_as_it_was_compiled():
    built = build()
    machine = built.scene.compile(parameters=built.parameters)
    before = simulate(machine)
    arm = built.parameters["mass"].body
    arm.mass, built.parameters["spin"].joint.velocity = 9.0, 7.0
    np.testing.assert_array_equal(simulate(machine).x, before.x)
    assert not np.array_equal(simulate(built.scene).x[-1], before.x[-1])


def test_a_restart_is_of_the_same_values(whole):
    _, machine = whole
    full = machine.simulate(0.02, rtol=1e-4, checkpoints=[0.01], mass=2.0)
    rest = machine.simulate(0.02, rtol=1e-4, restart=full.checkpoints[0], mass=2.0)
    np.testing.assert_array_equal(rest.x[-1], full.x[-1])
    with pytest.raises(SceneError, match="checkpoint"):
        machine.simulate(0.02, rtol=1e-4, restart=full.checkpoints[0], mass=2.5)


def test_a_scene_is_not_linearised_about_a_variant(whole):
    built, machine = whole
    with pytest.raises(SceneError, match="with other values of its parameters"):
        built.scene.linearize(about=simulate(machine, mass=2.0))


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        ({"masss": 1.0}, r"no parameter 'masss'; it has mass, inertia"),
        ({"mass": 0.0}, r"with mass = 0\.0: .*mass must be positive"),
        ({"mass": -1.0}, "mass must be positive"),
        ({"inertia": (1.0, 0.1, 0.1)}, "belong to no body"),
        ({"com": (1.0, 2.0)}, "com must be three finite numbers"),
        ({"place": (np.nan, 0.0, 0.0)}, "p must be three finite numbers"),
        ({"axes": np.ones((3, 3))}, "rotation"),
        ({"stiffness": -1.0}, "stiffness = -1.0 must not be negative"),
        ({"stiffness": fm.Table([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])}, "build the scene anew"),
        ({"force": (lambda t: t, 0.0, 0.0)}, "build the scene anew"),
        ({"load": 3.0}, "can only give way to another function of the same kind"),
        ({"load": lambda t: t}, "can only give way"),
        ({"table": (fm.Table([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), 0.0, 1.0)}, "can only give way"),
        ({"drive": 1.0}, "can only give way"),
        ({"angle": None}, "not set"),
        ({"angle": (1.0, 2.0)}, "takes 1 finite number"),
        ({"angle": True}, "takes 1 finite number"),
        ({"q": (1.0,)}, "q takes 3 finite number"),
        ({"record": 3.0}, "ReducedBody"),
        ({"record": particle_body(3, modes=2).record}, "2 modes cannot take the place of one of 3"),
        ({"record": particle_body(3, modes=3).record}, "membrane strains, nonlinear stiffness or gyro"),
    ],
)
def test_values_that_a_machine_cannot_have(whole, values, fault):
    with pytest.raises(SceneError, match=fault):
        simulate(whole[1], **values)


def test_parameters_that_no_machine_has():
    built = build()
    hinge = built.parameters["spin"].joint
    spring = built.parameters["stiffness"].force
    cases = [
        ({"rtol": built.parameters["mass"]}, "cannot be called 'rtol'"),
        ({"two words": built.parameters["mass"]}, "cannot be called"),
        ({"m": "mass"}, r"fm\.parameter\.Mass"),
        ({"m": vary.Mass(fm.RigidBody(1.0, (1.0, 1.0, 1.0), name="stray"))}, "'stray' is not in this scene"),
        ({"k": vary.OfForce(spring, "stifness")}, "it has stiffness, rest, damping, coordinate"),
        ({"p": vary.FrameOrigin(built.asked[1])}, "interface of a flexible body"),
        ({"p": vary.FrameOrigin(built.parameters["mass"].body.frame((1.0, 0.0, 0.0)))}, "no joint and no force"),
        ({"d": vary.PrescribedMotion(hinge)}, "has no prescribed motion"),
        ({"a": vary.InitialPosition(built.joint)}, "is not set"),
        ({"k": []}, "its list is empty"),
        ([built.parameters["mass"]], "parameters must be quantities by name"),
        (
            {"k": vary.OfForce(spring, "stiffness"), "c": [vary.OfForce(spring, "stiffness")]},
            "'k' and 'c' are the same quantity",
        ),
    ]
    for parameters, fault in cases:
        with pytest.raises(SceneError, match=fault):
            built.scene.compile(parameters=parameters)


def test_loops_and_starts_of_joints_held_by_constraints():
    """A four-bar, one joint of which goes by constraints and says where it starts."""

    def four_bar(length=0.5, angle=1.9):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        rods = [scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.02), (0.2, 0.0, 0.0)), name=name) for name in "abc"]
        turn = fm.joint.Revolute("z")
        tip = rods[1].frame((length, 0.0, 0.0))
        scene.connect(turn, scene.ground.frame(), rods[0].frame())
        scene.connect(turn, rods[0].frame((0.3, 0.0, 0.0)), rods[1].frame())
        last = scene.connect(turn, tip, rods[2].frame((0.4, 0.0, 0.0)), way=fm.Way.CONSTRAINTS)
        first = scene.connect(turn, scene.ground.frame((0.6, 0.0, 0.0)), rods[2].frame(), name="last")
        first.position = angle
        return scene, {"length": vary.FrameOrigin(tip), "angle": vary.InitialPosition(first)}, last

    scene, parameters, _ = four_bar()
    machine = scene.compile(parameters=parameters)
    for length, angle in ((0.55, 1.9), (0.5, 1.6), (0.6, 2.2)):
        run = machine.simulate(0.05, length=(length, 0.0, 0.0), angle=angle)
        anew = four_bar(length, angle)[0].simulate(0.05)
        for name in ("t", "x", "v", "multipliers"):
            np.testing.assert_array_equal(getattr(run, name), getattr(anew, name))
    with pytest.raises(AssemblyError):
        machine.simulate(0.05, length=(5.0, 0.0, 0.0))


def test_forces_that_keep_the_whole_scene():
    built = build()
    machine = replace_with_bearing(built).compile(parameters=built.parameters)
    with pytest.raises(SceneError, match="initial coordinates and velocities alone"):
        simulate(machine, mass=2.0)
    simulate(machine, spin=2.0)


def replace_with_bearing(built: Built) -> fm.System:
    built.scene.add_force(fm.force.BearingFriction(built.joint, 0.1, 0.1, radius=0.01))
    return built.scene


def test_one_name_for_several():
    built = build()
    spring = built.parameters["stiffness"].force
    second = built.scene.add_force(replace(spring, rest=1.0))
    both = [vary.OfForce(spring, "stiffness"), vary.OfForce(second, "stiffness")]
    run = simulate(built.scene.compile(parameters={"k": both}), k=7.0)
    anew = build(stiffness=7.0)
    anew.scene.add_force(replace(anew.parameters["stiffness"].force, rest=1.0))
    np.testing.assert_array_equal(run.x, simulate(anew.scene).x)
