"""`run.report`: errors that are those of a closed form, what cannot be repeated says so, files by rank 0 alone."""

import csv
import pickle

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.continuum import MpiTeam
from flexmbd.errors import ExportError, SceneError

COMM = MPI.COMM_WORLD
MASS, STIFFNESS, START = 2.0, 50.0, 0.1


def oscillator(team=None, **more):
    """A mass on a spring along x: START cos(omega t)."""
    scene = fm.System(**({} if team is None else {"team": team}))
    body = scene.add(fm.RigidBody(MASS, (0.1, 0.1, 0.1)), name="mass")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.JointSpring(slide, STIFFNESS))
    slide.position = START
    return scene, body, slide


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def exact(t):
    return START * np.cos(np.sqrt(STIFFNESS / MASS) * t)


@pytest.mark.parametrize("asked", [{"rtol": 1e-5}, {"h": 5e-3}])
def test_errors_are_those_of_the_closed_form(tmp_path, asked):
    scene, body, _ = oscillator()
    run = scene.simulate(3.0, **asked)
    assert run.report(tmp_path / "report") == tmp_path / "report/index.html"
    name, what = ("ladder_rtol", "rtol [1]") if "rtol" in asked else ("ladder_h", "h [s]")
    ladder = rows_of(tmp_path / f"report/tables/{name}.csv")
    factors = [1e2, 1e1, 1.0, 1e-1, 1e-2] if "rtol" in asked else [2.0, 1.0, 0.5]
    np.testing.assert_allclose([float(one[what]) for one in ladder], np.array(factors) * next(iter(asked.values())))
    times = 3.0 * np.arange(1, 21) / 20 if "rtol" in asked else np.append(0.01 * 15 * np.arange(1, 20), 3.0)
    for one in ladder[:2]:
        key = "rtol" if "rtol" in asked else "h"
        again = scene.simulate(3.0, checkpoints=times[:-1], **{key: float(one[what])})
        off = abs(again.position(body.frame(), t=times)[:, 0] - exact(times)).max()
        assert float(one["place [m]"]) == pytest.approx(off, rel=0.02)
        assert int(one["steps"]) == again.stats.steps
        assert float(one["turn [rad]"]) == 0.0
    methods = {one["method"]: float(one["place [m]"]) for one in rows_of(tmp_path / "report/tables/methods.csv")}
    assert len(methods) == 6
    assert min(methods.values()) < 1e-6
    energies = {one["part"]: one for one in rows_of(tmp_path / "report/tables/energies.csv")}
    assert float(energies["springs"]["start [J]"]) == pytest.approx(STIFFNESS * START**2 / 2)
    page = (tmp_path / "report/index.html").read_text()
    assert "skipped: " in page
    assert f"integrator: {run.stats.integrator}" in page


def test_what_cannot_be_repeated_says_why(tmp_path):
    scene, _, slide = oscillator()
    run = scene.simulate(0.5)
    run.save(tmp_path / "run.h5")
    kick = fm.Event(
        lambda now: now.beta(slide), name="back", action=lambda now: now.set_rate(slide, 1.0),
        direction=fm.Direction.FALLING,
    )  # fmt: skip
    kicked = scene.simulate(0.5, events=[kick])
    for k, (one, message) in enumerate(
        [(fm.Trajectory.load(tmp_path / "run.h5", scene), "read from a file"), (kicked, "actions of events")]
    ):
        assert message in one.report(tmp_path / f"report {k}").read_text()
    copy = pickle.loads(pickle.dumps(run))  # noqa: S301
    assert "ladder_rtol" in copy.report(tmp_path / "of a copy").read_text()


def test_the_report_is_of_the_run_whatever_the_scene_became(tmp_path):
    scene, _, slide = oscillator()
    first = scene.simulate(1.0)
    first.report(tmp_path / "one")
    slide.position = 7.0
    first.report(tmp_path / "two")
    for path in (tmp_path / "one/tables").iterdir():
        assert path.read_bytes() == (tmp_path / "two/tables" / path.name).read_bytes()


def test_wrong_folders(tmp_path):
    run = oscillator()[0].simulate(0.1)
    with pytest.raises(SceneError, match="folder must be a path, got 3"):
        run.report(3)
    (tmp_path / "a").touch()
    with pytest.raises(ExportError, match="is a file; give a folder"):
        run.report(tmp_path / "a")


@pytest.mark.mpi
@pytest.mark.skipif(COMM.size == 1, reason="needs two ranks")
def test_ranks(shared_path):
    run = oscillator(MpiTeam(COMM))[0].simulate(0.5)
    page = run.report(shared_path / "report")
    assert "ladder_rtol" in page.read_text()
    with pytest.raises(ExportError, match="is not empty"):
        run.report(shared_path / "report")
    if COMM.rank == 0:
        run.report(shared_path / "by rank 0 alone")
    run.report(shared_path / "another")
    COMM.barrier()
    assert {path.name for path in shared_path.iterdir()} == {"report", "by rank 0 alone", "another"}
