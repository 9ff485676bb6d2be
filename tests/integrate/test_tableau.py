"""Explicit Runge-Kutta methods by coefficients of one's own: their order, their error control, what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from machines import pendulum, slider_crank

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.integrate.explicit.order_conditions import order_of

HEUN = ([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5])
THREE_EIGHTHS = (
    [[0.0, 0.0, 0.0, 0.0], [1 / 3, 0.0, 0.0, 0.0], [-1 / 3, 1.0, 0.0, 0.0], [1.0, -1.0, 1.0, 0.0]],
    [1 / 8, 3 / 8, 3 / 8, 1 / 8],
)


def test_orders_of_the_pairs():
    """Of those that are published, and of their embedded solutions."""
    found = {}
    for pair in fm.Pair:
        arrays = pair.tableau
        s = arrays.a.shape[1]
        whole = np.zeros((s + 1, s + 1))
        whole[:, :s] = arrays.a
        lower = [order_of(whole, np.append(arrays.a[-1], 0.0) - one) for one in arrays.estimates if one.any()]
        found[pair.label] = order_of(arrays.a[:-1], arrays.a[-1]), *lower
    assert list(found.values()) == [(4,), (5, 4), (8, 5, 3)]


@pytest.mark.parametrize("pair", list(fm.Pair))
def test_a_wrong_coefficient_lowers_the_order(pair):
    """Each coefficient of a published method is needed: none can be off by 1e-6 of the largest."""
    a = pair.tableau.a
    for i, j in zip(*np.nonzero(a), strict=True):
        changed = a.copy()
        changed[i, j] += 1e-6 * np.abs(a).max()
        assert order_of(changed[:-1], changed[-1]) < pair.order


@pytest.mark.parametrize(("order", "coefficients"), [(2, HEUN), (4, THREE_EIGHTHS)])
def test_order_on_machines(order, coefficients):
    """On a pendulum under a load in time, whose nodes count, and on a closed loop."""
    method = fm.ExplicitRungeKutta(fm.Tableau("own", order, *coefficients))
    hung, _, hinge = pendulum()
    hung.add_force(fm.force.JointTorque(hinge, fm.Sine(4.0, 5.0, 0.4)))
    crank, _, turning = slider_crank()
    turning.position, turning.velocity = 0.3, 10.0
    for scene, t_end, steps in ((hung, 1.0, (50, 100, 200)), (crank, 0.3, (100, 200, 400))):
        best = scene.simulate(t_end, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        errors = [np.abs(scene.simulate(t_end, h=t_end / n, integrator=method).x[-1] - best.x[-1]).max() for n in steps]
        orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
        assert orders.min() > order - 0.3, (errors, orders)


def test_own_coefficients_of_a_pair_are_the_pair():
    """Dormand's and Prince's; controlled steps differ by the rounding of estimates at the start."""
    arrays = fm.Pair.DORMAND_PRINCE_5.tableau
    own = fm.Tableau("own", 5, arrays.a[:-1], arrays.a[-1], np.append(arrays.a[-1], 0.0) - arrays.estimates[0])
    scene = pendulum()[0]
    methods = [fm.ExplicitRungeKutta(one) for one in (own, fm.Pair.DORMAND_PRINCE_5)]
    ours, theirs = (scene.simulate(1.0, h=1e-2, integrator=one) for one in methods)
    np.testing.assert_allclose(ours.x, theirs.x, atol=1e-13)
    ours, theirs = (scene.simulate(1.0, rtol=1e-7, integrator=one) for one in methods)
    assert abs(ours.stats.steps - theirs.stats.steps) <= 1
    np.testing.assert_allclose(ours.x[-1], theirs.x[-1], atol=1e-6)
    again = pickle.loads(pickle.dumps(methods[0]))
    np.testing.assert_array_equal(scene.simulate(1.0, rtol=1e-7, integrator=again).x, ours.x)


def test_error_control_of_a_pair_of_one_s_own():
    """Heun's with Euler's; the first weight of an estimate may vanish as well."""
    scene = pendulum()[0]
    best = scene.simulate(1.0, rtol=1e-11, integrator=fm.ExplicitRungeKutta())
    for a, b, embedded in ((*HEUN, [1.0, 0.0]), ([[0.0, 0.0], [0.5, 0.0]], [0.0, 1.0], [0.0, 0.0, 1.0])):
        method = fm.ExplicitRungeKutta(fm.Tableau("own 2(1)", 2, a, b, embedded))
        ends = [scene.simulate(1.0, rtol=rtol, integrator=method).x[-1] for rtol in (1e-2, 1e-3)]
        errors = [np.abs(end - best.x[-1]).max() for end in ends]
        assert errors[0] < 3e-2
        assert errors[1] < errors[0] / 5.0
    without = fm.ExplicitRungeKutta(fm.Tableau("Heun", 2, *HEUN))
    with pytest.raises(SceneError, match=r"Heun has no error estimate: give a step h"):
        scene.simulate(1.0, rtol=1e-3, integrator=without)


def test_fixed_steps_beyond_stability_are_told():
    """By the method's own polynomial: of order 4 with four stages it reaches to 2.83 over the rate of a vibration."""
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointSpring(hinge, 1e6))
    method = fm.ExplicitRungeKutta(fm.Tableau("three eighths", 4, *THREE_EIGHTHS))
    rate = 1e3  # 1/s, for 1 kg swings on an arm of 1 m
    scene.simulate(0.05, h=2.7 / rate, integrator=method)
    with pytest.raises(SceneError, match=r"beyond the stability of .*three eighths.*Take h = 0\.00283 s"):
        scene.simulate(1.0, h=3.0 / rate, integrator=method)


@pytest.mark.parametrize(
    ("said", "arguments"),
    [
        (r"own says order 3, but fulfils the conditions of order 2 alone", (3, *HEUN)),
        (r"own says order 1, but fulfils the conditions of order 0 alone", (1, [[0.0]], [0.9])),
        (r"own: a must be strictly lower", (2, [[0.0, 0.5], [0.5, 0.0]], [0.5, 0.5])),
        (r"b \(s,\) and a \(s, s\) must be of one number of stages, got \(2,\) and \(1, 1\)", (2, [[0.0]], [0.5, 0.5])),
        (r"order must lie between 1 and 8, got 9", (9, *HEUN)),
        (r"embedded must have 2 or 3 weights, got \(1,\)", (2, *HEUN, [1.0])),
        (r"embedded must be another solution, of order 1", (2, *HEUN, [0.5, 0.5])),
        (r"embedded must be another solution, of order 1", (2, *HEUN, [0.5, 0.4])),
        (r"Tableau: a must be", (2, "ab", [0.5, 0.5])),
    ],
)  # fmt: skip
def test_what_is_no_method_is_refused(said, arguments):
    with pytest.raises(SceneError, match=said):
        fm.Tableau("own", *arguments)
