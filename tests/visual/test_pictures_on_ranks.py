"""Pictures on several ranks: the root may ask alone, all may ask, and what is wrong is told on each that asks."""

from mpi4py import MPI

import pytest

import flexmbd as fm
from flexmbd.continuum import MpiTeam
from flexmbd.errors import PictureError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
SMALL = {"size": (160, 120)}


@pytest.fixture(scope="module")
def run():
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(COMM))
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0), shape=fm.Shape.sphere(0.1)), name="ball")
    scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    return scene.simulate(0.2, rtol=1e-4)


def ask(run, folder):
    run.plot(path=folder / "energy.png")
    run.show(path=folder / "ball.png", t=0.1, **SMALL)
    run.animate(folder / "ball.gif", fps=5, slow_motion=5.0, **SMALL)
    run.table().save(folder / "run.csv")


def test_the_root_may_ask_alone(run, shared_path):
    if COMM.rank == 0:
        ask(run, shared_path)
        assert len(list(shared_path.iterdir())) == 4
    COMM.barrier()


def test_all_may_ask(run, shared_path):
    run.plot(path=shared_path / "energy.png")
    run.show(path=shared_path / "ball.png", **SMALL)
    COMM.barrier()
    assert {path.name for path in shared_path.iterdir()} == {"energy.png", "ball.png"}


def test_what_is_wrong_is_told_on_each_rank(run, shared_path):
    for wrong in (
        lambda: run.plot(path=shared_path / "nowhere" / "a.png"),
        lambda: run.show(path=shared_path / "a.jpg"),
        lambda: run.animate(shared_path / "a.gif", view=(0.0, 0.0, 0.0)),
        lambda: run.animate(shared_path / "a.gif", size=(3, 3)),
        lambda: run.show(path=shared_path / "a.png", amplification=-1.0),
        lambda: run.animate(shared_path / "a.gif", between=(0.1, 0.1)),
    ):
        with pytest.raises(PictureError):
            wrong()
