"""Steps of changing length: generalized-alpha keeps its order, for what it carries over belongs to its own instant."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum, slider_crank

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.step_history import carry_auxiliary
from flexmbd.integrate.alpha.workspace import AlphaMemory
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.team import Alone
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepping import Integration

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
@pytest.mark.parametrize(("name", "rho"), [("tree", 0.0), ("tree", 0.8), ("loop", 0.0), ("loop", 0.2), ("loop", 0.8)])
def test_order_two_at_changing_steps(name, rho, pattern):
    """Lengths that repeat a pattern, all of them halved, against an explicit method to 1e-12."""
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
    assert orders[-1].min() > 1.85, (errors, orders)
    assert orders[:, 0].max() < 2.3, (errors, orders)  # velocities' leading error may be passing through zero


@pytest.mark.parametrize("rho", [0.0, 0.2, 0.5, 0.8])
def test_stiff_vibrations_do_not_grow_at_changing_steps(rho):
    """A spring that the steps do not resolve, let go once, on steps that double and halve in turns."""
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointSpring(hinge, 1e12))
    hinge.position = 1e-3
    _, v, _ = end_of(scene, fm.GeneralizedAlpha(rho), PATTERNS["1:2"], 400, END)
    start = scene.start()
    assert np.abs(v).max() < 1e-3 * END * np.abs(start.a).max()


@entry_kernel
def carry(state, memory, h):
    """The kernel, from Python."""
    carry_auxiliary(state, memory, h)


def test_the_history_of_a_rejected_step_leaves_no_trace():
    """An auxiliary acceleration carried to a step that is rejected, and then to another, is as if carried at once."""
    start = driven_slider_crank().start()
    method = fm.GeneralizedAlpha(0.2)
    at = new_snapshot(start, method, t_start=0.0, t_end=END, rtol=1e-6, h=1e-3)
    integration = Integration(start, method, Alone(), at, one_by_one=True)
    for _ in range(4):
        integration.advance(END)
        integration.keep_rows()
    state, memory = integration.state, integration.memory
    assert isinstance(memory, AlphaMemory)
    kept = memory.auxiliary.copy()
    found = []
    for lengths in ((2e-3, 1.5e-3, 4e-4), (4e-4,)):
        memory.auxiliary[:], memory.step_auxiliary[0] = kept, 1e-3
        for h in lengths:
            carry(state, memory, h)
        found.append(memory.auxiliary.copy())
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    assert np.abs(found[0] - kept).max() > 1e-3 * np.abs(kept).max()
