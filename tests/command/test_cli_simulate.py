"""`flexmbd simulate`, `plot` and `doctor`: from a file to tables and pictures, and what is said on the way."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest
from two_crosses_body import two_crosses

import flexmbd as fm
from flexmbd.cli import main
from flexmbd.command import doctor
from flexmbd.errors import ExportError
from flexmbd.files.result_table import ResultTable, read_table, write_table

PENDULUM = """\
gravity = [0, 0, -9.81]

[[body]]
name = "bob"
mass = 2
inertia = [1e-9, 1e-9, 1e-9]
com = [0, 0, -1]

[[joint]]
name = "hinge"
kind = "revolute"
axis = "y"
child = "bob"
position = 1e-3

[simulate]
t_end = 2
rtol = 1e-9

[output]
every = 0.05
positions = [{ body = "bob", p = [0, 0, -1], name = "tip" }]
formats = ["csv", "npz"]
"""

# A crank of 2 m on a rod of 1 m, turned by a motor beyond where the rod can follow: sin(angle) = 1/2.
JAMMED = """\
[[body]]
name = "crank"
mass = 1
inertia = [0.1, 0.1, 0.1]

[[body]]
name = "rod"
mass = 1
inertia = [0.1, 0.1, 0.1]

[[joint]]
name = "motor"
kind = "revolute"
child = "crank"
motion = { t = [0, 1], y = [0.2, 1.2] }

[[joint]]
name = "pin"
kind = "revolute"
parent = { body = "crank", p = [2, 0, 0] }
child = "rod"
position = -0.6

[[joint]]
name = "slot"
kind = "point_on_line"
axis = "x"
child = { body = "rod", p = [1, 0, 0] }

[simulate]
t_end = 1
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with letters of other languages in its name."""
    place = tmp_path / "Läufe 實驗"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


def test_a_pendulum(folder, capsys):
    (folder / "p.toml").write_text(PENDULUM)
    assert main(["simulate", "p.toml"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].startswith("2 s simulated in ")
    assert lines[1:] == [f"p_results/results.{kind}: 41 rows, 11 columns" for kind in ("csv", "npz")]
    table = read_table(folder / "p_results/results.csv")
    assert table.names[:6] == ("t", "hinge.angle", "hinge.angle_rate", "tip.x", "tip.y", "tip.z")
    assert table.units[:6] == ("s", "rad", "rad/s", "m", "m", "m")
    t = table.column("t")
    np.testing.assert_allclose(t, np.linspace(0.0, 2.0, 41), atol=1e-15)
    angle = 1e-3 * np.cos(np.sqrt(9.81) * t)
    np.testing.assert_allclose(table.column("hinge.angle"), angle, atol=1e-8)
    np.testing.assert_allclose(table.column("tip.x"), -np.sin(table.column("hinge.angle")), atol=1e-12)
    np.testing.assert_allclose(table.column("tip.z"), -np.cos(table.column("hinge.angle")), atol=1e-12)
    assert np.ptp(table.column("energy.total")) < 1e-9
    # numbers in text have all their digits
    other = read_table(folder / "p_results/results.npz")
    assert (other.names, other.units) == (table.names, table.units)
    np.testing.assert_array_equal(other.values, table.values)


def test_a_stream_has_the_tables_again(folder, capsys):
    """Of a trajectory kept while the machine ran, also where the file was cut off, and not of another machine's."""
    (folder / "p.toml").write_text(PENDULUM)
    assert main(["simulate", "p.toml", "--stream", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][-1] == "p_results/run.h5"
    whole = read_table(folder / "p_results/results.csv")
    assert main(["simulate", "p.toml", "-o", "again", "--from", "p_results/run.h5"]) == 0
    again = read_table(folder / "again/results.csv")
    assert again.names == whole.names
    np.testing.assert_array_equal(again.values, whole.values)
    capsys.readouterr()
    assert main(["simulate", "p.toml", "--stream", "-o", "again"]) == 2
    assert "exists; give --force" in capsys.readouterr().err
    assert main(["simulate", "p.toml", "--set", "body.bob.mass=3", "-o", "other", "--from", "p_results/run.h5"]) == 2
    assert "another" in capsys.readouterr().err
    assert main(["simulate", "p.toml", "-o", "none", "--from", "nothing.h5"]) == 2
    assert "nothing.h5" in capsys.readouterr().err


def test_what_plastic_springs_remember_stands_in_the_table(folder, capsys):
    curve = "deformation = [0, 0.1, 0.4]\nforce = [0, 4, 6]\n"
    forces = f"""\
[[force]]
kind = "plastic_joint_spring"
joint = "hinge"
{curve}rest = 0.2
kinematic = 0.5

[[force]]
kind = "plastic_spring"
from = {{ body = "ground", p = [1, 0, -1] }}
to = {{ body = "bob", p = [0, 0, -1] }}
length = 0.9
{curve}
[simulate]
"""
    text = PENDULUM.replace("position = 1e-3", "position = 0.2\nvelocity = 3").replace("[simulate]\n", forces)
    (folder / "p.toml").write_text(text.replace("every = 0.05\n", ""))
    assert main(["simulate", "p.toml"]) == 0, capsys.readouterr().err
    table = read_table(folder / "p_results/results.csv")
    units = dict(zip(table.names, table.units, strict=True))

    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(2.0, (1e-9,) * 3, (0.0, 0.0, -1.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame(), name="hinge")
    hinge.position, hinge.velocity = 0.2, 3.0
    ends = scene.ground.frame((1.0, 0.0, -1.0)), bob.frame((0.0, 0.0, -1.0))
    points = (0.0, 0.1, 0.4), (0.0, 4.0, 6.0)
    named = {
        "force[0]": scene.add_force(fm.force.PlasticJointSpring(hinge, *points, rest=0.2, kinematic=0.5)),
        "force[1]": scene.add_force(fm.force.PlasticSpring(*ends, *points, length=0.9)),
    }
    run = scene.simulate(2.0, rtol=1e-9)
    np.testing.assert_array_equal(table.column("t"), run.t)
    for force, of_way in zip(named, ("rad", "m"), strict=True):
        kept = run.remembered(named[force])
        assert kept["dissipated"][-1] > 0.1
        for name, series in kept.items():
            column = f"{force}.{name}"
            np.testing.assert_array_equal(table.column(column), series)
            assert units[column] == ("J" if name == "dissipated" else of_way)


def test_results_are_kept_without_force(folder, capsys):
    (folder / "p.toml").write_text(PENDULUM.replace('"csv", ', ""))
    (folder / "r").mkdir()
    (folder / "r/results.npz").write_bytes(b"of great value")
    assert main(["simulate", "p.toml", "-o", "r"]) == 2
    assert "r/results.npz exists; give --force" in capsys.readouterr().err
    assert (folder / "r/results.npz").read_bytes() == b"of great value"
    assert main(["simulate", "p.toml", "-o", "r", "--force", "--quiet", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    assert list(found) == [
        "completed", "error", "t_end", "files", "rows", "columns", "integrator", "steps", "rejected", "seconds",
        "constraint_residual", "events",
    ]  # fmt: skip
    assert (found["completed"], found["error"], found["t_end"], found["files"]) == (True, None, 2.0, ["r/results.npz"])
    assert found["columns"]["hinge.angle"] == "rad"
    assert found["rows"] == 41
    assert main(["simulate", "p.toml", "-o", "r", "--force", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["simulate", "p.toml", "-o", "p.toml"]) == 2
    assert "cannot make the folder p.toml: File exists" in capsys.readouterr().err


def test_the_scene_explained_and_a_bar(folder, capsys):
    (folder / "p.toml").write_text(PENDULUM)
    assert main(["simulate", "p.toml", "--explain"]) == 0
    out, err = capsys.readouterr()
    assert "hinge" in out
    assert "integrator: " in out
    assert not (folder / "p_results").exists()
    pytest.importorskip("tqdm", reason="tqdm is not installed")
    assert main(["simulate", "p.toml", "--progress"]) == 0
    out, err = capsys.readouterr()
    assert "100%" in err
    assert "%" not in out


def test_a_run_that_fails_keeps_what_it_computed(folder, capsys):
    (folder / "j.toml").write_text(JAMMED)
    assert main(["simulate", "j.toml", "--json"]) == 1
    out, err = capsys.readouterr()
    found = json.loads(out)
    jam = np.arcsin(0.5) - 0.2
    assert found["completed"] is False
    assert found["t_end"] == pytest.approx(jam, abs=0.02)
    assert found["error"] in err
    assert "what was computed until t = 0.3" in err
    assert "j_results/results.csv" in err
    assert "Traceback" not in err
    table = read_table(folder / "j_results/results.csv")
    assert len(table.values) == found["rows"] > 3
    t = table.column("t")
    np.testing.assert_allclose(table.column("motor.angle"), 0.2 + t, atol=1e-9)
    # 2 sin(crank) + sin(crank + pin) = 0
    np.testing.assert_allclose(
        np.sin(table.column("motor.angle") + table.column("pin.angle")), -2 * np.sin(0.2 + t), atol=1e-5
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot read p.toml: No such file"),
        ("folder", "cannot read p.toml: it is not a regular file"),
        (PENDULUM.replace("com", "cmo"), "p.toml: body[0].cmo: is not known; did you mean 'com'?"),
        (PENDULUM.replace("t_end = 2", "t_end = -2"), "t_end"),
        (PENDULUM.replace("every = 0.05", "every = 1e-9"), "output.every: would make 2e+09 rows; 1e+07 are the most"),
        (PENDULUM.replace('child = "bob"', 'child = "bob"\nparent = "bob"'), "connects body 'bob' to itself"),
        (PENDULUM.replace("[output]", "[output]\njoints = []\nrotations = []\nmodal = [3]"), "output.modal"),
        (PENDULUM.replace("[output]", '[output]\nrotations = ["bob", "bob"]'), "two columns would be called 'bob.e0'"),
        (JAMMED + '[output]\njoints = ["slot"]\n', "joint 'slot' closes a loop and has no coordinates; ask"),
    ],
)
def test_bad_scenes_are_one_line(folder, capsys, text, message):
    if text == "folder":
        (folder / "p.toml").mkdir()
    elif text is not None:
        (folder / "p.toml").write_text(text)
    assert main(["simulate", "p.toml"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert message in err


def test_every_series(folder):
    """All that can be asked for, against the trajectory of the same machine."""
    text = PENDULUM.replace("every = 0.05\n", "").replace("t_end = 2", "t_end = 0.2").replace("1e-3", "0.5")
    series = ("velocities", "accelerations", "rotations", "angular_velocities")
    text += "".join(f'{name} = ["bob"]\n' for name in series) + 'reactions = ["hinge"]\njoints = ["hinge"]\n'
    (folder / "p.toml").write_text(text)
    assert main(["simulate", "p.toml", "--quiet"]) == 0
    table = read_table(folder / "p_results/results.npz")
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(2.0, (1e-9, 1e-9, 1e-9), (0.0, 0.0, -1.0)))
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame())
    hinge.position = 0.5
    run = scene.simulate(0.2, rtol=1e-9)
    np.testing.assert_array_equal(table.column("t"), run.t)
    columns = {
        "bob.v": run.velocity(bob.frame()), "bob.a": run.acceleration(bob.frame()),
        "bob.w": run.angular_velocity(bob.frame()), "hinge.reaction.f": run.reaction(hinge)[:, :3],
        "hinge.reaction.m": run.reaction(hinge)[:, 3:],
    }  # fmt: skip
    for stem, expected in columns.items():
        found = np.column_stack([table.column(stem + axis) for axis in "xyz"])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
    half = table.column("hinge.angle") / 2
    np.testing.assert_allclose(table.column("bob.e0"), np.cos(half), atol=1e-14)
    np.testing.assert_allclose(table.column("bob.e2"), np.sin(half), atol=1e-14)


TABLE = ResultTable(
    ("t", "a.x", "a.y", "b.q0"), ("s", "m", "m", "1"), np.array([[0.0, 1.0, -2.0, 0.5], [0.1, 1 / 3, 2.5e-300, 1e9]])
)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_tables_come_back_to_the_bit(tmp_path, suffix):
    write_table(TABLE, tmp_path / f"a{suffix}")
    found = read_table(tmp_path / f"a{suffix}")
    assert (found.names, found.units) == (TABLE.names, TABLE.units)
    np.testing.assert_array_equal(found.values, TABLE.values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a table of results"),
        ("t [s],x\n", "is not a table of results"),
        ("t,x\n1,2\n3\n", "line 3: 1 values under 2 headings"),
        ("t,x\n1,two\n", "could not convert"),
        ("t,x\n1,nan\n", "not finite"),
        ("t,t\n1,2\n", "a name of its own"),
        ("\0\0,\n1,2\n", ""),
    ],
)
def test_bad_tables(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ExportError, match=r"a\.csv") as caught:
        read_table(tmp_path / "a.csv")
    assert message in str(caught.value)


def test_tables_of_archives_that_are_others(tmp_path):
    np.savez(tmp_path / "a.npz", names=np.array(["t"]), units=np.array(["s"]), values=np.zeros(3))
    np.savez(tmp_path / "b.npz", x=np.zeros(3))
    for name in ("a", "b"):
        with pytest.raises(ExportError, match="is not a table of results"):
            read_table(tmp_path / f"{name}.npz")


def test_plot(folder, capsys):
    write_table(TABLE, folder / "größer.csv")
    assert main(["plot", "größer.csv"]) == 0
    assert capsys.readouterr() == ("größer.png: 3 columns\n", "")
    assert (folder / "größer.png").read_bytes().startswith(b"\x89PNG")
    assert main(["plot", "größer.csv"]) == 2
    assert "größer.png exists; give --force" in capsys.readouterr().err
    assert main(["plot", "größer.csv", "--column", "a.*", "-o", "a.svg", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"file": "a.svg", "columns": ["a.x", "a.y"]}
    assert main(["plot", "größer.csv", "--list"]) == 0
    assert capsys.readouterr().out.splitlines() == ["t [s]", "a.x [m]", "a.y [m]", "b.q0 [1]"]
    for words, message in (
        (["größer.csv", "--column", "c", "-o", "c.png"], "no column fits 'c'; there are t, a.x, a.y, b.q0"),
        (["größer.csv", "-o", "a.gif"], "a.gif: a picture's name ends in .png"),
        (["größer.csv", "-o", "nowhere/a.png"], "there is no folder"),
        (["nowhere.csv"], "cannot read nowhere.csv"),
        (["nowhere.h5"], "cannot read nowhere.h5"),
    ):
        assert main(["plot", *words]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert message in err
        assert err.count("\n") == 1


def test_plot_of_a_record(folder, capsys):
    two_crosses().save("a.h5")
    fm.export.npz(two_crosses(), "b.npz")
    for name in ("a.h5", "b.npz"):
        assert main(["plot", name]) == 0
        assert capsys.readouterr().err == ""
    assert (folder / "b.png").read_bytes() == (folder / "b.png").read_bytes()


def test_doctor(capsys):
    code = main(["doctor", "--json"])
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    lines = {one["name"]: one for one in found["findings"]}
    assert lines["numpy"]["detail"] == np.__version__
    assert lines["flexmbd"]["detail"].startswith(fm.__version__)
    assert {"kernel cache", "BLAS of numpy", "MPI ranks", "dolfinx", "matplotlib", "exudyn", "mbdyn"} <= set(lines)
    assert code == 0
    assert found["healthy"] is True


def test_the_sheet_of_the_doctor(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "_load", lambda name: (name != "h5py", "3.1"))
    monkeypatch.setattr(doctor, "_probe", lambda names: dict.fromkeys(names, (True, "0.9")))
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "\n  numpy             3.1\n" in out
    assert "\n! h5py              3.1\n                    pip install --upgrade h5py\n" in out
    assert out.endswith("\n1 broken\n")


@pytest.mark.parametrize(
    ("body", "state", "told", "code"),
    [
        ("raise ModuleNotFoundError(\"No module named 'dolfinx'\")", "missing", "not installed", 0),
        ("raise ImportError('libdolfinx.so: no such file\\nmore')", "broken", "ImportError: libdolfinx.so", 1),
        ("import os; os.abort()", "broken", "ended the process with code -6", 1),
    ],
)
def test_doctor_where_the_continuum_side_is_not_well(tmp_path, monkeypatch, capsys, body, state, told, code):
    """A library that is not there is a choice, one that does not load a fault; one that crashes takes nobody along."""
    (tmp_path / "dolfinx").mkdir()
    (tmp_path / "dolfinx/__init__.py").write_text(body + "\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert main(["doctor", "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    (line,) = (one for one in found["findings"] if one["name"] == "dolfinx")
    assert line["state"] == state
    assert told in line["detail"]
    assert line["remedy"]
    assert found["healthy"] is (code == 0)


def test_doctor_and_a_cache_that_may_not_be_written(monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/nowhere")
    finding = doctor._numba_cache()
    assert finding.state == "broken"
    assert "NUMBA_CACHE_DIR" in finding.remedy


def test_ctrl_c_ends_a_run(folder):
    """As the terminal sends it: the bar stops, one line follows, and what was computed is in the tables."""
    pytest.importorskip("tqdm", reason="tqdm is not installed")
    (folder / "p.toml").write_text(PENDULUM.replace("t_end = 2", "t_end = 1e5"))
    words = [sys.executable, "-m", "flexmbd", "simulate", "p.toml", "--progress"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        while b" s [" not in process.stderr.read(20):
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == b""
    assert err.count(b"flexmbd: stopped by Ctrl-C; what was computed until t = ") == 1
    assert err.endswith(b" s is in p_results/results.csv, p_results/results.npz\n")
    assert b"Traceback" not in err
    table = read_table(folder / "p_results/results.csv")
    np.testing.assert_allclose(np.diff(table.column("t"))[:-1], 0.05, atol=1e-9)
    assert len(table.values) > 1


def test_in_a_process_of_its_own(folder):
    (folder / "p.toml").write_text(PENDULUM.replace("com", "cmo"))
    words = [sys.executable, "-m", "flexmbd", "simulate", "p.toml"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("flexmbd: p.toml: body[0].cmo: is not known")
