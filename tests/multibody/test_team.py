"""Several processes run one machine: rank 0 decides, and an error of one is the error of all."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from machines import slider_crank

import flexmbd as fm
from flexmbd.continuum.parallel import MpiTeam
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

pytestmark = pytest.mark.mpi


def machine(torque):
    scene, piston, j1 = slider_crank()
    scene.team = MpiTeam(MPI.COMM_WORLD)
    scene.add_force(fm.force.JointTorque(j1, torque))
    j1.velocity = 20.0
    return scene, piston


def test_rank_0_decides_what_a_callback_gives():
    """Ranks whose callbacks differ still step alike, to the bit."""
    rank = MPI.COMM_WORLD.rank
    scene, piston = machine(lambda t: 1.0 + 0.5 * rank)
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


def test_a_callback_that_fails_on_the_last_rank_stops_all():
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1

    def torque(t):
        if last and t > 0.02:
            raise ValueError("the sensor is gone")
        return 1.0

    scene, _ = machine(torque)
    with pytest.raises(SimulationError, match=r"at t = 0\.02.*the sensor is gone") as caught:
        scene.simulate(0.05, rtol=1e-4)
    assert 0.01 < caught.value.trajectory.t[-1] <= 0.021


def test_only_the_root_shows_a_bar(capfd):
    scene, _ = machine(1.0)
    scene.simulate(0.01, progress=True)
    shown = capfd.readouterr().err
    assert ("100%" in shown) == (MPI.COMM_WORLD.rank == 0)


def test_events_are_found_alike_and_an_action_of_rank_0_counts():
    """Ranks whose event functions and actions differ do as rank 0 does, rejected steps included."""
    rank = MPI.COMM_WORLD.rank

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

    run = outcome(0.1 * rank, MpiTeam(MPI.COMM_WORLD))
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

    scene, _ = machine(1.0)
    with pytest.raises(SimulationError, match=r"event 'probe' at t = 0\.02.*the probe is gone") as caught:
        scene.simulate(0.05, rtol=1e-4, events=[fm.Event(function, name="probe")])
    assert 0.01 < caught.value.trajectory.t[-1] <= 0.03
