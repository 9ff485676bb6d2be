"""Several processes run one machine: rank 0 decides, and an error of one is the error of all."""

from __future__ import annotations

import time

from mpi4py import MPI

import numpy as np
import pytest
from machines import slider_crank

import flexmbd as fm
from flexmbd.continuum import parallel
from flexmbd.continuum.parallel import MpiTeam
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

pytestmark = pytest.mark.mpi


def machine(torque, *, collective=False):
    scene, piston, j1 = slider_crank()
    scene.team = MpiTeam(MPI.COMM_WORLD, collective_functions=collective)
    scene.add_force(fm.force.JointTorque(j1, torque))
    j1.velocity = 20.0
    return scene, piston


@pytest.mark.parametrize("collective", [False, True])
def test_rank_0_decides_what_a_callback_gives(collective):
    """Ranks whose callbacks differ have one trajectory, to the bit, whether all step or rank 0 alone."""
    rank = MPI.COMM_WORLD.rank
    scene, piston = machine(lambda t: 1.0 + 0.5 * rank, collective=collective)
    run = scene.simulate(0.05, rtol=1e-5)
    alone, other = machine(lambda t: 1.0)
    alone.team = fm.System().team
    exact = alone.simulate(0.05, rtol=1e-5)
    np.testing.assert_array_equal(run.x, exact.x)
    np.testing.assert_array_equal(run.position(piston.frame()), exact.position(other.frame()))


@pytest.mark.parametrize("what", ["angle", "torque"])
def test_scenes_that_differ_are_told_on_every_rank(what):
    rank = MPI.COMM_WORLD.rank
    scene, _, j1 = slider_crank()
    scene.team = MpiTeam(MPI.COMM_WORLD)
    j1.position = 0.1 + (0.1 * rank if what == "angle" else 0.0)
    scene.add_force(fm.force.JointTorque(j1, 1.0 + (0.5 * rank if what == "torque" else 0.0)))
    if MPI.COMM_WORLD.size == 1:
        scene.start()
        return
    with pytest.raises(SceneError, match="the scene differs between ranks"):
        scene.simulate(0.01)


@pytest.mark.parametrize("collective", [False, True])
def test_a_callback_that_fails_stops_all(collective):
    """On the last rank where functions are collective, else on rank 0, which alone calls them."""
    failing = MPI.COMM_WORLD.size - 1 if collective else 0

    def torque(t):
        if MPI.COMM_WORLD.rank == failing and t > 0.02:
            raise ValueError("the sensor is gone")
        return 1.0

    scene, _ = machine(torque, collective=collective)
    with pytest.raises(SimulationError, match=r"at t = 0\.02.*the sensor is gone") as caught:
        scene.simulate(0.05, rtol=1e-4)
    assert 0.01 < caught.value.trajectory.t[-1] <= 0.021


def test_rank_0_alone_calls_functions_and_the_others_sleep(monkeypatch):
    """A run of a second of rank 0's leaves the others' processors free: between two looks they sleep ever longer."""
    calls, naps, sleep = [], [], time.sleep

    def slow(t):
        calls.append(t)
        sleep(0.6 if len(calls) < 3 else 0.0)
        return 1.0

    scene, _ = machine(slow)
    monkeypatch.setattr(time, "sleep", lambda seconds: (naps.append(seconds), sleep(seconds)))
    run = scene.simulate(0.01, rtol=1e-4)
    assert run.t[-1] == 0.01
    if MPI.COMM_WORLD.rank > 0:
        assert calls == []
        assert max(naps) == parallel._NAP


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("t_end", {"t_end": 0.02}),
        ("rtol", {"rtol": 1e-5}),
        ("checkpoints", {"checkpoints": [0.005]}),
        ("integrator", {"integrator": fm.RadauIIA()}),
        ("events", {"events": [fm.Event(lambda moment: 1.0, name="probe")]}),
    ],
)
def test_arguments_that_differ_are_told_on_every_rank(name, arguments):
    if MPI.COMM_WORLD.size == 1:
        return
    scene, _ = machine(1.0)
    other = arguments if MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1 else {}
    with pytest.raises(SceneError, match=f"{name} is .* on rank 0 and .* on this rank"):
        scene.simulate(**{"t_end": 0.01, **other})


@pytest.mark.parametrize("fault", ["argument", "scene"])
def test_what_one_rank_refuses_is_refused_by_all(fault):
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1
    scene, _ = machine(1.0)
    if last and fault == "scene":
        scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="loose")
    with pytest.raises(SceneError, match="t_end" if fault == "argument" else "loose"):
        scene.simulate(-1.0 if last and fault == "argument" else 0.01)


def test_a_trajectory_of_rank_0_answers_on_every_rank(shared_path):
    """Reactions, energies, checkpoints and restarts, and what is saved, as of one process."""

    def outcome(team):
        scene, _ = machine(lambda t: 1.0 + t)
        scene.team = team
        saved = shared_path / f"saved{team.size}.npz"
        options = {"checkpoint_file": saved, "checkpoint_every": 0.02}
        run = scene.simulate(0.05, rtol=1e-5, checkpoints=[0.03], integrator=fm.RadauIIA(), **options)
        rest = scene.simulate(0.05, restart=run.checkpoints[0], rtol=1e-5, integrator=fm.RadauIIA())
        last = fm.Checkpoint.load(saved)
        return scene, run, rest, last

    team = MpiTeam(MPI.COMM_WORLD)
    scene, run, rest, last = outcome(team)
    alone, exact, rest_alone, _ = outcome(fm.System().team)
    np.testing.assert_array_equal(run.x, exact.x)
    np.testing.assert_array_equal(rest.x, rest_alone.x)
    np.testing.assert_array_equal(run.energy().kinetic, exact.energy().kinetic)
    np.testing.assert_array_equal(run.reaction(scene._connections[0]), exact.reaction(alone._connections[0]))
    assert last.t == pytest.approx(0.04)
    path = run.save(shared_path / "run.h5")
    np.testing.assert_array_equal(fm.Trajectory.load(path, scene).v, run.v)


def test_only_the_root_shows_a_bar(capfd):
    scene, _ = machine(1.0)
    scene.simulate(0.01, progress=True)
    shown = capfd.readouterr().err
    assert ("100%" in shown) == (MPI.COMM_WORLD.rank == 0)


@pytest.mark.parametrize("collective", [False, True])
def test_events_are_found_alike_and_an_action_of_rank_0_counts(collective):
    """Ranks whose event functions and actions differ do as rank 0 does, rejected steps included."""
    rank = MPI.COMM_WORLD.rank
    team = MpiTeam(MPI.COMM_WORLD, collective_functions=collective)

    def outcome(shift, team):
        scene, _ = machine(1.0)
        scene.team = team
        crank = scene._connections[0]

        def kick(moment):
            moment.set_rate(crank, 30.0 + shift)

        event = fm.Event(lambda m: m.beta(crank) - 0.5 - shift, action=kick)
        # no step fits this bang, so some are rejected on the way to it
        scene.add_force(fm.force.JointTorque(crank, lambda t: 50.0 * (t > 0.03)))
        return scene.simulate(0.05, rtol=1e-6, events=[event])

    run = outcome(0.1 * rank, team)
    exact = outcome(0.0, fm.System().team)
    assert len(run.events) == 1
    assert run.stats.rejected == exact.stats.rejected > 0
    assert run.events[0].t == exact.events[0].t
    np.testing.assert_array_equal(run.x, exact.x)


def test_an_event_that_fails_on_the_last_rank_stops_all():
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1

    def function(moment):
        if last and moment.t > 0.02:
            raise ValueError("the probe is gone")
        return 1.0

    scene, _ = machine(1.0, collective=True)
    with pytest.raises(SimulationError, match=r"event 'probe' at t = 0\.02.*the probe is gone") as caught:
        scene.simulate(0.05, rtol=1e-4, events=[fm.Event(function, name="probe")])
    assert 0.01 < caught.value.trajectory.t[-1] <= 0.03
