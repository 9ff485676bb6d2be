"""A simulation that begins where the machine has settled."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError


def lever(weight: float = 0.5):
    """A four-bar whose coupler sags on a spring."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    turn = fm.joint.Revolute("z")
    bars = [scene.add(fm.RigidBody(weight, (1e-3, 1e-2, 1e-2), (0.25, 0.0, 0.0)), name=name) for name in "abc"]
    first = scene.connect(turn, scene.ground.frame(), bars[0].frame(), name="crank")
    scene.connect(turn, bars[0].frame((0.5, 0.0, 0.0)), bars[1].frame())
    scene.connect(turn, bars[1].frame((0.5, 0.0, 0.0)), bars[2].frame())
    scene.connect(turn, bars[2].frame((0.5, 0.0, 0.0)), scene.ground.frame((0.8, 0.0, 0.0)))
    scene.add_force(fm.force.JointSpring(first, 8.0, 1.0))
    first.position = 1.0
    return scene, bars[1].frame()


def test_a_loop_stays_where_it_has_settled():
    scene, frame = lever()
    settled = scene.equilibrium()
    run = scene.simulate(1.0, rtol=1e-6, about=settled)
    assert np.ptp(run.position(frame), axis=0).max() < 1e-8
    assert run.position(frame)[0] == pytest.approx(settled.position(frame), abs=1e-12)
    # from where its joints are given it swings
    assert np.ptp(scene.simulate(1.0, rtol=1e-6).position(frame), axis=0).max() > 0.1


def test_a_joint_held_by_constraints_is_where_it_has_settled_not_where_it_was_given():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bar = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.5, 0.0, 0.0)), name="bar")
    turn = fm.joint.Revolute("z")
    hinge = scene.connect(turn, scene.ground.frame(), bar.frame(), name="hinge", way=fm.Way.CONSTRAINTS)
    hinge.position = -1.0
    settled = scene.equilibrium()
    assert settled.position(bar.frame((1.0, 0.0, 0.0))) == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    run = scene.simulate(0.5, rtol=1e-8, about=settled)
    np.testing.assert_allclose(run.position(bar.frame((1.0, 0.0, 0.0))), [[0.0, -1.0, 0.0]] * len(run.t), atol=1e-7)


def test_a_state_of_another_scene_is_refused():
    other = fm.System()
    body = other.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
    hinge = other.connect(fm.joint.Revolute("z"), other.ground.frame(), body.frame(), name="hinge")
    other.add_force(fm.force.JointSpring(hinge, 1.0, 0.0))
    scene, _ = lever()
    with pytest.raises(SceneError, match="another scene"):
        scene.simulate(1.0, about=other.equilibrium())
