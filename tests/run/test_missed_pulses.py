"""What a Python function of time does within a long step is told; smooth functions and what steps saw are not."""

import math
import warnings

import numpy as np
import pytest

import flexmbd as fm


def pushed(force, mass):
    """A mass (kg) on a rail."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass, 3 * (mass,)), name="b")
    rail = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame(), name="rail")
    scene.add_force(fm.force.JointForce(rail, force))
    return scene, rail


def final_speed(force, *, mass=1.0, **settings):
    """And how many pulses were told."""
    scene, rail = pushed(force, mass)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        run = scene.simulate(3.0, **settings)
    assert all(one.category is fm.PulseWarning for one in told)
    return run.beta_rate(rail).ravel()[-1], [str(one.message) for one in told]


def pulse(begin, width, impulse=1.0):
    """2 sin^2 of its impulse (N s)."""

    def force(t):
        share = (t - begin) / width
        return 2.0 * impulse / width * math.sin(math.pi * share) ** 2 if 0.0 < share < 1.0 else 0.0

    return force


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("begin", [0.7, 1.0, 2.3])
@pytest.mark.parametrize("width", [0.01, 0.02])
def test_a_pulse_that_is_stepped_over_is_told(width, begin, unit):
    """Of some samples in its width, wherever it is."""
    speed, (text,) = final_speed(pulse(begin, width, unit), rtol=1e-6, mass=unit)
    assert speed == pytest.approx(0.0, abs=1e-9)
    when = float(text.split("about t = ")[1].split()[0])
    assert begin <= when <= begin + width
    assert "JointForce on joint 'rail'" in text
    known = fm.Piecewise(pulse(begin, width, unit), breaks=[begin, begin + width])
    speed, told = final_speed(known, rtol=1e-6, mass=unit)
    assert speed == pytest.approx(1.0, rel=1e-5)
    assert not told


def test_a_pulse_that_short_steps_meet_is_not_told():
    speed, told = final_speed(pulse(1.0, 0.05), rtol=1e-6, max_step=0.02)
    assert speed == pytest.approx(1.0, rel=1e-4)
    assert not told


SMOOTH = {
    "constant": lambda t: 3.0,
    "sine": lambda t: math.sin(2.0 * t),
    "fast sine": lambda t: 5.0 + math.sin(40.0 * t),
    "bell": lambda t: math.exp(-(((t - 1.0) / 0.2) ** 2)),
    "rise": lambda t: math.tanh(8.0 * (t - 1.0)),
    "kink": lambda t: max(0.0, t - 1.1),
    "ramp": lambda t: min(t / 0.4, 1.0),
    "numpy": lambda t: np.interp(t, [0.0, 0.5, 1.0, 3.0], [0.0, 1.0, 0.5, 0.0]),
}


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), fm.RadauIIA()])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("name", SMOOTH)
def test_what_steps_see_is_not_told(name, rtol, method):
    assert not final_speed(SMOOTH[name], rtol=rtol, integrator=method)[1]


def test_a_jump_within_a_fixed_step_is_told():
    speed, told = final_speed(lambda t: 1.0 if t > 1.2345 else 0.0, h=0.1, integrator=fm.RadauIIA())
    assert abs(speed - (3.0 - 1.2345)) > 1e-3
    assert len(told) == 1
    assert not final_speed(SMOOTH["sine"], h=0.1, integrator=fm.RadauIIA())[1]


def test_a_function_that_fails_where_the_run_does_not_ask_is_let_alone():
    asked = []

    def force(t):
        if asked and t not in asked and len(asked) > 1000:
            raise ValueError(t)
        asked.append(t)
        return 0.0

    assert final_speed(force) == (0.0, [])
