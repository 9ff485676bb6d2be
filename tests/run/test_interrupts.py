"""Interrupts while a user's Python function runs inside a compiled step, at any of the interpreter's instructions."""

from __future__ import annotations

import signal
import sys
import time

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.multibody.functions import callback
from flexmbd.run.interrupts import interrupts_handled

WHEN = 0.3  # s: the first call after it is interrupted


def wheel(make):
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (0.25, 0.25, 0.25)), name="disc")
    hinge = scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame(), name="hinge")
    hinge.position = 0.4
    scene.add_force(make(hinge))
    return scene, hinge


class Interrupter:
    """Raises KeyboardInterrupt at the n-th instruction of the first call after WHEN, as a signal's handler may."""

    def __init__(self, n):
        self.left, self.call, self.over, self.done = n, None, False, False

    def __call__(self, frame, event, _):
        if self.over:
            return None
        if self.call is None and frame.f_code in callback._calls and frame.f_locals["t"] > WHEN:
            self.call = frame
        if self.call is None or frame.f_code.co_filename != callback.__file__:
            return None
        frame.f_trace_opcodes = True
        self.left -= 1
        if self.left < 0:
            self.over = self.done = True
            raise KeyboardInterrupt
        self.over = frame is self.call and event == "return"
        return self


FORCES = {
    "torque": lambda hinge: fm.force.JointTorque(hinge, lambda t: 5.0 * np.cos(t)),
    "law": lambda hinge: fm.force.JointLaw(hinge, lambda t, b, w: -25.0 * b),
    "state": lambda _: fm.force.StateForce(lambda t, x, v: -25.0 * x),
}


@pytest.mark.parametrize("kind", FORCES)
@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.RadauIIA()])
def test_an_interrupt_at_any_instruction_ends_the_run(kind, method, capsys):
    scene, _ = wheel(FORCES[kind])
    whole = scene.simulate(0.5, integrator=method)
    capsys.readouterr()  # what is compiled first is told
    n, before = 0, sys.gettrace()
    while True:
        interrupter, kept = Interrupter(n), None
        try:
            sys.settrace(interrupter)
            scene.simulate(0.5, integrator=method)
        except fm.SimulationInterrupted as caught:
            kept = caught.trajectory
        finally:
            sys.settrace(before)
        if not interrupter.done:
            break
        assert kept is not None, f"the interrupt at instruction {n} was lost"
        assert 0.0 < kept.t[-1] < 0.5
        np.testing.assert_array_equal(kept.x, whole.x[: len(kept.t)])  # no step was taken with a stale value
        n += 1
    assert n > 10
    assert capsys.readouterr().err == ""


def test_an_interrupt_between_steps_keeps_what_was_computed():
    scene, hinge = wheel(lambda hinge: fm.force.JointSpring(hinge, 25.0))

    def interrupted(moment):
        if moment.t > WHEN:
            raise KeyboardInterrupt
        return 1.0

    with pytest.raises(fm.SimulationInterrupted, match=r"interrupted at t = 0\.\d+ s; what was computed") as caught:
        scene.simulate(1.0, events=[fm.Event(interrupted)])
    kept = caught.value.trajectory
    assert 0.1 < kept.t[-1] <= WHEN
    assert (np.diff(kept.t) > 0.0).all()
    np.testing.assert_allclose(kept.beta(hinge), 0.4 * np.cos(10.0 * kept.t), atol=1e-5)


def test_other_exceptions_of_a_handler_are_told_as_the_users_own():
    class Late(Exception):
        pass

    scene, _ = wheel(FORCES["torque"])
    seen = []

    def trace(frame, event, _):
        if not seen and frame.f_code in callback._calls and frame.f_locals.get("t", 0.0) > WHEN:
            seen.append(event)
            raise Late("too late")

    before = sys.gettrace()
    try:
        sys.settrace(trace)
        with pytest.raises(fm.FlexmbdError, match="too late") as caught:
            scene.simulate(0.5)
    finally:
        sys.settrace(before)
    assert isinstance(caught.value.__cause__, Late)
    assert scene.simulate(0.5).t[-1] == 0.5


def test_what_others_cannot_raise_goes_where_it_went(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", lambda args: told.append(args.exc_value))
    wheel(FORCES["torque"])[0].simulate(0.1)

    class Stranger:
        def __del__(self):
            raise ValueError("not ours")

    Stranger()
    assert [str(one) for one in told] == ["not ours"]


class Dying:
    """Is interrupted while it is finalised, where nothing can catch it."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_what_comes_in_a_finaliser_comes_again():
    def interrupted():
        with interrupts_handled(signal.default_int_handler):
            Dying()
            time.sleep(30.0)
            pytest.fail("nothing came")

    with pytest.raises(KeyboardInterrupt):
        interrupted()


def test_what_comes_again_comes_within_its_block():
    def interrupted():
        with interrupts_handled(signal.default_int_handler):
            Dying()

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    time.sleep(0.2)  # a stray one would stop the tests


def test_what_ends_a_block_is_not_followed_by_an_interrupt():
    def failing():
        with interrupts_handled(signal.default_int_handler):
            Dying()
            raise ValueError("its own end")

    with pytest.raises(ValueError, match="its own end"):
        failing()
    time.sleep(0.2)


def test_what_comes_again_is_heard_once():
    heard = []
    with interrupts_handled(lambda *_: heard.append("outer") if heard else raise_interrupt(heard)):
        Dying()
        time.sleep(0.2)
    assert heard == ["first", "outer"]


def raise_interrupt(heard):
    heard.append("first")
    raise KeyboardInterrupt


def test_ctrl_c_that_would_end_the_process_ends_the_run():
    """As gmsh's own initialize() leaves it; after the run it is as before."""
    scene, _ = wheel(FORCES["torque"])

    def interrupted(moment):
        if moment.t > WHEN:
            signal.raise_signal(signal.SIGINT)
        return 1.0

    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        with pytest.raises(fm.SimulationInterrupted) as caught:
            scene.simulate(1.0, events=[fm.Event(interrupted)])
        assert signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, before)
    assert 0.1 < caught.value.trajectory.t[-1] < 1.0
