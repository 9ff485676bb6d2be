"""What error control believes of a step against the step's true local error, and what rtol means for modes."""

from __future__ import annotations

import numpy as np
import pytest
from particles import particle_body
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.multibody.team import Alone
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepping import Integration

END = 4.0
INERTIA = 1.0 / 12.0 + 0.25  # of the rod about its hinge, kg m^2


def driven_rod():
    """A rod of 1 kg and 1 m on a hinge, under a sine torque; its own size in angle is 1 rad."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    rod = scene.add(fm.RigidBody(1.0, (1e-4, 1 / 12, 1 / 12), (0.5, 0.0, 0.0)), name="rod")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame(), name="hinge")
    scene.add_force(fm.force.JointTorque(hinge, fm.Sine(2.0, 5.0, 0.3)))
    hinge.position, hinge.velocity = 0.4, 1.0
    return scene


def equation(t, y):
    return y[1], (2.0 * np.sin(5.0 * t + 0.3) - 9.81 * 0.5 * np.cos(y[0])) / INERTIA


def estimated_and_true(method, rtol):
    """(steps, 2) error of each step over rtol's share: as its estimate has it, and by the equation of motion.

    rtol's share is rtol times the machine's radians in the step, of 1 rad and of the speed at its rate.
    """
    start = driven_rod().start()
    at = new_snapshot(start, method, t_start=0.0, t_end=END, rtol=rtol, h=None)
    run = Integration(start, method, Alone(), at, one_by_one=True)
    found, code = [], st.OUTPUT
    while code == st.OUTPUT:
        t, x, v = run.t, run.state.x[0], run.state.v[0]
        code = run.advance(END)
        run.keep_rows()
        rate = run.state.numbers[st.RATE]
        exact = solve_ivp(equation, (t, run.t), (x, v), method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        share = rtol * min(1.0, (run.t - t) * rate)
        error = max(abs(run.state.x[0] - exact[0]), abs(run.state.v[0] - exact[1]) / rate) / share
        found.append((run.state.numbers[st.ERROR_RATIO], error))
    return np.array(found[4:])  # the first ones grow from a cautious start


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("rho", [0.0, 0.8, 1.0])
def test_generalized_alpha_knows_its_local_error(rho, rtol):
    """Within a few percent; less is believed where a step's own curvature gives it more radians."""
    estimated, true = estimated_and_true(fm.GeneralizedAlpha(rho), rtol).T
    low, middle, high = np.quantile(estimated / true, [0.05, 0.5, 0.95])
    assert true.max() < 1.3
    assert middle == pytest.approx(1.0, abs=0.02)
    assert 0.7 < low
    assert high < 1.1


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6])
def test_central_differences_estimate_the_true_error(rtol):
    estimated, true = estimated_and_true(fm.CentralDifference(), rtol).T
    assert np.median(estimated / true) == pytest.approx(1.0, rel=0.03)
    assert true.max() < 1.2


# Sum of the estimates over the sum of the errors: between these. A pair's estimate is that of its lower order.
CARE = {
    "Radau": (fm.RadauIIA(), 1.5, (1.5, 8.0)),  # it believes in the power 3/2 of what its estimate says
    "5(4)": (fm.ExplicitRungeKutta(), 1.0, (1.5, 60.0)),
    "8(5,3)": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1.0, (2.0, 10.0)),
}


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
@pytest.mark.parametrize("name", CARE)
def test_methods_of_high_order_believe_more_than_the_true_error(name, rtol):
    method, power, (least, most) = CARE[name]
    estimated, true = estimated_and_true(method, rtol).T
    assert true.max() < 1.2
    assert least < (estimated**power).sum() / true.sum() < most


def vibrating(*, hinged):
    """A limp body on the ground, all four modes swinging at 10 to 12 rad/s, by itself or on a slow hinge."""
    body = fm.FlexibleBody(particle_body(3, modes=4).record)
    scene = fm.System(gravity=(0.0, 0.0, -0.3 if hinged else 0.0))
    scene.add(body, name="body")
    kind = fm.joint.Revolute("y") if hinged else fm.joint.Fixed()
    joint = scene.connect(kind, scene.ground.frame(), body.frame("root"))
    if hinged:
        joint.velocity = 0.3
    body.q = (0.02, -0.01, 0.015, 0.01)
    return scene, body


@pytest.mark.parametrize("hinged", [False, True], ids=["clamped", "hinged"])
def test_modes_of_generalized_alpha_are_held_to_rtol(hinged):
    """The largest modal error, of the largest deformation: rtol for each of the vibration's 37 radians, no more.

    The clamped body's is q0 cos(w t); the hinge, ten times as slow, asks for much longer steps than its modes do.
    """
    t_end, allowed = 3.0, []
    for rtol in (1e-3, 1e-4, 1e-5):
        scene, body = vibrating(hinged=hinged)
        run = scene.simulate(t_end, rtol=rtol, integrator=fm.GeneralizedAlpha())
        w = np.sqrt(body.record.stiffness)
        if hinged:
            scene, twin = vibrating(hinged=True)
            tight = scene.simulate(t_end, rtol=1e-11, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
            exact = tight.q(twin, t=run.t)
        else:
            exact = body.q * np.cos(np.outer(run.t, w))
        error = np.abs(run.q(body) - exact).max() / np.abs(exact).max()
        allowed.append(error / (rtol * w.max() * t_end))
    assert 0.3 < min(allowed)
    assert max(allowed) < 1.1


def test_own_rates_fade_over_half_a_period():
    """By the largest of three rates, whether an exponential is needed or not."""
    machine, onset, least = 2.0, 4.0, 0.25
    for before in (0.0, 0.3, 2.0, 70.0):
        for shown in (0.0, 0.2, 0.3, 50.0, 1e3):
            for h in (1e-4, 1e-2, 0.06, 0.0625, 1.0):
                faded = max(least, np.exp(-2.0 * h * before / np.pi)) * before
                rate = max(min(shown, onset * max(before, machine)), faded)
                found = st.own_rate.py_func(shown, before, machine, h)  # type: ignore[attr-defined]
                assert found == pytest.approx(rate, rel=1e-14, abs=0.0)
