"""Controllers in scene files: the same numbers as in Python, and faults named by their places."""

import re
from pathlib import Path

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.scene_file import build, read_scene

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"
CART = """\
[[body]]
name = "cart"
mass = 2
inertia = [0.1, 0.1, 0.1]

[[joint]]
name = "slide"
kind = "prismatic"
axis = "x"
child = "cart"
position = 1.0

[simulate]
t_end = 1.0

"""
LAWS = """\
def law(t, y, total):
    total = total + 0.01 * y[0]
    return -8.0 * y[0] - 6.0 * y[1] - 2.0 * total[0], total


def place(now, scene):
    return now.position(scene.bodies["cart"].frame())[0]
"""


def written(folder, text):
    (folder / "laws.py").write_text(LAWS)
    (folder / "scene.toml").write_text(CART + text)
    return folder / "scene.toml"


def example():
    (found,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    return found


def test_the_page_s_controller_is_that_of_python(tmp_path):
    system = build(read_scene(written(tmp_path, example()))).system
    run = system.simulate(1.0, rtol=1e-6)

    scene = fm.System()
    cart = scene.add(fm.RigidBody(mass=2.0, inertia=(0.1, 0.1, 0.1)), name="cart")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    slide.position = 1.0
    push = fm.Signal("push")
    scene.add_force(fm.force.JointForce(slide, push))
    names = {}
    exec(LAWS, names)
    scene.add_controller(
        names["law"], period=0.01, measurements=[fm.output.Position(slide), fm.output.Velocity(slide)],
        inputs=[push], state=[0.0],
    )  # fmt: skip
    same = scene.simulate(1.0, rtol=1e-6)
    np.testing.assert_array_equal(run.samples[0].inputs, same.samples[0].inputs)
    np.testing.assert_array_equal(run.x, same.x)


def test_what_else_is_measured(tmp_path):
    frames = '{ frame = "cart", quantity = "position" }, { law = "laws.py:place" }, { signal = "push" }'
    text = re.sub(r"measurements = .*", f"measurements = [{frames}]", example())
    system = build(read_scene(written(tmp_path, text))).system
    samples = system.simulate(0.1).samples[0]
    assert samples.measurements.shape == (10, 5)
    np.testing.assert_allclose(samples.measurements[:, 0], samples.measurements[:, 3], rtol=1e-15)
    np.testing.assert_array_equal(samples.measurements[1:, 4], samples.inputs[:-1, 0])


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ("period = 0.01", "period = 0", r"controller\[0\] \(governor\): .*period 0.0 s must be positive"),
        ('inputs = ["push"]', 'inputs = ["pusch"]', "no load has the signal 'pusch'; did you mean 'push'"),
        ('"position" }, {', '"positions" }, {', "'positions' is not known; did you mean 'position'"),
        ('joint = "slide", q', 'joint = "slider", q', "no joint 'slider'"),
        ("laws.py:law", "laws.py:lau", "no function 'lau'; did you mean 'law'"),
        ('name = "governor"', 'name = "governor"\nsteps = 3', "steps"),
    ],
)
def test_faults_are_named_by_their_places(tmp_path, was, becomes, told):
    assert was in example()
    path = written(tmp_path, example().replace(was, becomes))
    with pytest.raises(SceneError, match=told):
        build(read_scene(path)).system.simulate(0.1)
