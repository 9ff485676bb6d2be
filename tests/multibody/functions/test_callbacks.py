"""Users' functions called from inside the step: what they give, and what happens where they fail."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from machines import pendulum, slider_crank

import flexmbd as fm
from flexmbd.continuum.parallel import MpiTeam
from flexmbd.errors import SceneError
from flexmbd.run.stopped import SimulationError


def wheel():
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (0.25, 0.25, 0.25)), name="disc")
    return scene, scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame(), name="hinge")


@fm.compiled
def compiled_law(t, beta, rate):
    return -25.0 * beta - 0.8 * rate + t


@fm.compiled
def compiled_forces(t, x, v, out):
    out[0] = -25.0 * x[0] - 0.8 * v[0] + t


LAWS = {
    "Python law": lambda hinge: fm.force.JointLaw(hinge, lambda t, b, w: -25.0 * b - 0.8 * w + t),
    "compiled law": lambda hinge: fm.force.JointLaw(hinge, compiled_law),
    "Python state": lambda _: fm.force.StateForce(lambda t, x, v: -25.0 * x - 0.8 * v + t),
    "compiled state": lambda _: fm.force.StateForce(compiled_forces),
}


@pytest.mark.parametrize("kind", LAWS)
def test_a_user_force_makes_an_oscillator(kind):
    """I b'' + c b' + k b = t from b = 0.4: the closed form, whichever way the force is given."""
    scene, hinge = wheel()
    scene.add_force(LAWS[kind](hinge))
    hinge.position = 0.4
    run = scene.simulate(1.5, rtol=1e-7)
    t, inertia, k, c = run.t, 0.25, 25.0, 0.8
    decay = c / (2.0 * inertia)
    omega = np.sqrt(k / inertia - decay**2)
    b0, w0 = 0.4 + c / k**2, -1.0 / k  # without the particular solution t / k - c / k^2
    exact = np.exp(-decay * t) * (b0 * np.cos(omega * t) + (w0 + decay * b0) / omega * np.sin(omega * t))
    np.testing.assert_allclose(run.beta(hinge), exact + t / k - c / k**2, atol=2e-6)
    force = -k * run.beta(hinge) - c * run.beta_rate(hinge) + t
    np.testing.assert_allclose(run.drive(hinge), force, atol=1e-5)  # a user's force drives the joint


def test_all_ways_step_alike():
    ends = []
    for make in LAWS.values():
        scene, hinge = wheel()
        scene.add_force(make(hinge))
        hinge.position = 0.4
        run = scene.simulate(0.5, rtol=1e-6)
        ends.append((len(run.t), run.beta(hinge)[-1]))
    for count, end in ends:
        assert count == ends[0][0]
        assert end == pytest.approx(ends[0][1], rel=1e-12)


def test_a_callback_may_keep_and_change_what_it_gets():
    """Its arrays are copies."""
    scene, _, hinge = pendulum()
    kept = []

    def function(t, x, v):
        kept.append(x)
        x[:] = 7.0
        return np.zeros(1)

    plain = scene.simulate(0.1, integrator=fm.GeneralizedAlpha())
    scene.add_force(fm.force.StateForce(function))
    run = scene.simulate(0.1, integrator=fm.GeneralizedAlpha())
    np.testing.assert_array_equal(run.beta(hinge), plain.beta(hinge))
    assert all(x == 7.0 for x in kept)


def test_drive_leaves_springs_and_given_forces_out():
    scene, hinge = wheel()
    disc = hinge.child.body
    scene.add_force(fm.force.JointSpring(hinge, 3.0))
    scene.add_force(fm.force.FrameForce(disc.frame(), torque=(0.0, 0.0, fm.Sine(2.0, 3.0))))
    scene.add_force(fm.force.JointTorque(hinge, lambda t: 0.5 * t))
    hinge.position = 0.2
    run = scene.simulate(0.5, rtol=1e-6)
    np.testing.assert_allclose(run.drive(hinge), 0.5 * run.t, atol=1e-9)
    assert np.ptp(run.a) > 1.0


def test_explain_tells_elements_and_what_calls_python():
    scene, hinge = wheel()
    assert "force elements (none)" in scene.explain()
    scene.add_force(fm.force.JointSpring(hinge, 3.0))
    scene.add_force(fm.force.JointLaw(hinge, compiled_law))
    scene.add_force(fm.force.StateForce(lambda t, x, v: -v, "brake"))
    text = scene.explain()
    assert "\nJointSpring on joint 'hinge'\n" in text
    assert "JointLaw on joint 'hinge': called compiled\n" in text
    assert "StateForce 'brake': Python, called at each evaluation of the equations" in text
    assert "force elements (none)" not in text


# --- failures --------------------------------------------------------------------------------


def fails_late(answer):
    """1 up to t = 0.2, then what ``answer`` gives."""
    return lambda t, *_: answer() if t > 0.2 else 1.0


class Broken(Exception):
    """No built-in error, so that the cause is the user's own."""


def burst():
    raise Broken("the sensor is gone")


ANSWERS = {
    "raises": (burst, "the sensor is gone", Broken),
    "nan": (lambda: np.nan, r"it gave nan, not finite", SceneError),
    "shape": (lambda: [1.0, 2.0], r"it gave shape \(2,\), not one number", SceneError),
    "words": (lambda: "much", "could not convert string", ValueError),
    "nothing": (lambda: None, "it gave nan, not finite", SceneError),
}


@pytest.mark.parametrize("answer", ANSWERS)
def test_a_law_that_fails_says_which_when_and_where(answer):
    give, message, cause = ANSWERS[answer]
    scene, hinge = wheel()
    scene.add_force(fm.force.JointLaw(hinge, fails_late(give)))
    expected = rf"JointLaw on joint 'hinge' at t = 0\.2\d* s, coordinate 0\.\d+, rate 0\.8\d* failed.*{message}"
    with pytest.raises(SimulationError, match=expected) as caught:
        scene.simulate(1.0, integrator=fm.GeneralizedAlpha())
    assert type(caught.value.__cause__) is cause
    past = caught.value.trajectory
    assert 0.1 < past.t[-1] <= 0.2
    np.testing.assert_allclose(past.beta(hinge), 2.0 * past.t**2, atol=1e-8)
    # the scene runs on once its function does
    scene._forces.clear()
    assert scene.simulate(0.01).t[-1] == 0.01


def test_a_force_of_the_state_that_fails_tells_the_state():
    scene, _ = wheel()

    def control(t, x, v):
        return np.ones(1) if t <= 0.2 else np.ones(2)

    scene.add_force(fm.force.StateForce(control))
    state = r"\(x, v\) = \[0\.08\d+ 0\.8\d* *\]"
    expected = rf"StateForce 'control' at t = 0\.2\d* s, state {state} failed: it gave shape \(2,\), not shape \(1,\)"
    with pytest.raises(SimulationError, match=expected) as caught:
        scene.simulate(1.0, integrator=fm.GeneralizedAlpha())
    assert isinstance(caught.value.__cause__, SceneError)


def test_a_function_is_not_asked_again_after_it_failed():
    scene, hinge = wheel()
    asked = []

    def law(t, beta, rate):
        asked.append(t)
        if t > 0.2:
            raise Broken("once")
        return 1.0

    scene.add_force(fm.force.JointLaw(hinge, law))
    with pytest.raises(SimulationError, match="once"):
        scene.simulate(1.0, integrator=fm.GeneralizedAlpha())
    assert sum(t > 0.2 for t in asked) == 1


@pytest.mark.parametrize("kind", ["time", "law", "state"])
def test_a_compiled_function_that_gives_no_number(kind):
    scene, hinge = wheel()

    def state(t, x, v, out):
        out[0] = np.sqrt(0.3 - t)

    force = {
        "time": lambda: fm.force.JointTorque(hinge, fm.compiled(lambda t: np.sqrt(0.3 - t))),
        "law": lambda: fm.force.JointLaw(hinge, fm.compiled(lambda t, b, w: np.sqrt(0.3 - t))),
        "state": lambda: fm.force.StateForce(fm.compiled(state)),
    }[kind]()
    scene.add_force(force)
    name = "StateForce 'state'" if kind == "state" else f"{type(force).__name__} on joint 'hinge'"
    with pytest.raises(SimulationError, match=rf"{name} at t = 0\.3\d* s: the compiled function gave no") as caught:
        scene.simulate(1.0, rtol=1e-6, integrator=fm.GeneralizedAlpha())
    past = caught.value.trajectory
    assert 0.2 < past.t[-1] <= 0.3
    exact = (0.3**1.5 - (0.3 - past.t) ** 1.5) * 2.0 / 3.0 / 0.25
    np.testing.assert_allclose(past.beta_rate(hinge), exact, atol=1e-4)


def test_failures_at_the_start_are_errors_of_the_scene():
    for force in (
        lambda hinge: fm.force.JointLaw(hinge, lambda *_: burst()),
        lambda hinge: fm.force.JointTorque(hinge, lambda _: burst()),
    ):
        scene, hinge = wheel()
        scene.add_force(force(hinge))
        with pytest.raises(SceneError, match=r"on joint 'hinge' at t = 0 s.*the sensor is gone") as caught:
            scene.start()
        assert isinstance(caught.value.__cause__, Broken)
    scene, hinge = wheel()
    scene.add_force(fm.force.JointLaw(hinge, fm.compiled(lambda t, b, w: 1.0 / b)))
    with pytest.raises(SceneError, match="JointLaw on joint 'hinge' at t = 0 s: the compiled function gave no"):
        scene.simulate(1.0, integrator=fm.GeneralizedAlpha())


def test_an_interrupt_leaves_the_step_as_it_is():
    def interrupted():
        raise KeyboardInterrupt

    scene, hinge = wheel()
    scene.add_force(fm.force.JointLaw(hinge, fails_late(interrupted)))
    with pytest.raises(KeyboardInterrupt):
        scene.simulate(1.0, integrator=fm.GeneralizedAlpha())


def test_functions_of_the_wrong_kind():
    scene, hinge = wheel()
    with pytest.raises(SceneError, match="takes 2 arguments; a compiled function is"):
        fm.compiled(lambda t, x: x)
    scene.add_force(fm.force.JointTorque(hinge, compiled_law))
    with pytest.raises(SceneError, match="compiled_law takes 3 arguments, not the time alone"):
        scene.compile()
    with pytest.raises(SceneError, match="compiled_forces must take three arguments"):
        scene.add_force(fm.force.JointLaw(hinge, compiled_forces))
    with pytest.raises(SceneError, match="it must take four arguments"):
        scene.add_force(fm.force.StateForce(compiled_law))
    with pytest.raises(SceneError, match="float is not a function of t, x and v"):
        scene.add_force(fm.force.StateForce(1.0))
    with pytest.raises(SceneError, match="float is not a function of t, beta and its rate"):
        scene.add_force(fm.force.JointLaw(hinge, 1.0))


# --- several ranks ---------------------------------------------------------------------------


def controlled(answer):
    """A slider-crank with a Python law on its crank; ``answer`` has the law's arguments."""
    scene, _, j1 = slider_crank()
    scene.team = MpiTeam(MPI.COMM_WORLD, collective_functions=True)
    scene.add_force(fm.force.JointLaw(j1, answer))
    j1.velocity = 20.0
    return scene, j1


@pytest.mark.mpi
def test_ranks_that_answer_differently_step_alike():
    rank = MPI.COMM_WORLD.rank
    scene, _ = controlled(lambda t, b, w: 1.0 - 0.1 * w + 0.5 * rank)
    run = scene.simulate(0.05, rtol=1e-5)
    alone, _ = controlled(lambda t, b, w: 1.0 - 0.1 * w)
    alone.team = fm.System().team
    np.testing.assert_array_equal(run.x, alone.simulate(0.05, rtol=1e-5).x)


@pytest.mark.mpi
@pytest.mark.parametrize("answer", ANSWERS)
def test_a_law_that_fails_on_the_last_rank_stops_all(answer):
    give, _, _ = ANSWERS[answer]
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1
    scene, _ = controlled(lambda t, b, w: give() if last and t > 0.02 else 1.0)
    with pytest.raises(SimulationError, match=r"JointLaw on joint .* at t = 0\.02") as caught:
        scene.simulate(0.05, rtol=1e-4)
    times = MPI.COMM_WORLD.allgather(caught.value.trajectory.t)
    assert 0.01 < times[0][-1] <= 0.02
    for other in times:
        np.testing.assert_array_equal(other, times[0])
    # and all go on together afterwards
    scene._forces.clear()
    assert scene.simulate(0.01, rtol=1e-4).t[-1] == 0.01
