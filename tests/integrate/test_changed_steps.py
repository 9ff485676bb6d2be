"""Steps of changing length: generalized-alpha keeps its order, for what it carries over belongs to its own instant."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum, slider_crank

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.multibody.team import Alone
from flexmbd.run.stepping import Integration, new_snapshot

END = 0.48
PATTERNS = {"1:2": (1.0, 2.0), "1:3:2": (1.0, 3.0, 2.0), "equal": (1.0,)}


def swinging_pendulum():
    scene, _, hinge = pendulum()
    hinge.velocity = 3.0
    return scene


def driven_slider_crank():
    scene, _, crank = slider_crank()
    scene.add_force(fm.force.JointTorque(crank, fm.Sine(3.0, 20.0, 0.4)))
    crank.position, crank.velocity = 0.3, 10.0
    return scene


MACHINES = {"tree": (swinging_pendulum, 1.0), "loop": (driven_slider_crank, 0.2)}  # and the share of END to take


def end_of(scene, method, pattern, steps, t_end):
    """x, v and multipliers at ``t_end`` after steps whose lengths repeat a pattern."""
    start = scene.start()
    lengths = np.resize(pattern, steps)
    lengths *= t_end / lengths.sum()
    at = new_snapshot(start, method, t_start=0.0, t_end=t_end, rtol=1e-10, h=float(lengths[0]))
    integration = Integration(start, method, Alone(), at, one_by_one=True)
    for length in lengths:
        integration.state.numbers[st.STEP] = length
        integration.advance(t_end)
        integration.keep_rows()
    t, x, v, _, multipliers = integration.series()
    np.testing.assert_allclose(np.diff(t), lengths, rtol=1e-6)
    return x[-1], v[-1], multipliers[-1]


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize(("name", "rho"), [("tree", 0.0), ("tree", 0.8), ("loop", 0.5), ("loop", 0.8)])
def test_order_two_at_changing_steps(name, rho, pattern):
    """Lengths that repeat a pattern, all of them halved, against an explicit method to 1e-12.

    In loops at rho = 0 and 0.2 multipliers grow where lengths go as 1:2 or 1:3 from each step to the next; the
    controller, which holds a step's length for several steps, does not do that.
    """
    build, share = MACHINES[name]
    t_end = share * END
    exact = build().simulate(t_end, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    expected = exact.x[-1], exact.v[-1], exact.multipliers[-1]
    parts = 3 if exact.multipliers.size else 2
    errors = []
    for steps in (480, 960, 1920):
        found = end_of(build(), fm.GeneralizedAlpha(rho), PATTERNS[pattern], steps, t_end)
        errors.append([np.abs(a - b).max() for a, b in zip(found[:parts], expected, strict=False)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders.min() > 1.85, (errors, orders)
    assert orders[:, :2].max() < 2.3, (errors, orders)
