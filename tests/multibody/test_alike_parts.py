"""Scenes of many like parts are laid out at once, to the arrays that they have part by part."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from large_machines import HINGE, brick

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.kernels.base.components import components


class OneByOne(fm.force.SpringDamper):
    """A spring that enters its row by itself, as a user's force does."""

    def assemble(self, table):
        super().assemble(table)


def net(kind, *, seed=3, **options):
    """Points on springs, some of these without stiffness, on others twice, with other forces between; its parts."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    frames, joints = [], []
    for k in range(12):
        if k % 3 == 2:
            body, joint = scene.add(brick(), name=f"brick {k}"), fm.joint.Planar("z")
        else:
            body, joint = scene.add(fm.PointMass(0.1 * (1 + k % 2)), name=f"point {k}"), fm.joint.PlanarPoint("z")
        frames.append(body.frame())
        joints.append(scene.connect(joint, scene.ground.frame((0.1 * k, 0.0, 0.0)), frames[-1], name=f"joint {k}"))
        if k % 4 != 3:
            joints[-1].position = [0.9 * k, 0.1 * rng.random(), *[0.2][: len(joint.start) - 2]]
    frames.append(frames[2].body.frame((0.1, 0.2, 0.3)))
    frames.append(scene.ground.frame((-1.0, 0.0, 0.0)))
    springs = []
    for k in range(40):
        one, other = rng.choice(len(frames), 2, replace=False)
        stiffness, damping = ((0.0, 0.0), (30.0, 0.0), (0.0, 2.0), (50, 1))[k % 4]
        spring = kind(frames[one], frames[other], stiffness, rng.random(), damping)
        springs.append(scene.add_force(spring))
        if k in (7, 8, 20):
            scene.add_force(fm.force.FrameForce(frames[one], (0.0, 1.0 + k, 0.0)))
        if k == 30:
            scene.add_force(springs[3])
    return scene, springs, joints


def arrays_of(scene):
    """All arrays of a plan but addresses."""
    found = {name: part for name, part in scene.plan.fields().items() if name not in ("lapack", "flag", "times")}
    return {**found, "start": scene.start, "full": scene.group_full, "of": scene.group_of}


def test_springs_in_runs_are_those_one_by_one():
    """The plan to the bit, the names, and where each spring's rows and numbers stand."""
    (one, springs, _), (other, single, _) = net(fm.force.SpringDamper), net(OneByOne)
    many, apart = one.compile().scene, other.compile().scene
    for (name, expected), part in zip(arrays_of(apart).items(), arrays_of(many).values(), strict=True):
        np.testing.assert_array_equal(part, expected, err_msg=name)
    assert many.extent == apart.extent
    assert [name.replace("SpringDamper", "OneByOne") for name in many.element_names] == list(apart.element_names)
    assert many.element_names[1:3] == tuple(many.element_names)[1:3]
    assert [name.replace("SpringDamper", "OneByOne") for name in many.idle_elements] == list(apart.idle_elements)
    for spring, same in zip(springs, single, strict=True):
        assert many.index.forces[spring] == apart.index.forces[same] == many.index.forces.get(spring)
        assert many.sources.forces[spring] == apart.sources.forces[same]
    assert many.index.forces.get(single[0]) is None
    assert len(many.index.forces) == len(apart.index.forces)


@pytest.mark.parametrize("again", [lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy])
def test_a_copy_knows_its_springs(again):
    scene, springs, _ = net(fm.force.SpringDamper)
    made = scene.compile().scene
    there, known = again((made, springs))
    for spring, same in zip(springs, known, strict=True):
        assert there.index.forces[same] == made.index.forces[spring]
    assert list(there.element_names) == list(made.element_names)


def test_a_spring_of_a_run_varies():
    """As that of a scene built with its number, though it does nothing in the scene that was compiled."""
    scene, springs, _ = net(fm.force.SpringDamper)
    machine = scene.compile(parameters={"k": fm.parameter.OfForce(springs[4], "stiffness")})
    other, same, _ = net(fm.force.SpringDamper)
    place = other._forces.index(same[4])
    other._forces[place] = fm.force.SpringDamper(same[4].frame_F, same[4].frame_G, 70.0, same[4].length)
    np.testing.assert_array_equal(machine.simulate(0.1, k=70.0, h=1e-3).x, other.simulate(0.1, h=1e-3).x)


def test_what_may_not_turn_a_point_is_refused_in_a_run():
    """A spring is named by its frames where a frame's body is no part of the scene."""
    scene, springs, _ = net(fm.force.SpringDamper)
    stranger = fm.RigidBody(1.0, (1.0, 1.0, 1.0), name="stranger")
    with pytest.raises(SceneError, match="stranger"):
        scene.add_force(fm.force.SpringDamper(springs[0].frame_F, stranger.frame(), 1.0, 1.0))


def test_joints_alike_and_those_that_cannot_be_hashed():
    """An axis in a list, in an array, or by its name: one plan."""
    plans = []
    for axis in ("z", [0.0, 0.0, 1.0], np.array([0.0, 0.0, 1.0])):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        end = scene.ground.frame()
        for k in range(3):
            link = scene.add(brick(), name=f"link {k}")
            scene.connect(fm.joint.Cylindrical(axis), end, link.frame(), name=f"joint {k}").position = (0.1, 0.2)
            end = link.frame((0.5, 0.0, 0.0))
        point = scene.add(fm.PointMass(0.3), name="point")
        scene.connect(fm.joint.PlanarPoint(axis), scene.ground.frame(), point.frame(), name="slide").position = (1, 2)
        plans.append(scene.compile().scene)
    for other in plans[1:]:
        np.testing.assert_array_equal(other.plan.tree, plans[0].plan.tree)
        # a vector lays x and y otherwise than a name does
        np.testing.assert_array_equal(other.plan.frames, plans[1].plan.frames)


def test_bodies_alike_have_their_own_numbers():
    """Rows of masses that are equal, that are not, and that were changed later."""
    scene, bodies = fm.System(), []
    ones, aside = (1.0, 1.0, 1.0), (0.1, 0.0, 0.0)
    for k, (mass, inertia, com) in enumerate(
        [(1.0, ones, aside), (1, ones, aside), (2.0, np.eye(3), [0.0, 0.2, 0.0])] * 2
    ):
        bodies.append(scene.add(fm.RigidBody(mass, inertia, com), name=f"body {k}"))
        scene.connect(fm.joint.Free(), scene.ground.frame(), bodies[-1].frame())
    bodies[3].mass = 5.0
    rows = scene.compile().scene.plan.rigid
    np.testing.assert_array_equal(rows[:, 0], [1.0, 1.0, 2.0, 5.0, 1.0, 2.0])
    np.testing.assert_array_equal(rows[[0, 2, 3], 1:4], [[0.1, 0.0, 0.0], [0.0, 0.4, 0.0], [0.5, 0.0, 0.0]])
    bodies[4].mass = True
    with pytest.raises(SceneError, match="body 4"):
        scene.compile()


@pytest.mark.parametrize("seed", range(5))
def test_components(seed):
    """By the powers of the matrix of what hangs together."""
    rng = np.random.default_rng(seed)
    n = 40
    one, other = rng.integers(0, n, (2, int(rng.integers(0, 50))))
    joined = np.eye(n, dtype=bool)
    joined[one, other] = joined[other, one] = True
    for _ in range(6):
        joined = joined @ joined
    np.testing.assert_array_equal(components(n, one, other), joined.argmax(axis=1))
    chain = rng.permutation(2000)
    assert (components(2000, chain[:-1], chain[1:]) == 0).all()


def test_a_class_is_known_by_its_objects_alone_where_these_tell():
    """One object of a class has what a force needs, and the next one has not."""

    class Half:
        def __init__(self, *, whole):
            if whole:
                self.check = self.assemble = lambda *_: None

        connections = frames = ()

    for _ in range(2):
        refuse_other(Half(whole=True), Force, "a force", wanted="a force")
        with pytest.raises(SceneError, match="a force must be"):
            refuse_other(Half(whole=False), Force, "a force", wanted="a force")


def test_a_hinge_on_each_of_many_bodies():
    """Reversed steps of one joint object keep their rows in the order of its coordinates."""
    scene = fm.System()
    joint = fm.joint.Universal()
    inner, outer = (scene.add(brick(), name=name) for name in ("inner", "outer"))
    scene.connect(HINGE, scene.ground.frame(), inner.frame())
    turned = scene.connect(joint, outer.frame(), inner.frame((1.0, 0.0, 0.0)))
    made = scene.compile().scene
    rows = made.index.links[turned]
    assert len(rows) == 2
    start = made.index.joints[turned].v.start
    np.testing.assert_array_equal(made.plan.tree[list(rows), 5], [start, start + 1])
