"""Restarts of runs that look for events: what takes place at a checkpoint or after it is that of the whole."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import RecordError

STOP, END = 2.0**-4, 0.25
METHODS = {
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy": fm.EnergyMomentum(),
    "central": fm.CentralDifference(),
    "8": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
}


def clock(at=STOP, name="clock", **how):
    """At a checkpoint's instant it is zero to the bit."""
    return fm.Event(lambda now: now.t - at, name=name, **how)


def ball(load=0.0, **team):
    """A mass on a spring, pulled; its slide."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **team)
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, 400.0, 0.5))
    scene.add_force(fm.force.JointForce(slide, load))
    return scene, slide


def plain(how):
    scene, slide = ball()
    return scene, [clock(**how), fm.Event(lambda now: float(now.beta_rate(slide)), name="turn")]


def jump(how):
    scene, _ = ball(fm.Piecewise(lambda t: 3.0 if t < STOP else -5.0, breaks=[STOP]))
    return scene, [clock(**how)]


def sampled(how):
    scene, slide = ball(push := fm.Signal("push"))
    scene.add_controller(
        lambda t, y: -20.0 * y, period=STOP / 2.0, measurements=[fm.output.Position(slide)], inputs=[push]
    )
    return scene, [clock(**how)]


def thrown(how):
    """What the event at the checkpoint does to the velocity throws another function back there."""
    scene, slide = ball()

    def throw(now):
        now.set_rate(slide, -0.5 * now.beta_rate(slide))

    turn = fm.Event(lambda now: float(now.beta_rate(slide)) * (now.t - STOP), name="both", action=throw)
    return scene, [clock(action=throw, **how), turn]


def several(how):
    """Two equal ones, one that touches zero at the checkpoint, one askew to it, and one of the other direction."""
    scene, _ = ball()
    touches = fm.Event(lambda now: (now.t - STOP) ** 2, name="touches")
    falls = fm.Event(lambda now: STOP - now.t, name="falls", direction=fm.Direction.FALLING)
    ticks = fm.Event(lambda now: np.sin(200.0 * now.t), name="ticks")
    return scene, [clock(**how), touches, clock(**how), falls, ticks]


def whole_and_rest(machine, method, how, tmp_path, **event):
    """The run that goes on, and its restart in a scene of its own from the checkpoint's file."""
    scene, events = machine(event)
    whole = scene.simulate(END, integrator=METHODS[method], events=events, checkpoints=[STOP], **how)
    kept = fm.Checkpoint.load(whole.checkpoints[0].save(tmp_path / "kept.npz"))
    scene, events = machine(event)
    return whole, scene.simulate(END, integrator=METHODS[method], events=events, restart=kept, **how)


def assert_rest(rest, whole):
    """To the bit, and with the same events."""
    first = len(whole.t) - len(rest.t)
    assert rest.t[0] == STOP
    for part in ("t", "x", "v", "a", "multipliers"):
        np.testing.assert_array_equal(getattr(rest, part)[1:], getattr(whole, part)[first + 1 :])
    after = [(one.name, one.t, one.row - first) for one in whole.events if one.row > first]
    assert [(one.name, one.t, one.row) for one in rest.events] == after
    assert [one.row for one in rest.departures] == [one.row - first for one in whole.departures if one.row >= first]


@pytest.mark.parametrize("machine", [plain, jump, sampled, thrown, several])
@pytest.mark.parametrize(
    ("method", "fixed"), [("radau", False), ("alpha", True), ("energy", False), ("central", True), ("8", False)]
)
def test_a_restart_finds_the_events_of_the_whole(machine, method, fixed, tmp_path):
    how = {"h": 2.0**-7} if fixed else {"rtol": 1e-5}
    whole, rest = whole_and_rest(machine, method, how, tmp_path)
    assert "clock" in {one.name for one in rest.events}
    assert_rest(rest, whole)
    if machine is several:
        assert [one.name for one in rest.events][:3] == ["clock", "clock", "falls"]
        assert "touches" not in {one.name for one in rest.events}


@pytest.mark.parametrize(
    ("direction", "found"), [(fm.Direction.EITHER, 1), (fm.Direction.RISING, 1), (fm.Direction.FALLING, 0)]
)
@pytest.mark.parametrize("stop", [True, False])
def test_directions_and_ends_at_a_checkpoint(direction, found, stop, tmp_path):
    whole, rest = whole_and_rest(jump, "radau", {"rtol": 1e-5}, tmp_path, direction=direction, stop=stop)
    assert len(whole.events) == len(rest.events) == found
    assert (rest.t[-1] < END) == (stop and found == 1)
    assert_rest(rest, whole)


def test_only_what_was_looked_for_up_to_a_checkpoint_is_remembered():
    """A new event that lies on zero there leaves it, as at a start; what a run between did not follow is forgotten."""
    scene, _ = ball()
    first = scene.simulate(END, events=[clock(STOP / 2.0)], checkpoints=[STOP / 4.0, STOP]).checkpoints
    assert scene.simulate(END, events=[clock(name="other")], restart=first[1]).events == ()
    second = scene.simulate(END, restart=first[0], checkpoints=[STOP]).checkpoints[0]
    assert scene.simulate(END, events=[clock(STOP / 2.0)], restart=second).events == ()


def test_events_that_a_checkpoint_holds_in_another_order_are_told_apart():
    scene, _ = ball()
    events = [clock(), fm.Event(lambda now: now.t - 2.0 * STOP, name="late"), clock(END)]
    kept = scene.simulate(END, h=2.0**-7, events=events, checkpoints=[STOP]).checkpoints[0]
    for order in ([1, 0], [2, 1, 0], [0]):
        rest = scene.simulate(END, h=2.0**-7, events=[events[k] for k in order], restart=kept)
        assert [one.event for one in rest.events] == [events[k] for k in (0, 1) if k in order]


def test_a_damaged_memory_of_events_is_refused(tmp_path):
    scene, _ = ball()
    path = scene.simulate(END, events=[clock()], checkpoints=[STOP]).checkpoints[0].save(tmp_path / "kept.npz")
    with np.load(path) as file:
        arrays = dict(file)
    wrong = [(0, np.nan), (0, 2.0), (1, np.nan), (2, np.inf), (3, -1.0)]
    damaged = [{"events": np.where(np.arange(5)[:, None] == row, value, arrays["events"])} for row, value in wrong]
    for part in (*damaged, {"events": arrays["events"][:4]}, {"event_codes": np.array(["one", "two"])}):
        np.savez(tmp_path / "other.npz", **{**arrays, **part})
        with pytest.raises(RecordError, match="damaged: its events are impossible"):
            scene.simulate(END, events=[clock()], restart=fm.Checkpoint.load(tmp_path / "other.npz"))


@pytest.mark.mpi
def test_a_restart_on_several_ranks(tmp_path):
    from mpi4py import MPI

    from flexmbd.continuum import MpiTeam

    found = []
    for collective in (False, True):
        scene, _ = ball(team=MpiTeam(MPI.COMM_WORLD, collective_functions=collective))
        event = clock(at=STOP + MPI.COMM_WORLD.rank)  # what functions do is rank 0's
        kept = scene.simulate(END, events=[event], checkpoints=[STOP]).checkpoints[0]
        path = MPI.COMM_WORLD.bcast(tmp_path / f"{collective}.npz")
        if MPI.COMM_WORLD.rank == 0:
            kept.save(path)
        MPI.COMM_WORLD.barrier()
        kept = fm.Checkpoint.load(path)  # whose codes are rank 0's
        found.append([one.t for one in scene.simulate(END, events=[event], restart=kept).events])
    assert found[0] == found[1]
    assert len(found[0]) == 1
