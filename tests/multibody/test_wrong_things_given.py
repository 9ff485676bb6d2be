"""Things of a wrong kind, given to a scene or asked of a run: each is one error that names what was wrong with it."""

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.scene_file import read_scene


def pendulum():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (1e-2,) * 3, (0.0, 0.0, -1.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame(), name="hinge")
    return scene, bob, hinge


WRONG = (3, None, "abc", 1j, float("nan"), [1, 2], fm.RigidBody)


@pytest.mark.parametrize("given", WRONG, ids=repr)
def test_a_scene_refuses_what_is_no_part(given):
    scene, bob, _ = pendulum()
    for put in (
        lambda: fm.System(team=given),
        lambda: scene.add(given),
        lambda: scene.connect(given, scene.ground.frame(), bob.frame()),
        lambda: scene.connect(fm.joint.Revolute("z"), given, bob.frame()),
        lambda: scene.add_force(given),
        lambda: scene.add_force(fm.force.JointSpring(given, 1.0)),
        lambda: scene.add_force(fm.force.SpringDamper(given, bob.frame(), 1.0, 0.5)),
        lambda: scene.add_force(fm.force.DistributedLoad(given, "wind")),
        lambda: scene.simulate(1.0, events=[given]),
        lambda: scene.simulate(1.0, integrator=given),
    ):
        with pytest.raises(fm.SceneError, match=r"must be|got"):
            put()


@pytest.mark.parametrize("given", WRONG, ids=repr)
def test_a_run_refuses_questions_about_what_is_no_part(given):
    scene, _, _ = pendulum()
    run = scene.simulate(0.01)
    for ask in (run.position, run.velocity, run.rotation, run.beta, run.beta_rate, run.q, run.reaction):
        with pytest.raises(fm.SceneError, match="what is asked for must be a"):
            ask(given)


@pytest.mark.parametrize("name", [3, "", b"a", ("a",), float("nan")], ids=repr)
def test_names_are_texts(name):
    scene, bob, _ = pendulum()
    with pytest.raises(fm.SceneError, match="a body's name must be a text that is not empty"):
        scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name)
    with pytest.raises(fm.SceneError, match="a joint's name must be a text that is not empty"):
        scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame(), name=name)
    with pytest.raises(fm.SceneError, match="an event's name must be a text"):
        fm.Event(lambda moment: 1.0, name=name)
    bob.name = name
    with pytest.raises(fm.SceneError, match="a body's name must be a text"):
        scene.simulate(1.0)


def test_names_that_are_changed_to_one_that_is_taken():
    scene, bob, _ = pendulum()
    other = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="other")
    pin = scene.connect(fm.joint.Revolute("y"), bob.frame(), other.frame(), name="pin")
    for name in ("bob", "ground"):
        other.name = name
        with pytest.raises(fm.SceneError, match=f"two body names are '{name}' since one was changed"):
            scene.compile()
    other.name, pin.name = "another", "hinge"
    with pytest.raises(fm.SceneError, match="two joint names are 'hinge'"):
        scene.compile()
    pin.name = "elbow"
    run = scene.simulate(0.01)
    assert set(run.bodies) == {"bob", "another"}


@pytest.mark.parametrize("count", [-1, 1.5, True, "a", None, np.nan])
def test_counts_of_modes(count):
    with pytest.raises(fm.SceneError, match="count must be a whole number, 0 or more"):
        fm.InteriorModes(count=count)
    with pytest.raises(fm.SceneError, match="below_hz must be a frequency above 0 Hz"):
        fm.InteriorModes(below_hz=-1.0)


def test_checkpoints_without_number(tmp_path):
    scene, _, _ = pendulum()
    with pytest.raises(fm.SceneError, match=r"checkpoint_every = 1e-09 s would write 1e\+09 files"):
        scene.simulate(1.0, checkpoint_file=tmp_path / "a.h5", checkpoint_every=1e-9)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.StepsWarning")
@pytest.mark.parametrize(
    "text",
    ["gravity = [0, 0, -1e12]", '[[force]]\nkind = "joint_torque"\njoint = "hinge"\n'
     "value = { amplitude = 1e6, omega = 1e6 }"],
)  # fmt: skip
def test_scenes_from_files_end(tmp_path, monkeypatch, capsys, text):
    from flexmbd.cli import main

    monkeypatch.chdir(tmp_path)
    head, tables = ("", text) if text.startswith("[[") else (text, "")
    (tmp_path / "s.toml").write_text(
        f'{head}\n[[body]]\nname = "bob"\nmass = 1\ninertia = [1, 1, 1]\ncom = [1, 0, 0]\n\n[[joint]]\nname = "hinge"\n'
        f'kind = "revolute"\naxis = "y"\nchild = "bob"\n\n{tables}\n[simulate]\nt_end = 1000\nmax_steps = 20000\n'
        'integrator = "explicit_runge_kutta"\n'
    )
    assert main(["simulate", "s.toml", "--quiet"]) == 1
    assert "max_steps = 20000 steps are taken; what was computed" in capsys.readouterr().err
    assert read_scene("s.toml", changes={"simulate.max_steps": 5}).run.max_steps == 5
    assert main(["simulate", "s.toml", "--set", "simulate.h=1e-9"]) == 2
    assert "simulate.h: would take 1e+12 steps; max_steps = 20000 are the most" in capsys.readouterr().err


def test_the_argument_of_a_force_parameter_is_a_name():
    scene = fm.System()
    bob = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute(), scene.ground.frame(), bob.frame(), name="hinge")
    spring = scene.add_force(fm.force.JointSpring(hinge, 1.0))
    with pytest.raises(fm.SceneError, match="the argument of a parameter OfForce must be a text"):
        scene.compile(parameters={"k": fm.parameter.OfForce(spring, np.zeros((3, 3)))})
