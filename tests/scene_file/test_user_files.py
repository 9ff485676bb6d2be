"""Functions in Python files beside a scene, and events: against closed forms and the same machine in Python."""

import json

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.cli import main
from flexmbd.files.result_table import read_table
from flexmbd.scene_file import build, read_scene

DROP = """\
gravity = [0, 0, -9.81]

[[body]]
name = "ball"
mass = 2
inertia = [1e-3, 1e-3, 1e-3]

[[joint]]
name = "slide"
kind = "prismatic"
axis = "z"
child = "ball"
position = 1.0

[simulate]
t_end = 0.6
rtol = 1e-8
integrator = "explicit_runge_kutta"
"""

LAWS = """\
import math
from dataclasses import dataclass

from beside import GAIN
import flexmbd as fm


@dataclass
class Kept:
    count: int = 0


def spring(t, beta, rate):
    return -GAIN * beta


@fm.compiled
def compiled_spring(t, beta, rate):
    return -50.0 * beta


def wind(t):
    return 3.0 * math.sin(7.0 * t)


def step(t):
    return 4.0 if t > 0.3 else 0.0


def lift(motion, scene):
    return [(scene.bodies["ball"].frame(), [0.0, 0.0, 2.0 * 9.81], [0.0, 0.0, 0.0])]


def state(t, x, v):
    return [-3.0 * v[0]]


def turn(t):
    return 0.5 * t * t, t, 1.0


def height(moment, scene):
    return moment.position(scene.bodies["ball"].frame())[2] - 0.25


def bounce(moment, scene):
    joint = scene.joints["slide"]
    moment.set_rate(joint, -0.5 * moment.beta_rate(joint))


def boom(t):
    table = {}
    return table["boom"]


def boom_at(moment, scene):
    return {}["boom"]


number = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "laws.py").write_text(LAWS)
    (tmp_path / "beside.py").write_text("GAIN = 50.0\n")
    return tmp_path


def made(text):
    with open("scene.toml", "w") as file:
        file.write(text)
    built = build(read_scene("scene.toml"))
    return built, built.system.simulate(
        0.6, rtol=1e-8, events=built.events, integrator=fm.ExplicitRungeKutta()
    )


def force(kind, keys):
    return f'{DROP}\n[[force]]\nkind = "{kind}"\n{keys}\n'


def compared(element):
    """The drop of a scene in Python with one force: z at times of its own."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(2.0, (1e-3,) * 3), name="ball")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    slide.position = 1.0
    scene.add_force(element(slide, ball))
    return scene.simulate(0.6, rtol=1e-8, integrator=fm.ExplicitRungeKutta()).beta(slide, t=np.linspace(0.0, 0.6, 7))


@pytest.mark.parametrize(
    ("kind", "keys", "element"),
    [
        ("joint_law", 'joint = "slide"\nlaw = "laws.py:spring"', lambda s, b: fm.force.JointSpring(s, 50.0)),
        ("joint_law", 'joint = "slide"\nlaw = "laws.py:compiled_spring"', lambda s, b: fm.force.JointSpring(s, 50.0)),
        ("joint_force", 'joint = "slide"\nvalue = { law = "laws.py:wind" }',
         lambda s, b: fm.force.JointForce(s, fm.Sine(3.0, 7.0))),
        ("frame_force", 'frame = "ball"\nforce = [0, 0, { law = "laws.py:wind" }]',
         lambda s, b: fm.force.JointForce(s, fm.Sine(3.0, 7.0))),
        ("kane_force", 'law = "laws.py:lift"', lambda s, b: fm.force.JointForce(s, 2.0 * 9.81)),
        ("state_force", 'law = "laws.py:state"', lambda s, b: fm.force.JointDamper(s, 3.0)),
    ],
)  # fmt: skip
def test_laws_in_a_file_are_those_in_python(folder, kind, keys, element):
    built, run = made(force(kind, keys))
    found = run.beta(built.joints["slide"], t=np.linspace(0.0, 0.6, 7))
    np.testing.assert_allclose(found, compared(element), rtol=0, atol=1e-9)


def test_a_law_with_breaks_is_stepped_over_exactly(folder):
    built, run = made(force("joint_force", 'joint = "slide"\nvalue = { law = "laws.py:step", breaks = [0.3] }'))
    assert 0.3 in run.t
    fall = 1.0 - 0.5 * 9.81 * 0.6**2 + 0.5 * (4.0 / 2.0) * 0.3**2
    assert run.beta(built.joints["slide"])[-1] == pytest.approx(fall, abs=1e-12)


def test_a_motion_in_a_file(folder):
    text = DROP.replace("position = 1.0", 'motion = { law = "laws.py:turn" }')
    built, run = made(text)
    np.testing.assert_allclose(run.beta(built.joints["slide"]), 0.5 * run.t**2, atol=1e-12)


def event(keys):
    return f'{DROP}\n[[event]]\nname = "lands"\n{keys}\n'


FALL = float(np.sqrt(2.0 * 0.75 / 9.81))  # s from 1 m to 0.25 m


@pytest.mark.parametrize(
    "keys",
    [
        'law = "laws.py:height"',
        'joint = "slide"\nposition = 0.25',
        'frame = "ball"\ncomponent = "z"\nposition = 0.25\ndirection = "falling"',
        f'joint = "slide"\nvelocity = {-9.81 * FALL!r}',
        f'frame = "ball"\ncomponent = "z"\nvelocity = {-9.81 * FALL!r}',
    ],
)
def test_events_stop_where_they_should(folder, capsys, keys):
    (folder / "s.toml").write_text(event(f"stop = true\n{keys}"))
    assert main(["simulate", "s.toml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in found["events"]] == ["lands"]
    assert found["events"][0]["t"] == pytest.approx(FALL, abs=1e-9)
    assert found["t_end"] == found["events"][0]["t"]
    table = read_table(folder / "s_results/results.csv")
    assert table.column("slide.displacement")[-1] == pytest.approx(0.25, abs=1e-9)


def test_an_event_acts_and_is_told(folder, capsys):
    keys = 'joint = "slide"\nposition = 0.25\ndirection = "falling"\naction = "laws.py:bounce"'
    (folder / "s.toml").write_text(event(keys))
    assert main(["simulate", "s.toml"]) == 0
    assert f"event 'lands' at t = {FALL:.9g}" in capsys.readouterr().out
    table = read_table(folder / "s_results/results.csv")
    after = 0.6 - FALL
    assert table.column("slide.displacement")[-1] == pytest.approx(
        0.25 + 0.5 * 9.81 * FALL * after - 0.5 * 9.81 * after**2, abs=1e-9
    )


@pytest.mark.parametrize(
    ("text", "files", "message", "code"),
    [
        (force("joint_law", 'joint = "slide"\nlaw = "laws.py:sprung"'), {}, "did you mean 'spring'?", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "a.py:f"'), {"a.py": "x = 1\n"}, "no function 'f'; it has x", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "a.py:f"'), {"a.py": "\n\n1/0\n"},
         "force[0] (joint_law): a.py cannot be run: ZeroDivisionError: division by zero (a.py, line 3)", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "a.py:f"'), {"a.py": "x =\n"},
         "SyntaxError: invalid syntax (a.py, line 1)", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "a.py:f"'), {"a.py": "raise SystemExit(3)\n"},
         "SystemExit: 3 (a.py, line 1)", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "nowhere.py:f"'), {}, "nowhere.py: there is no such file", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "laws.py"'), {},
         "force[0].law: must be a Python file and a function", 2),
        (force("joint_law", 'joint = "slide"\nlaw = "laws.py:number"'), {}, "int is not a function of t, beta", 2),
        (force("kane_force", 'law = "laws.py:number"'), {}, "'number' in laws.py is no function", 2),
        (force("joint_force", 'joint = "slide"\nvalue = { law = "laws.py:boom" }'), {},
         "KeyError: 'boom' (laws.py, line 53)", 2),
        (event('law = "laws.py:boom_at"'), {}, "event 'lands' at t = 0 s: KeyError: 'boom' (laws.py, line 57)", 2),
        (event('joint = "slide"'), {}, "event[0]: needs either 'position' or 'velocity'", 2),
        (event("position = 1"), {}, "event[0]: needs a 'joint' or a 'frame' to watch, or a 'law'", 2),
        (event('joint = "slide"\nposition = 1\ncoordinate = 1'), {}, "coordinates 0 to 0; there is no 1", 2),
        (event('joint = "slide"\nposition = 1\ndirecton = "rising"'), {}, "did you mean 'direction'?", 2),
        (event('joint = "slide"\nposition = 1\ndirection = "risng"'), {}, "did you mean 'rising'?", 2),
        (event('frame = "ball"\nposition = 1\ncomponent = "w"'), {}, "must be one of x, y, z, got 'w'", 2),
    ],
)  # fmt: skip
def test_faults_are_one_line_that_names_them(folder, capsys, text, files, message, code):
    (folder / "s.toml").write_text(text)
    for name, content in files.items():
        (folder / name).write_text(content)
    assert main(["simulate", "s.toml"]) == code
    err = capsys.readouterr().err
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert message in err


def test_reading_a_scene_runs_no_code(folder):
    (folder / "a.py").write_text("1/0\n")
    (folder / "s.toml").write_text(force("joint_law", 'joint = "slide"\nlaw = "a.py:f"'))
    read_scene("s.toml")
