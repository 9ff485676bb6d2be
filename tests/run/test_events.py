"""Events: where they are found, what counts as one, what an action may do."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum, slider_crank
from scipy.special import ellipk

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError

PERIOD = 4.0 / np.sqrt(9.81) * ellipk(0.5)


def falling_ball(height):
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    drop = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    drop.position = height
    return scene, drop


def lowest(hinge):
    return lambda moment: moment.beta(hinge) - 1.5 * np.pi


@pytest.mark.parametrize(
    ("direction", "quarters"),
    [(fm.Direction.EITHER, [1, 3, 5, 7]), (fm.Direction.RISING, [1, 5]), (fm.Direction.FALLING, [3, 7])],
)
def test_a_pendulum_passes_its_lowest_point(direction, quarters):
    """At odd quarters of the closed-form period; from -x it begins by turning to larger angles."""
    scene, _, hinge = pendulum()
    event = fm.Event(lowest(hinge), direction=direction, name="lowest")
    run = scene.simulate(2.0 * PERIOD, rtol=1e-8, events=[event])
    assert [one.event for one in run.events] == [event] * len(quarters)
    assert [one.t for one in run.events] == pytest.approx(0.25 * PERIOD * np.array(quarters), abs=1e-6)
    rows = [one.row for one in run.events]
    assert run.t[rows] == pytest.approx([one.t for one in run.events], abs=0.0)
    assert run.beta(hinge)[rows] == pytest.approx(1.5 * np.pi, abs=1e-12)
    assert run.t[-1] == 2.0 * PERIOD


def test_an_event_may_stop_the_run():
    scene, _, hinge = pendulum()
    run = scene.simulate(10.0, rtol=1e-7, events=[fm.Event(lowest(hinge), stop=True)])
    assert run.t[-1] == run.events[0].t == pytest.approx(0.25 * PERIOD, abs=1e-5)


@pytest.mark.parametrize("h", [None, 0.01])
def test_a_ball_bounces(h):
    """With restitution 1/2 each flight lasts half as long; constant acceleration is exact."""
    scene, drop = falling_ball(1.0)

    def bounce(moment):
        moment.set_rate(drop, -0.5 * moment.beta_rate(drop))

    ground = fm.Event(lambda m: m.beta(drop), direction=fm.Direction.FALLING, action=bounce)
    run = scene.simulate(1.0, h=h, events=[ground])
    fall = np.sqrt(2.0 / 9.81)
    assert [one.t for one in run.events] == pytest.approx([fall, 2.0 * fall], abs=1e-9)
    before, after = run.events[0].row, run.events[0].row + 1
    assert run.t[before] == run.t[after]
    assert run.beta_rate(drop)[after] == pytest.approx(-0.5 * run.beta_rate(drop)[before], rel=1e-14)
    rest = 1.0 - 2.0 * fall
    expected = 0.25 * 9.81 * fall * rest - 0.5 * 9.81 * rest**2
    assert run.beta(drop)[-1] == pytest.approx(expected, abs=1e-9)


def test_velocities_after_an_impact_keep_the_loops_closed():
    scene, _, crank = slider_crank()
    crank.velocity = 20.0

    def stop(moment):
        moment.set_rate(crank, 5.0)

    event = fm.Event(lambda m: m.beta(crank) - 1.0, action=stop)
    run = scene.simulate(0.1, rtol=1e-7, events=[event])
    row = run.events[0].row + 1
    assert run.beta_rate(crank)[row] == pytest.approx(5.0, abs=1e-12)
    assert run.stats.constraint_residual < 1e-12
    piston = run.bodies["piston"]
    angle = run.beta(crank)[row]
    ratio = 0.08 * np.sin(angle) * (1.0 + 0.08 * np.cos(angle) / np.sqrt(0.3**2 - (0.08 * np.sin(angle)) ** 2))
    assert run.velocity(piston.frame())[row, 0] == pytest.approx(-5.0 * ratio, rel=1e-9)


def test_the_first_of_two_events_in_one_step_comes_first():
    scene, drop = falling_ball(1.0)
    seen = []
    low = fm.Event(lambda m: m.beta(drop) - 0.50, action=lambda m: seen.append(("low", m.t)), name="low")
    high = fm.Event(lambda m: m.beta(drop) - 0.51, action=lambda m: seen.append(("high", m.t)), name="high")
    scene.simulate(0.4, h=0.1, events=[low, high])
    assert [name for name, _ in seen] == ["high", "low"]
    assert [t for _, t in seen] == pytest.approx(np.sqrt(2.0 * np.array([0.49, 0.5]) / 9.81), abs=1e-12)


def test_a_function_that_never_changes_sign_is_no_event():
    scene, drop = falling_ball(1.0)
    run = scene.simulate(0.3, events=[fm.Event(lambda m: m.beta(drop) + 10.0, stop=True)])
    assert run.events == ()
    assert run.t[-1] == 0.3


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda m: np.nan, r"event 'odd' at t = .* not one finite number"),
        (lambda m: [1.0, 2.0], r"event 'odd' at t = .* not one finite number"),
        (lambda m: 1 / 0, r"event 'odd' at t = .*division by zero"),
    ],
)
def test_a_bad_event_function_is_named(function, message):
    scene, _ = falling_ball(1.0)
    with pytest.raises(SceneError, match=message):
        scene.simulate(0.3, events=[fm.Event(function, name="odd")])


@pytest.mark.parametrize("direction", [1, 0, -1.0, "RISING", None, fm.Direction])
def test_a_direction_is_one_of_three(direction):
    with pytest.raises(SceneError, match=r"'odd': direction must be Direction\.EITHER or .*RISING or .*FALLING, got"):
        fm.Event(lambda m: 1.0, direction=direction, name="odd")


def test_an_event_that_fails_later_leaves_what_was_computed():
    scene, _ = falling_ball(1.0)

    def function(moment):
        if moment.t > 0.1:
            raise KeyError("gone")
        return 1.0

    with pytest.raises(SimulationError, match=r"event 'odd' at t = 0\.1.*gone") as caught:
        scene.simulate(0.3, h=0.01, events=[fm.Event(function, name="odd")])
    assert caught.value.trajectory.t[-1] == pytest.approx(0.1, abs=0.011)
    assert isinstance(caught.value.__cause__.__cause__, KeyError)


def test_an_action_may_set_only_what_there_is():
    scene, drop = falling_ball(1.0)

    def act(moment):
        moment.set_rate(drop, [1.0, 2.0])

    with pytest.raises(SimulationError, match="takes 1 finite velocities"):
        scene.simulate(1.0, events=[fm.Event(lambda m: m.beta(drop), action=act)])


def test_passages_of_which_a_step_holds_many_are_all_found():
    """A clock of 100 ticks in steps that are five times as long by themselves."""
    scene, *_ = falling_bar()
    assert scene.simulate(1.0).stats.steps < 50
    clock = fm.Event(lambda m: np.sin(100.0 * np.pi * m.t))
    ticks = [one.t for one in scene.simulate(0.995, events=[clock]).events]
    np.testing.assert_allclose(ticks, 0.01 * np.arange(1, 100), atol=1e-13)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.EventWarning")
@pytest.mark.parametrize("begins_at_zero", [True, False])
@pytest.mark.parametrize("passages", [1, 2, 3, 7, 40])
def test_passages_within_the_first_step_are_all_found(passages, begins_at_zero):
    """A clock that ticks so often in the first step, of which nothing is known but that step's ends."""
    scene, _ = falling_ball(1.0)
    omega = np.pi * (passages + 0.3) / 0.1
    phase = 0.0 if begins_at_zero else 0.25 * np.pi
    clock = fm.Event(lambda m: np.sin(omega * m.t + phase))
    ticks = [one.t for one in scene.simulate(0.1, h=0.1, events=[clock]).events]
    exact = (np.arange(1, passages + 1) * np.pi - phase) / omega
    np.testing.assert_allclose(ticks, exact, atol=1e-13)


def test_what_begins_at_zero_and_leaves_it_does_not_pass():
    scene, drop = falling_ball(1.0)
    run = scene.simulate(0.3, h=0.1, events=[fm.Event(lambda m: m.beta(drop) - 1.0)])
    assert run.events == ()


@pytest.mark.parametrize("h", [None, 0.01])
@pytest.mark.parametrize("speed", [-1.0, 0.0, 1.0])
def test_a_ball_that_begins_on_the_ground_does_not_fall_through(h, speed):
    """Thrown down it bounces at once, thrown up after its flight; at rest the action cannot hold it, which is told."""
    scene, drop = falling_ball(0.0)
    drop.velocity = speed

    def bounce(moment):
        moment.set_rate(drop, -moment.beta_rate(drop))

    ground = fm.Event(lambda m: m.beta(drop), direction=fm.Direction.FALLING, action=bounce)
    if speed == 0.0:
        with pytest.raises(SimulationError, match="rests there"):
            scene.simulate(0.3, h=h, events=[ground])
        return
    run = scene.simulate(0.3, h=h, events=[ground])
    flight = 2.0 / 9.81
    exact = [0.0, flight] if speed < 0.0 else [flight]
    assert [one.t for one in run.events] == pytest.approx(exact, abs=1e-12)
    assert run.beta(drop).min() > -1e-12


@pytest.mark.parametrize("place", [1.0, 1.0 - 2.0**-53, 1.0 - 2.0**-50])
def test_an_event_may_lie_at_the_end(place):
    """Within the round-off of the end there is no time to look into."""
    scene, drop = falling_ball(0.0)
    scene.gravity = (0.0, 0.0, 0.0)
    drop.velocity = 1.0
    run = scene.simulate(1.0, events=[fm.Event(lambda m: m.beta(drop) - place)])
    assert [one.t for one in run.events] in ([], [pytest.approx(place, abs=1e-15)])
    assert run.t[-1] == 1.0


def test_what_passes_and_comes_back_within_a_step_is_found():
    """A pendulum that goes past a level which no step's end reaches, there and back."""
    scene, hinge, _ = falling_bar()
    method, end = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1.8
    plain = scene.simulate(end, rtol=1e-3, integrator=method)
    level = 0.5 * (plain.beta(hinge).max() + plain.beta(hinge, t=np.linspace(0.0, end, 1801)).max())
    passes = fm.Event(lambda m: float(m.beta(hinge)) - level)
    found = [one.t for one in scene.simulate(end, rtol=1e-3, integrator=method, events=[passes]).events]
    exact = [one.t for one in scene.simulate(end, h=1e-3, integrator=method, events=[passes]).events]
    assert len(found) == 2
    np.testing.assert_allclose(found, exact, atol=1e-2)


def falling_bar():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bar = scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.02), com=(0.5, 0.0, 0.0)), name="bar")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bar.frame())
    hinge.position = 0.3
    return scene, hinge, bar


def test_a_clock_is_heard_whole_and_warned_of():
    """Steps of 0.1 s, of which ends and one look fall on like places of a sine: 8 of a hundred ticks were heard."""
    scene, *_ = pendulum()
    clock = fm.Event(lambda now: np.sin(np.pi * (now.t / 0.01 - 0.5)), name="clock")
    with pytest.warns(fm.EventWarning, match="'clock' passes through zero at least .* let a controller sample"):
        run = scene.simulate(0.3, rtol=1e-3, events=[clock])
    np.testing.assert_allclose([one.t for one in run.events], 0.01 * (0.5 + np.arange(30)), atol=1e-9)


def test_a_short_dip_within_a_long_step_is_found():
    scene, *_ = pendulum()
    dip = fm.Event(lambda now: abs(now.t - 0.537) - 1e-2)
    assert [one.t for one in scene.simulate(1.0, rtol=1e-3, events=[dip]).events] == pytest.approx([0.527, 0.547])
