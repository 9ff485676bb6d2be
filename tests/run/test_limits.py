"""Runs that are broken off, steps that are bounded, impacts that come to rest."""

from __future__ import annotations

import time

import numpy as np
import pytest
from machines import pendulum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

G = 9.81


def test_steps_are_counted():
    """The rows are those of the run that is not broken off."""
    scene, _, _ = pendulum()
    whole = scene.simulate(2.0)
    with pytest.raises(SimulationError, match=r"broken off at .*max_steps = 7") as caught:
        scene.simulate(2.0, max_steps=7)
    np.testing.assert_array_equal(caught.value.trajectory.x, whole.x[:8])


def test_rows_are_counted():
    scene, _, _ = pendulum()
    with pytest.raises(SimulationError, match="max_rows = 2000") as caught:
        scene.simulate(10.0, h=1e-3, max_rows=2000)
    assert len(caught.value.trajectory.t) == 2000


def test_seconds_are_counted():
    """A callable that takes ten milliseconds, in a run that would take minutes."""
    scene, _, hinge = pendulum()

    def slow(t):
        time.sleep(0.01)
        return 0.0 * t

    scene.add_force(fm.force.JointTorque(hinge, slow))
    scene.simulate(1e-3, h=1e-3, integrator=fm.ExplicitRungeKutta())
    with pytest.raises(SimulationError, match="max_seconds = 1 s are over") as caught:
        scene.simulate(100.0, h=1e-3, integrator=fm.ExplicitRungeKutta(), max_seconds=1)
    assert 2 < len(caught.value.trajectory.t) < 10_000


def test_events_are_counted_too():
    scene, _, hinge = pendulum()
    with pytest.raises(SimulationError, match="max_steps"):
        scene.simulate(10.0, events=[fm.Event(lambda m: m.beta(hinge))], max_steps=5)


def test_no_step_is_longer_than_asked():
    """So an event's function is asked often enough: a hundred passages of a clock."""
    scene, _, _ = pendulum()
    clock = fm.Event(lambda m: np.sin(np.pi * (m.t / 0.01 - 0.5)))
    run = scene.simulate(1.0, events=[clock], max_step=4e-3)
    assert np.diff(run.t).max() <= 4e-3 * (1.0 + 1e-12)
    assert [one.t for one in run.events] == pytest.approx(0.01 * (np.arange(100) + 0.5), abs=1e-9)


@pytest.mark.parametrize(
    "bad", [{"max_steps": 0}, {"max_steps": 1.5}, {"max_rows": -1}, {"max_seconds": 0.0}, {"max_step": 0.0},
            {"max_step": 0.1, "h": 0.1}]
)
def test_limits_that_are_none_are_refused(bad):
    scene, _, _ = pendulum()
    with pytest.raises(SceneError, match="must be"):
        scene.simulate(1.0, **bad)


def bouncing(restitution):
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(0.5, (2e-3,) * 3), name="ball")
    fall = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    fall.position = 1.0
    bounce = fm.Event(
        lambda m: m.position(ball.frame())[2],
        direction=fm.Direction.FALLING,
        action=lambda m: m.set_rate(fall, -restitution * m.beta_rate(fall)),
        name="floor",
    )
    return scene, fall, bounce


@pytest.mark.parametrize("h", [None, 0.01])
@pytest.mark.parametrize("restitution", [0.5, 0.2])
def test_impacts_that_follow_each_other_ever_faster_stop_the_run(restitution, h):
    """Flights last 2 e^n sqrt(2 / g): their sum is where all impacts are over, and nothing has fallen through."""
    scene, fall, bounce = bouncing(restitution)
    with pytest.raises(SimulationError, match=r"'floor' .* ever faster") as caught:
        scene.simulate(3.0, h=h, events=[bounce])
    run = caught.value.trajectory
    first = np.sqrt(2.0 / G)
    assert run.t[-1] == pytest.approx(first * (1.0 + 2.0 * restitution / (1.0 - restitution)), abs=1e-6)
    assert run.beta(fall).min() > -1e-9
    flights = np.diff([one.t for one in run.events])
    assert flights[:8] == pytest.approx(2.0 * first * restitution ** np.arange(1, 9), rel=1e-5)


def test_an_impact_that_leaves_no_speed_stops_the_run():
    scene, fall, bounce = bouncing(0.0)
    with pytest.raises(SimulationError, match="it rests there") as caught:
        scene.simulate(3.0, rtol=1e-9, events=[bounce])
    assert caught.value.trajectory.t[-1] == pytest.approx(np.sqrt(2.0 / G), abs=1e-9)
    assert caught.value.trajectory.beta(fall).min() > -1e-9


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"max_step": "a"}, "max_step = a s must be positive"),
        ({"checkpoints": 0.5}, r"checkpoints must be a list of times \(s\), got 0.5"),
        ({"checkpoints": [[0.5]]}, "checkpoints must be a list of times"),
    ],
)
def test_what_is_no_time_is_refused(arguments, told):
    scene, _, _ = pendulum()
    with pytest.raises(SceneError, match=told):
        scene.simulate(1.0, **arguments)
