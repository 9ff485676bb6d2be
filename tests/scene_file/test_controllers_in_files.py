"""Controllers and states in scene files: the same numbers as in Python, and faults named by their places."""

import re
from pathlib import Path

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.scene_file import build, plan_columns, read_scene, tabulate

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
import scipy.signal


def law(t, y, total):
    total = total + 0.01 * y[0]
    return -8.0 * y[0] - 6.0 * y[1] - 2.0 * total[0], total


def rates(t, z, u):
    return (-8.0 * u[0] - 6.0 * u[1] - z) / 0.05


def half(t, z, u):
    return 0.5 * z


def place(now, scene):
    return now.position(scene.bodies["cart"].frame())[0]


lag = scipy.signal.TransferFunction([-1.0], [0.05, 1.0])
"""


def written(folder, text):
    (folder / "laws.py").write_text(LAWS)
    (folder / "scene.toml").write_text(CART + text)
    return folder / "scene.toml"


def examples():
    """Of a controller, of states."""
    return re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)


def example():
    return examples()[0]


def cart_in_python(signal):
    scene = fm.System()
    cart = scene.add(fm.RigidBody(mass=2.0, inertia=(0.1, 0.1, 0.1)), name="cart")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="slide")
    slide.position = 1.0
    scene.add_force(fm.force.JointForce(slide, signal))
    names = {}
    exec(LAWS, names)
    return scene, slide, names


def test_the_page_s_controller_is_that_of_python(tmp_path):
    system = build(read_scene(written(tmp_path, example()))).system
    run = system.simulate(1.0, rtol=1e-6)

    push = fm.Signal("push")
    scene, slide, names = cart_in_python(push)
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


def test_the_page_s_states_are_those_of_python(tmp_path):
    description = read_scene(written(tmp_path, examples()[1]))
    built = build(description)
    run = built.system.simulate(1.0, rtol=1e-6)
    thrust = fm.Signal("thrust")
    scene, slide, names = cart_in_python(thrust)
    motor = scene.add_states(
        names["rates"], initial=[0.0], scale=1.0, inputs=[thrust],
        measurements=[fm.output.Position(slide), fm.output.Velocity(slide)],
    )  # fmt: skip
    same = scene.simulate(1.0, rtol=1e-6)
    np.testing.assert_array_equal(run.x, same.x)
    table = tabulate(run, plan_columns(built, description.output), every=None)
    np.testing.assert_array_equal(table.column("motor.thrust"), same.states(motor)[:, 0])


@pytest.mark.parametrize(
    ("followed", "sum_of"),
    [
        ('{ frame = "cart", quantity = "position" }, { law = "laws.py:place" }', lambda place: 2.0 * place),
        ('{ joint = "slide", quantity = "position" }, 2.0, { t = [0.0, 1.0], y = [3.0, 3.0] }', lambda x: x + 5.0),
        ('{ amplitude = 2.0, omega = 0.0, phase = 0.5 }, { signal = "none" }', lambda x: 2.0 * np.sin(0.5)),
    ],
)
def test_what_states_follow(tmp_path, followed, sum_of):
    """A lag that is short goes with what it follows; half of it is the thrust."""
    text = examples()[1].replace('"laws.py:rates"', '"laws.py:sum_of"')
    text = text.replace("inputs =", 'outputs = "laws.py:half"\ninputs =')
    path = written(tmp_path, re.sub(r"measurements = .*", f"measurements = [{followed}]", text))
    with (tmp_path / "laws.py").open("a") as laws:
        laws.write("\n\ndef sum_of(t, z, u):\n    return (u.sum() - z) / 1e-3\n")
    built = build(read_scene(path))
    run = built.system.simulate(0.05, rtol=1e-8)
    expected = sum_of(run.beta(built.joints["slide"])[-1])
    assert run.states(built.states["motor"])[-1, 0] == pytest.approx(expected, rel=2e-3)
    assert run.acceleration(built.bodies["cart"].frame())[-1, 0] == pytest.approx(expected / 4.0, rel=2e-3)


def test_a_linear_system_of_a_file_begins_at_rest(tmp_path):
    text = examples()[1].replace("laws.py:rates", "laws.py:lag").replace("initial = [0.0]\n", "")
    followed = 'measurements = [{ joint = "slide", quantity = "position" }]'
    path = written(tmp_path, re.sub(r"measurements = .*", followed, text))
    built = build(read_scene(path))
    run = built.system.simulate(0.5, rtol=1e-8)
    assert run.states(built.states["motor"])[0] == 0.0
    assert run.beta(built.joints["slide"])[-1] < 1.0


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ("scale = 1.0", "scale = 0.0", r"states\[0\] \(motor\): .*positive"),
        ("scale = 1.0", "", "scale"),
        ("initial = [0.0]", "", "initial"),
        ("initial = [0.0]", "initial = [0.0, 1.0]", "2 states need 2 distinct names"),
        ('inputs = ["thrust"]', 'inputs = ["trust"]', "no load has the signal 'trust'; did you mean 'thrust'"),
        ('quantity = "velocity"', 'quantity = "acceleration"', r"measurements\[1\].*cannot follow accelerations"),
        ("laws.py:rates", "laws.py:rate", "no function 'rate'; did you mean 'rates'"),
        ('{ joint = "slide", quantity = "v', '{ body = "cart", quantity = "v', "no flexible body 'cart'"),
        ('{ joint = "slide", quantity = "velocity" }', '{ quantity = "velocity" }', "needs a 'joint', a 'frame' or"),
        ('name = "motor"', 'name = "motor"\nrate = 3', "rate"),
    ],
)
def test_faults_of_states_are_named_by_their_places(tmp_path, was, becomes, told):
    assert was in examples()[1]
    path = written(tmp_path, examples()[1].replace(was, becomes))
    with pytest.raises(SceneError, match=told):
        build(read_scene(path)).system.simulate(0.1)
