"""Ctrl-C at any moment of the command: one line, exit code 130, and tables that are whole or not there."""

import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from flexmbd.files.result_table import read_table

SCENE = """\
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
position = 1.0

[simulate]
t_end = {t_end}
rtol = 1e-9
integrator = "explicit_runge_kutta"

[output]
{every}
"""


def started(folder, words):
    """The command as its script in the environment's folder runs it."""
    line = "import sys; from flexmbd.cli import main\nif __name__ == '__main__': sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", line, *words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def interrupted(folder, words, after):
    """A command that gets SIGINT after so many seconds, or when it has ended: its exit code and lines on stderr."""
    process = started(folder, words)
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    return process.returncode, err.splitlines()


# A python without anything of flexmbd takes some hundredths of a second to begin: before, Ctrl-C is Python's own.
@pytest.mark.parametrize("k", range(8))
def test_at_any_moment(tmp_path, k):
    rng = np.random.default_rng(k)
    (tmp_path / "s.toml").write_text(SCENE.format(t_end=400, every=""))
    code, told = interrupted(tmp_path, ["simulate", "s.toml", "--quiet"], 0.15 + 2.5 * rng.random())
    tables = list((tmp_path / "s_results").glob("*")) if (tmp_path / "s_results").exists() else []
    if code == 0:
        assert told == []
        assert read_table(tables[0]).column("t")[-1] == 400.0
        return
    assert code == 130
    assert len(told) == 1
    assert told[0].startswith("flexmbd: stopped by Ctrl-C")
    assert [path.name for path in tables] in ([], ["results.csv"])
    assert bool(tables) is ("results.csv" in told[0])
    for path in tables:
        t = read_table(path).column("t")
        assert t[0] == 0.0
        assert (np.diff(t) > 0.0).all()


def variants_done(store):
    """How many a sweep has in its file so far, which it may be writing to."""
    try:
        with h5py.File(store, "r", locking=False) as kept:
            return int((kept["state"][()] > 0).sum())
    except (OSError, KeyError):
        return 0


def test_a_sweep_keeps_what_is_done_and_goes_on(tmp_path):
    (tmp_path / "s.toml").write_text(SCENE.format(t_end=20, every="every = 0.1"))
    words = ["sweep", "s.toml", "--vary", "body.bob.mass=1:2:60", "--column", "hinge.angle", "--jobs", "2"]
    store = tmp_path / "s_sweep/sweep.h5"
    with started(tmp_path, words) as process:
        while variants_done(store) == 0 and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err.count("\n") == 1
    done = len(read_table(tmp_path / "s_sweep/sweep.csv").values)
    assert err == f"flexmbd: stopped by Ctrl-C; the {done} variants that were done are in s_sweep/sweep.csv\n"
    assert 1 <= done < 60
    with started(tmp_path, words) as process:
        out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert out.startswith("60 variants done")
    table = read_table(tmp_path / "s_sweep/sweep.csv")
    np.testing.assert_array_equal(table.column("variant"), np.arange(60))
    # a point mass swings alike whatever it weighs
    assert np.ptp(table.column("hinge.angle.last")) < 1e-4
