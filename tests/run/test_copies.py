"""Machines, compiled scenes and trajectories that were pickled or deep-copied answer as the first ones do."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base import plan_layout as at


def swinging(t):
    """The functions are pickled by the name of this module."""
    return 0.3 * np.sin(2.0 * t)


def damping(t, beta, rate):
    return -0.2 * rate


def pendulum():
    """A pendulum of two links that Python and compiled functions drive, and a run of it."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    upper, lower = (
        scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.03), (0.2, 0.0, 0.0)), name=name) for name in ("upper", "lower")
    )
    shoulder = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), upper.frame())
    elbow = scene.connect(fm.joint.Revolute("y"), upper.frame((0.4, 0.0, 0.0)), lower.frame())
    scene.add_force(fm.force.JointTorque(shoulder, swinging))
    scene.add_force(fm.force.JointLaw(elbow, damping))
    scene.add_force(fm.force.JointTorque(elbow, fm.compiled(lambda t: 0.1 * t)))
    return scene, shoulder, elbow, lower.frame((0.3, 0.0, 0.0))


@pytest.fixture(scope="module")
def run():
    scene, *asked = pendulum()
    return scene, scene.simulate(0.05, h=0.01, integrator=fm.GeneralizedAlpha()), asked


def through_pickle(things):
    return pickle.loads(pickle.dumps(things))


@pytest.mark.parametrize("copied", [through_pickle, copy.deepcopy])
def test_a_copied_trajectory_answers_for_the_copied_bodies(run, copied):
    scene, first, asked = run
    _, again, (shoulder, elbow, tip) = copied((scene, first, asked))
    for answer in ("position", "acceleration"):
        np.testing.assert_array_equal(getattr(again, answer)(tip), getattr(first, answer)(asked[2]))
    np.testing.assert_array_equal(again.beta(elbow), first.beta(asked[1]))
    # these ask the users' functions, whose addresses are of this process
    np.testing.assert_array_equal(again.reaction(shoulder), first.reaction(asked[0]))
    np.testing.assert_array_equal(again.drive(elbow), first.drive(asked[1]))
    with pytest.raises(SceneError, match="belongs to no body"):
        again.position(asked[2])


@pytest.mark.parametrize("copied", [through_pickle, copy.deepcopy])
def test_a_copied_machine_runs_as_the_first(run, copied):
    scene, first, _ = run
    again = copied(scene).simulate(0.05, h=0.01, integrator=fm.GeneralizedAlpha())
    np.testing.assert_array_equal(again.x, first.x)


def test_a_copy_of_the_trajectory_alone_has_its_bodies(run):
    _, first, _ = run
    again = copy.deepcopy(first)
    tip, own = (trajectory.bodies["lower"].frame((0.3, 0.0, 0.0)) for trajectory in (first, again))
    np.testing.assert_array_equal(again.position(own), first.position(tip))


def test_a_compiled_scene_keeps_its_numbers_where_bodies_have_changed(run):
    scene, *_ = pendulum()
    compiled = scene.compile().scene
    compiled.topology.branches[0].outer.body.mass = 5.0
    again = through_pickle(compiled)
    np.testing.assert_array_equal(again.plan.rigid, compiled.plan.rigid)
    assert again.digest() == compiled.digest()
    assert set(again.plan.elements[:, at.EL_ADDRESS]) != {0}


def test_another_process_unpickles_what_this_one_compiled(run, tmp_path):
    _, first, asked = run
    path = tmp_path / "run.pickle"
    path.write_bytes(pickle.dumps((first, asked)))
    code = (
        f"import pickle, sys; sys.path.insert(0, {str(__file__.rsplit('/', 1)[0])!r})\n"
        f"run, (shoulder, elbow, tip) = pickle.loads(open({str(path)!r}, 'rb').read())\n"
        "print(*run.position(tip)[-1].tolist(), *run.drive(elbow).tolist(), sep='\\n')"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    told = np.array([float(line) for line in out.splitlines()])
    np.testing.assert_array_equal(told, [*first.position(asked[2])[-1], *first.drive(asked[1])])
