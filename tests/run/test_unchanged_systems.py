"""A System in which nothing was changed keeps its plan from run to run; whatever is changed, the next run sees it."""

from __future__ import annotations

import copy
import importlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
import flexmbd.multibody.plan.built_of as built_of_module
from flexmbd.errors import SceneError
from flexmbd.multibody.plan.built_of import OF_FIELDS, OF_FIELDS_ALONE
from flexmbd.multibody.team import Alone

RECORDS = [particle_body(seed, modes=3, damping=2.0).record for seed in (1, 5)]
STRENGTH = {"own": 0.4}
Change = Callable[["Built"], Any]

pytestmark = pytest.mark.filterwarnings("ignore::flexmbd.errors.RangeWarning")


@dataclass(frozen=True, eq=False)
class OwnSpring(fm.force.OnCoordinate):
    """A user's force element whose number is not among its fields."""

    connection: fm.joint.Connection
    coordinate: int = 0

    def assemble(self, table: fm.force.ElementTable) -> None:
        fm.force.JointSpring(self.connection, STRENGTH["own"]).assemble(table)


@dataclass
class Built:
    """A scene and what may be changed of it."""

    scene: fm.System
    bodies: list[Any]
    joints: list[Any]
    arrays: dict[str, Any]
    forces: list[Any] = field(default_factory=list)


def tree(force: Callable[[fm.joint.Connection], Any] | None = None) -> Built:
    """Two rigid links and a flexible one, with springs; the caller keeps all arrays, of frames and joints their own."""
    arrays: dict[str, Any] = {
        "gravity": np.array([0.0, -9.81, 0.3]), "inertia": np.array([0.02, 0.05, 0.05]), "com": [0.25, 0.0, 0.0],
        "place": np.array([0.5, 0.0, 0.0]), "axes": np.eye(3), "bush": np.array([5.0, 6.0, 7.0, 0.5, 0.6, 0.7]),
        "push": [0.0, -1.0, 0.2], "start": np.array([0.3]), "screw": np.array([0.0, 0.0, 1.0]),
    }  # fmt: skip
    scene = fm.System(gravity=arrays["gravity"])
    arm = scene.add(fm.RigidBody(1.2, arrays["inertia"], arrays["com"]), name="arm")
    flap = scene.add(fm.RigidBody(0.2, (0.01, 0.01, 0.01), (0.1, 0.0, 0.0)), name="flap")
    tail = scene.add(fm.FlexibleBody(RECORDS[0]), name="tail")
    place = arm.frame(arrays["place"], R=arrays["axes"])
    hinge = scene.connect(fm.joint.Revolute(arrays["screw"]), scene.ground.frame(), arm.frame(), name="hinge")
    slide = scene.connect(fm.joint.Prismatic("x"), place, flap.frame(), name="slide")
    swing = scene.connect(fm.joint.Universal(), place, tail.frame("root"), name="swing")
    hinge.position, slide.velocity = arrays["start"], 0.1
    arrays |= {"place": place.p_BF_B, "axes": place.R_BF, "start": hinge.position}
    forces = [
        scene.add_force(fm.force.JointSpring(hinge, 3.0, 0.1, 0.01)),
        scene.add_force(fm.force.Bushing(flap.frame(), scene.ground.frame((0.5, 0.1, 0.0)), arrays["bush"])),
        scene.add_force(fm.force.FrameForce(tail.frame("tip"), arrays["push"])),
        scene.add_force(fm.force.JointTorque(hinge, fm.Sine(0.5, 9.0))),
    ]  # fmt: skip
    if force is not None:
        scene.add_force(force(hinge))
    return Built(scene, [arm, flap, tail], [hinge, slide, swing], arrays, forces)


def loop() -> Built:
    """A plane four-bar closed by a hinge, three rows of which are redundant."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    links = [
        scene.add(fm.RigidBody(2.5 * n, (1e-4, n**3, n**3), (0.5 * n, 0.0, 0.0)), name=name)
        for name, n in (("crank", 0.2), ("coupler", 0.6), ("rocker", 0.5))
    ]
    crank, coupler, rocker = links
    hinge = fm.joint.Revolute("z")
    end, pivot = coupler.frame((0.6, 0.0, 0.0)), scene.ground.frame((0.6, 0.0, 0.0))
    joints = [
        scene.connect(hinge, scene.ground.frame(), crank.frame(), name="drive"),
        scene.connect(hinge, crank.frame((0.2, 0.0, 0.0)), coupler.frame(), name="pin"),
        scene.connect(hinge, pivot, rocker.frame(), name="pivot"),
        scene.connect(hinge, end, rocker.frame((0.5, 0.0, 0.0)), name="close"),
    ]
    joints[0].position, joints[0].velocity = 1.2, 6.0
    return Built(scene, links, joints, {"end": end.p_BF_B, "pivot": pivot.p_BF_B})


def put(name: str, *, of: str, k: int = 0, value: Any) -> Change:
    def change(built: Built) -> None:
        setattr(getattr(built, of)[k], name, value)

    return change


def write(name: str, place: Any, value: Any) -> Change:
    def change(built: Built) -> None:
        built.arrays[name][place] = value

    return change


def hang(built: Built) -> None:
    scene = built.scene
    weight = scene.add(fm.RigidBody(0.4, (1e-3, 1e-3, 1e-3)))
    scene.connect(fm.joint.Fixed(), built.bodies[0].frame((0.1, 0.1, 0.0)), weight.frame())


def couple(built: Built) -> None:
    built.scene.couple(fm.joint.RackAndPinion(built.joints[0], built.joints[1], 0.05))


def control(built: Built) -> None:
    signal = fm.Signal("torque")
    built.scene.add_force(fm.force.JointTorque(built.joints[0], signal))
    built.scene.add_controller(lambda t, y: 0.3, period=0.01, inputs=[signal])


def pull(built: Built) -> None:
    built.scene.add_force(fm.force.JointDamper(built.joints[0], 0.3))


TREE: dict[str, Change] = {
    "mass": put("mass", of="bodies", value=2.0),
    "inertia": put("inertia", of="bodies", value=(0.03, 0.06, 0.08)),
    "inertia in place": write("inertia", 2, 0.06),
    "com": put("com", of="bodies", k=1, value=(0.2, 0.0, 0.0)),
    "com in place": write("com", 1, 0.1),
    "gravity": lambda built: setattr(built.scene, "gravity", (0.0, -1.62, 0.0)),
    "gravity in place": write("gravity", 1, -1.62),
    "a frame's place in place": write("place", 1, 0.2),
    "a frame's axes in place": write("axes", slice(None), np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0, 0, 1.0]])),
    "a joint's axis in place": write("screw", 0, 0.5),
    "a force's numbers in place": write("bush", 0, 50.0),
    "a force's list in place": write("push", 1, -3.0),
    "position": put("position", of="joints", value=-0.4),
    "position in place": write("start", 0, -0.4),
    "position let go": put("position", of="joints", value=None),
    "velocity": put("velocity", of="joints", k=1, value=0.7),
    "a motion": lambda built: built.joints[1].prescribe(fm.Sine(0.02, 5.0)),
    "way": put("way", of="joints", k=1, value=fm.Way.CONSTRAINTS),
    "enforce": put("enforce", of="joints", k=1, value=fm.Penalty(100.0, 1.0)),
    "joint": put("joint", of="joints", k=2, value=fm.joint.Spherical()),
    "parent": lambda built: setattr(built.joints[2], "parent", built.bodies[0].frame((0.3, 0.0, 0.0))),
    "modes": put("q", of="bodies", k=2, value=(0.0, 0.02, 0.0)),
    "rates of modes": put("q_rate", of="bodies", k=2, value=(0.0, 0.0, 0.1)),
    "a body more": hang,
    "a force more": pull,
    "a coupling": couple,
    "a controller": control,
}  # fmt: skip
LOOP: dict[str, Change] = {
    "mass": put("mass", of="bodies", k=1, value=3.0),
    "length in place": write("end", 0, 0.55),
    "pivot in place": write("pivot", 1, 0.05),
    "velocity": put("velocity", of="joints", value=-3.0),
    "position": put("position", of="joints", value=1.3),
    "gravity": lambda built: setattr(built.scene, "gravity", (0.0, 0.0, 0.0)),
    "closing joint": put("joint", of="joints", k=3, value=fm.joint.PointOnLine("z")),
    "enforce": put("enforce", of="joints", k=3, value=fm.Penalty(1e5, 10.0)),
    "a force more": pull,
}
CASES = [(tree, name, change) for name, change in TREE.items()]
CASES += [(loop, name, change) for name, change in LOOP.items()]


def rows(scene: fm.System) -> tuple[np.ndarray, ...]:
    run = scene.simulate(0.05, rtol=1e-5)
    return run.t, run.x, run.v, run.a, run.multipliers


def same(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> bool:
    return all(np.array_equal(here, there) for here, there in zip(one, other, strict=True))


@pytest.mark.parametrize(("build", "name", "change"), CASES, ids=[f"{b.__name__}-{name}" for b, name, _ in CASES])
def test_whatever_is_changed_is_seen_by_the_next_run(build: Callable[[], Built], name: str, change: Change) -> None:
    used, fresh = build(), build()
    before = [rows(used.scene) for _ in range(3)]
    change(used)
    change(fresh)
    after = [rows(used.scene) for _ in range(2)]
    wanted = rows(fresh.scene)
    assert all(same(one, wanted) for one in after)
    assert not same(wanted, before[0])


@pytest.mark.parametrize("build", [tree, loop])
def test_an_unchanged_system_runs_alike_in_the_same_plan(build: Callable[[], Built]) -> None:
    built = build()
    first = built.scene.simulate(0.05, rtol=1e-5)
    kept = [part.copy() for part in (first.t, first.x, first.v, first.a, first.multipliers)]
    for part in (first.x, first.v, first.a, first.multipliers):
        part[:] = np.nan  # a run's rows are the user's
    again = [built.scene.simulate(0.05, rtol=1e-5) for _ in range(3)]
    assert all(same((run.t, run.x, run.v, run.a, run.multipliers), tuple(kept)) for run in again)
    assert all(run.scene.plan.frames is first.scene.plan.frames for run in again)


@pytest.mark.parametrize("build", [tree, loop])
def test_an_unchanged_system_is_not_read_again(build: Callable[[], Built], monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither what is frozen nor the values of what is not, so that large scenes are compared by their parts alone."""
    built = build()
    read, counted = built_of_module.built_of, []

    def counting(parts: built_of_module.GivenParts) -> Any:
        counted.append(parts)
        return read(parts)

    monkeypatch.setattr(built_of_module, "built_of", counting)
    for _ in range(3):
        built.scene.simulate(0.01)
    assert len(counted) == 1
    built.bodies[0].mass = float(f"{built.bodies[0].mass}")  # another number of the same value
    plans = [built.scene.simulate(0.01).scene.plan for _ in range(3)]
    assert len(counted) == 2
    assert all(plan.frames is plans[0].frames for plan in plans)
    built.scene._bodies.reverse()
    built.scene.simulate(0.01)
    assert len(counted) == 3


def test_a_name_that_is_changed_is_told() -> None:
    built = tree()
    built.scene.simulate(0.01)
    built.joints[0].name = "elbow"
    built.bodies[2].name = "blade"
    names = "".join(built.scene.simulate(0.01).scene.velocity_names)
    assert "elbow.angle" in names
    assert "blade.q[0]" in names
    built.joints[1].name = "elbow"
    with pytest.raises(SceneError, match="elbow"):
        built.scene.simulate(0.01)


def test_what_functions_read_outside_is_read_anew() -> None:
    """Forces of the user's own and functions in Python may read what no value of the scene shows."""

    def own_law(t: float, beta: float, rate: float) -> float:
        return -STRENGTH["own"] * beta

    for force in (OwnSpring, lambda joint: fm.force.JointLaw(joint, own_law)):
        used = tree(force)
        for _ in range(3):
            before = rows(used.scene)
        STRENGTH["own"] += 2.0
        assert same(rows(used.scene), rows(tree(force).scene))
        assert not same(rows(used.scene), before)


def test_what_a_body_cannot_be_is_refused_after_a_run() -> None:
    built = tree()
    built.bodies[0].as_measured = True
    built.bodies[0].inertia = (0.01, 0.01, 0.05)
    built.scene.simulate(0.01)
    built.bodies[0].as_measured = False
    with pytest.raises(SceneError, match="belong to no body"):
        built.scene.simulate(0.01)


def test_truth_is_still_no_number() -> None:
    built = tree()
    built.bodies[0].mass = 1.0
    built.scene.simulate(0.01)
    built.bodies[0].mass = True
    with pytest.raises(SceneError, match="mass"):
        built.scene.simulate(0.01)


def test_copies_have_plans_of_their_own() -> None:
    for build in (tree, loop):
        built = build()
        wanted, *_ = [rows(built.scene) for _ in range(3)]
        for copied in (copy.deepcopy(built), pickle.loads(pickle.dumps(built))):
            assert same(rows(copied.scene), wanted)
            copied.bodies[0].mass *= 2.0
            assert not same(rows(copied.scene), wanted)
        assert same(rows(built.scene), wanted)


def test_another_team_builds_anew() -> None:
    built = tree()
    first = built.scene.simulate(0.01)
    built.scene.team = Alone()
    assert built.scene.simulate(0.01).scene.plan.frames is not first.scene.plan.frames


def test_a_start_that_is_wrong_is_told_each_time() -> None:
    built = loop()
    built.joints[0].velocity, built.joints[2].velocity = 6.0, 6.0
    for _ in range(3):
        with pytest.warns(fm.StartWarning, match="velocities"):
            built.scene.simulate(0.01)


def test_loops_that_a_motion_tears_are_told_each_time() -> None:
    """A plate on two hinges is driven, from rest, where at the start the second hinge says nothing new."""
    scene = fm.System()
    plate = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="plate")
    driven = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), plate.frame(), name="driven")
    place = (0.5, 0.0, 0.0)
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(place), plate.frame(place), name="second")
    driven.prescribe(fm.Sine(0.5, 10.0, phase=0.5 * np.pi, offset=-0.5))
    ends = []
    for _ in range(4):
        with pytest.raises(fm.SimulationError, match=r"forbid the prescribed motion of 'driven\.angle'") as told:
            scene.simulate(0.5, integrator=fm.ExplicitRungeKutta())
        ends.append(told.value.trajectory.x)
    assert all(np.array_equal(end, ends[0]) for end in ends)


@pytest.mark.parametrize("name", [*OF_FIELDS, *OF_FIELDS_ALONE])
def test_what_is_compared_by_its_fields_is_there(name: str) -> None:
    module, _, own = name.rpartition(".")
    found = getattr(importlib.import_module(f"flexmbd.multibody.{module}"), own)
    assert isinstance(found, type)
    # what is frozen is not read again
    assert found.__dataclass_params__.frozen  # type: ignore[attr-defined]
