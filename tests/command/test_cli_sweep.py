"""`flexmbd sweep` and `--set`: against closed forms, and against single simulations of the same values."""

import json

import h5py
import numpy as np
import pytest

from flexmbd.cli import main
from flexmbd.files.result_table import read_table
from flexmbd.scene_file import read_scene
from flexmbd.scene_file.sweep_values import read_variation, variants

# a mass on a spring, let go at rest: x = x0 cos(sqrt(k/m) t)
SPRING = """\
[[body]]
name = "mass"
mass = 2.0
inertia = [1e-3, 1e-3, 1e-3]

[[joint]]
name = "slide"
kind = "prismatic"
axis = "x"
child = "mass"
position = 0.1

[[force]]
kind = "joint_spring"
joint = "slide"
stiffness = 50.0

[simulate]
t_end = 0.7
rtol = 1e-9
integrator = "explicit_runge_kutta"

[output]
energies = false
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(SPRING)
    return tmp_path


def refused(capsys, words, message):
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert message in err


def test_values_set_on_the_command_line(folder, capsys):
    words = ["--set", "bodies.mass.mass=4", "--set", "force[0].stiffness = 30", "--set", "simulate.t_end=0.3"]
    assert main(["simulate", "s.toml", *words]) == 0
    table = read_table(folder / "s_results/results.csv")
    expected = 0.1 * np.cos(np.sqrt(30.0 / 4.0) * table.column("t"))
    assert table.column("t")[-1] == 0.3
    np.testing.assert_allclose(table.column("slide.displacement"), expected, atol=1e-9)
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("bodies.mas.mass=1", "bodies.mas.mass: there is no 'mas' in the file; did you mean 'mass'?"),
        ("body.mass.mas=1", "s.toml: body[0].mas: is not known; did you mean 'mass'?"),
        ("body.mass.mass=heavy", "s.toml: body[0].mass: must be a number, got 'heavy'"),
        ("body.mass.mass=[1]", "s.toml: body[0].mass: must be a number, got [1]"),
        ("body.mass.mass.x=1", "nothing stands below 2.0"),
        ("bdy.mass.mass=1", "there is no 'bdy' in the file; did you mean 'body'?"),
        ("force[1].stiffness=1", "there is no '1' in the file"),
        ("simulate.rtoll=1", "did you mean 'rtol'?"),
        ("simulate", "--set takes KEY=VALUE"),
        ("=3", "--set takes KEY=VALUE"),
        ("a b=3", "'a b' is no path to a key"),
        ("simulate.t_end=1\nrtol=3", "must be a number, got '1\\nrtol=3'"),
    ],
)
def test_wrong_settings(folder, capsys, words, message):
    refused(capsys, ["simulate", "s.toml", "--set", words], message)


def test_a_key_is_set_once(folder, capsys):
    refused(capsys, ["simulate", "s.toml", "--set", "simulate.h=1", "--set", "simulate.h=2"], "is given twice")


def test_paths_and_types(folder):
    changes = {'joints."slide".axis': [0, 1, 0], "body.mass.inertia[1]": 5, "output.every": 0.1}
    scene = read_scene("s.toml", changes=changes)
    assert scene.joints[0].arguments["axis"] == (0.0, 1.0, 0.0)
    assert scene.bodies[0].inertia == (1e-3, 5.0, 1e-3)
    assert scene.output.every == 0.1
    assert read_scene("s.toml").bodies[0].inertia == (1e-3, 1e-3, 1e-3)


def test_a_sweep_against_the_closed_form(folder, capsys):
    words = ["sweep", "s.toml", "--vary", "bodies.mass.mass=1:3:3", "--vary", "force[0].stiffness=20,80"]
    words += ["--column", "slide.displacement", "--take", "last", "--take", "min", "--jobs", "2"]
    assert main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == ["s_sweep/sweep.h5", "s_sweep/sweep.csv"]
    assert (found["done"], found["failed"]) == (6, [])
    assert found["columns"] == {
        "variant": "1", "bodies.mass.mass": "kg", "force[0].stiffness": "SI", "t.last": "s",
        "slide.displacement.last": "m", "slide.displacement.min": "m",
    }  # fmt: skip
    table = read_table(folder / "s_sweep/sweep.csv")
    mass, stiffness = table.column("bodies.mass.mass"), table.column("force[0].stiffness")
    np.testing.assert_array_equal(mass, [1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(stiffness, [20, 80] * 3)
    last = 0.1 * np.cos(np.sqrt(stiffness / mass) * 0.7)
    np.testing.assert_allclose(table.column("slide.displacement.last"), last, atol=1e-8)
    assert main(["simulate", "s.toml", "--set", "body.mass.mass=3", "--set", "force[0].stiffness=80"]) == 0
    one = read_table(folder / "s_results/results.csv").column("slide.displacement")
    assert table.column("slide.displacement.last")[-1] == one[-1]
    assert table.column("slide.displacement.min")[-1] == one.min()
    with h5py.File(folder / "s_sweep/sweep.h5") as file:
        outputs = file["outputs/quantities"]
        assert list(outputs.attrs["names"]) == ["t.last", "slide.displacement.last", "slide.displacement.min"]
        assert list(outputs.attrs["units"]) == ["s", "m", "m"]
        np.testing.assert_array_equal(outputs[:, 1], table.column("slide.displacement.last"))
        np.testing.assert_array_equal(file["samples"][:, 1], mass)
        assert list(file["samples"].attrs["names"]) == ["variant", "bodies.mass.mass", "force[0].stiffness"]
    assert main(words) == 0  # all is there
    assert "6 variants done" in capsys.readouterr().out
    refused(capsys, [*words, "--take", "max"], "is of another ensemble")


def test_variants_that_fail_are_told_and_left_out(folder, capsys):
    words = ["sweep", "s.toml", "--vary", "body.mass.mass=-1,1,2", "--take", "last", "--jobs", "1", "-o", "o"]
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert "variant 0 failed: the simulation: " in err
    assert "mass must be positive, got -1" in err
    assert "2 variants done, 1 failed" in out
    table = read_table(folder / "o/sweep.csv")
    np.testing.assert_array_equal(table.column("variant"), [1, 2])
    refused(capsys, ["sweep", "s.toml", "--vary", "body.mass.mass=-1,-2"], "none of the 2 variants can be built")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["body.mass.mas=1,2"], "did you mean 'mass'?"),
        (["body.mas.mass=1,2"], "did you mean 'mass'?"),
        (["body.mass.mass"], "--vary takes KEY=VALUES"),
        (["body.mass.mass=1:2"], "must be a number, got '1:2'"),
        (["body.mass.mass=1:2:0"], "the COUNT must be a whole number"),
        (["body.mass.mass=a:2:3"], "'a' is no finite number"),
        (["body.mass.mass=-1:2:3:log"], "equal ratios"),
        (["body.mass.mass=normal(1,0)", "--samples", "3"], "a DEVIATION above 0"),
        (["body.mass.mass=uniform(2,1)", "--samples", "3"], "LEAST below MOST"),
        (["body.mass.mass=normal(1,0.1)"], "needs --samples"),
        (["body.mass.mass=1,2", "--samples", "3"], "is for uniform(...) and normal(...) alone"),
        (["body.mass.mass=normal(1,0.1)", "--samples", "0"], "--samples must be 1 or more"),
        (["body.mass.mass=1:2:3", "--vary", "body.mass.mass=3"], "is given twice"),
        (["body.mass.mass=1:2:10000", "--vary", "simulate.t_end=1:2:10000"], "are too many"),
        (["body.mass.mass=1,2", "--column", "slid"], "no column fits 'slid'; there are slide.displacement"),
        (["body.mass.mass=1,2", "--jobs", "0"], "--jobs must be 1 or more"),
        (["body.mass.mass=1,2", "-o", "s.toml"], "cannot make the folder"),
        (["body.mass.mass=1,2", "--seed", "-1"], "--seed must be 0 or more"),
    ],
)
def test_wrong_sweeps(folder, capsys, words, message):
    refused(capsys, ["sweep", "s.toml", "--vary", *words], message)
    assert not (folder / "s_sweep/sweep.csv").exists()


def test_a_table_that_cannot_be_written(folder, capsys):
    (folder / "o").mkdir()
    (folder / "o/sweep.csv").mkdir()
    refused(capsys, ["sweep", "s.toml", "--vary", "body.mass.mass=1,2", "-o", "o"], "o/sweep.csv")


def test_random_values_follow_the_seed():
    drawn = [read_variation("a.b=normal(2,0.5)"), read_variation("c=1e0:1e2:3:log"), read_variation("d=uniform(3,4)")]
    rows = variants(drawn, samples=2000, seed=7)
    assert rows == variants(drawn, samples=2000, seed=7)
    assert rows[:5] != variants(drawn, samples=2000, seed=8)[:5]
    assert [rows[k]["c"] for k in (0, 2000, 4000)] == pytest.approx([1.0, 10.0, 100.0])
    normal, uniform = (np.array([row[key] for row in rows]) for key in ("a.b", "d"))
    assert abs(normal.mean() - 2.0) < 5 * 0.5 / np.sqrt(6000)
    assert abs(normal.std() - 0.5) < 0.05
    assert uniform.min() >= 3.0
    assert uniform.max() <= 4.0
    assert len(set(normal)) == 6000


def test_a_sweep_stopped_before_anything_was_done_leaves_no_table(folder, capsys, monkeypatch):
    """A table without rows is none that can be read again."""
    words = ["sweep", "s.toml", "--vary", "bodies.mass.mass=1,2", "--jobs", "1"]
    assert main(words) == 0
    with h5py.File("s_sweep/sweep.h5", "r+") as kept:
        kept["outputs/quantities"][:] = np.nan
    (folder / "s_sweep/sweep.csv").unlink()
    capsys.readouterr()
    monkeypatch.setattr("flexmbd.command.sweep._run", lambda *given: True)
    assert main(words) == 130
    assert capsys.readouterr() == ("", "flexmbd: stopped by Ctrl-C; no variant was done\n")
    assert not (folder / "s_sweep/sweep.csv").exists()
