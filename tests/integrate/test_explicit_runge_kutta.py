"""Orders, tolerance, rotation updates, loops and singular positions of explicit Runge-Kutta.

References: Euler's equations of a top and the double pendulum's equations as written down here,
integrated by SciPy to round-off, and the digits of BENCHMARKS.
"""

from __future__ import annotations

import numpy as np
import pytest
from classic_machines import INERTIA, euler_top, heavy_top, loaded_slider_crank, rods_double_pendulum, turn
from machines import CRANK, pendulum, slider_position
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.multibody.team import Alone
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepping import Integration

PAIRS = list(fm.Pair)
CONTROLLED = [pair for pair in PAIRS if pair.estimates_error]








def observed_orders(errors):
    errors = np.array(errors)
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize("pair", PAIRS)
def test_tableau_meets_the_conditions_of_its_order(pair):
    """Quadrature conditions, sums of rows, and those of trees with a branch of height two."""
    table = pair.tableau
    a, weights, nodes = table.a[:-1], table.a[-1], table.nodes[:-1]
    np.testing.assert_allclose(table.a.sum(axis=1), table.nodes, atol=4e-15)
    for k in range(1, pair.order + 1):
        assert weights @ nodes ** (k - 1) == pytest.approx(1 / k, abs=2e-15)
    for k in range(1, pair.order - 1):
        for j in range(pair.order - k - 1):
            tree = weights @ (nodes**j * (a @ nodes**k))
            assert tree == pytest.approx(1 / ((k + 1) * (k + j + 2)), abs=1e-14)
    np.testing.assert_allclose(table.estimates.sum(axis=1), 0.0, atol=1e-15)


@pytest.mark.parametrize("rotations", list(fm.Rotations))
@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("inertia", [tuple(INERTIA), (0.234375, 0.46875, 0.3)], ids=["round", "uneven"])
def test_order_on_a_top(pair, rotations, inertia):
    """Heavy top at a spin of 12 rad/s: attitude and spin, by each update of rotations."""
    spin = (2.0, 12.0, -4.0)
    q, w, _ = euler_top(0.5, spin, inertia)
    scene, _ = heavy_top(spin=spin, inertia=inertia)
    method = fm.ExplicitRungeKutta(pair, rotations)
    errors = []
    # of a round top the spin is left out: fewer steps reach round-off
    few, many = ((2, 4, 8), (8, 16, 32)) if inertia[0] == inertia[2] else ((10, 20), (50, 100, 200))
    for n in few if pair.order == 8 else many:
        run = scene.simulate(0.5, h=0.5 / n, integrator=method)
        errors.append([np.abs(run.x[-1] - q).max(), np.abs(run.v[-1] - w).max()])
    orders = observed_orders(errors)
    assert orders[-1].min() > pair.order - 0.4, (errors, orders)


@pytest.mark.parametrize("pair", PAIRS)
def test_order_with_multipliers(pair):
    """The same top as a free body in a loop: position, velocity and the force at its tip."""
    spin = (2.0, 12.0, -4.0)
    q, w, force = euler_top(0.5, spin)
    scene, _ = heavy_top(closed=True, spin=spin)
    errors = []
    for n in (3, 6) if pair.order == 8 else (8, 16, 32):
        run = scene.simulate(0.5, h=0.5 / n, integrator=fm.ExplicitRungeKutta(pair))
        multipliers = -run.multipliers[-1]
        errors.append(
            [np.abs(run.x[-1, 3:] - q).max(), np.abs(run.v[-1, 3:] - w).max(), np.abs(multipliers - force).max()]
        )
        assert run.stats.constraint_residual < 1e-12
    orders = observed_orders(errors)
    assert orders[-1].min() > pair.order - 0.4, (errors, orders)




@pytest.mark.parametrize("pair", PAIRS)
def test_order_of_a_slider_crank(pair):
    """Against its fine solution: positions, velocities, multipliers, largest error over the run."""
    scene, _, _ = loaded_slider_crank()
    fine = scene.simulate(0.1, h=1e-4, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    errors = []
    for n in (20, 40) if pair.order == 8 else (80, 160):
        run = scene.simulate(0.1, h=0.1 / n, integrator=fm.ExplicitRungeKutta(pair))
        parts = ((run.x, fine.x), (run.v, fine.v), (run.multipliers, fine.multipliers))
        errors.append([np.abs(part[:: n // 20] - exact[::50]).max() for part, exact in parts])
    orders = observed_orders(errors)
    assert orders.min() > pair.order - 0.5, (errors, orders)


@pytest.mark.parametrize("pair", CONTROLLED)
def test_slider_crank_stays_closed(pair):
    """The slider stays where the crank's angle puts it, at every step."""
    scene, piston, j1 = loaded_slider_crank()
    run = scene.simulate(0.2, rtol=1e-6, integrator=fm.ExplicitRungeKutta(pair))
    x = run.position(piston.frame())
    assert np.abs(x[:, 0] - slider_position(run.beta(j1))).max() < 1e-13 * 2.0 * CRANK * 10.0
    assert np.abs(x[:, 1:]).max() < 1e-13


@pytest.mark.parametrize("pair", CONTROLLED)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_heavy_top_keeps_its_tolerance(pair, rtol):
    """BENCHMARKS A7 at 2 s: some 300 rad of rotation, each with rtol."""
    scene, top = heavy_top()
    run = scene.simulate(2.0, rtol=rtol, integrator=fm.ExplicitRungeKutta(pair))
    place = run.position(top.frame(p=(0.0, 1.0, 0.0)))[-1]
    exact = np.array([-0.150416822746, -0.724165591637, -0.673022269560])
    assert np.abs(place - exact).max() < 300.0 * rtol + 1e-12


def test_a_round_top_is_followed_by_its_axis():
    """A7 again: 300 rad of spin in 160 steps, and where the axis is between them."""
    scene, top = heavy_top()
    tip = top.frame(p=(0.0, 1.0, 0.0))
    run = scene.simulate(2.0, rtol=1e-6, integrator=fm.ExplicitRungeKutta())
    fine = scene.simulate(2.0, h=2.0 / 800, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    assert run.stats.steps < 170
    np.testing.assert_allclose(fine.position(tip)[-1], (-0.150416822746, -0.724165591637, -0.673022269560), atol=1e-11)
    np.testing.assert_allclose(run.position(tip, t=fine.t), fine.position(tip), atol=1e-7)
    np.testing.assert_allclose(run.velocity(tip, t=fine.t), fine.velocity(tip), atol=1e-6)
    np.testing.assert_allclose(run.rotation(tip, t=fine.t), fine.rotation(tip), atol=1e-7)




@pytest.mark.parametrize("pair", CONTROLLED)
@pytest.mark.parametrize(
    ("start", "places"),
    [
        (
            (0.0, 0.0),
            {
                1: (-1.6621151358, -1.0414666372),
                3: (1.3304368251, -1.3986448605),
                5: (1.8552219378, -0.7395679325),
            },
        ),
        (
            (0.0, -np.pi / 2),
            {
                1: (-1.4419899284, -0.5402322145),
                3: (-0.7953051438, 0.2018162218),
                5: (-1.0991590247, -1.3491665132),
            },
        ),
    ],
)
def test_double_pendulum_to_all_digits(pair, start, places):
    """BENCHMARKS A12 (i): the tip at 1, 3 and 5 s."""
    scene, tip = rods_double_pendulum(start)
    for t_end, place in places.items():
        run = scene.simulate(float(t_end), rtol=1e-12, integrator=fm.ExplicitRungeKutta(pair))
        np.testing.assert_allclose(run.position(tip)[-1, :2], place, atol=2e-10)


@pytest.mark.parametrize("pair", CONTROLLED)
def test_pendulum_follows_the_reference_in_proportion_to_rtol(pair):
    """BENCHMARKS A1 at 10 s."""
    scene, bob, _ = pendulum()
    tip = bob.frame(p=(1.0, 0.0, 0.0))
    for rtol in (1e-5, 1e-7, 1e-9):
        run = scene.simulate(10.0, rtol=rtol, integrator=fm.ExplicitRungeKutta(pair))
        assert np.abs(run.position(tip)[-1, :2] - (-0.275087462576, -0.961419205099)).max() < 60.0 * rtol


def four_bars(windows):
    """BENCHMARKS A2: a row of windows of rods of 1 m and 1 kg, upright; the first free corner at 1 m/s."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    hinge = fm.joint.Revolute("z")

    def rod(name):
        return scene.add(fm.RigidBody(1.0, np.diag([1e-4, 1 / 12, 1 / 12]), (0.5, 0.0, 0.0)), name=name)

    uprights = [rod(f"upright {k}") for k in range(windows + 1)]
    for k, upright in enumerate(uprights):
        foot = scene.connect(hinge, scene.ground.frame(p=(float(k), 0.0, 0.0)), upright.frame())
        foot.position = np.pi / 2
        if k == 0:
            foot.velocity = -1.0
    for k in range(windows):
        beam = rod(f"beam {k}")
        joint = scene.connect(hinge, uprights[k].frame(p=(1.0, 0.0, 0.0)), beam.frame())
        joint.position = -np.pi / 2
        scene.connect(hinge, beam.frame(p=(1.0, 0.0, 0.0)), uprights[k + 1].frame(p=(1.0, 0.0, 0.0)))
    return scene, uprights[0].frame(p=(1.0, 0.0, 0.0))


CORNER = np.array([0.328458111536, 0.944518538180])


@pytest.mark.parametrize("pair", PAIRS)
def test_singular_positions_are_crossed_with_fixed_steps(pair):
    """BENCHMARKS A2 and F8: two rank losses a turn, five turns, all loops redundant in space."""
    scene, corner = four_bars(2)
    run = scene.simulate(10.0, h=2e-3, integrator=fm.ExplicitRungeKutta(pair))
    assert np.abs(run.position(corner)[-1, :2] - CORNER).max() < 1e-6
    assert run.stats.constraint_residual < 1e-12


@pytest.mark.parametrize("pair", CONTROLLED)
def test_singular_positions_are_crossed_by_error_control(pair):
    scene, corner = four_bars(2)
    run = scene.simulate(10.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta(pair))
    assert np.abs(run.position(corner)[-1, :2] - CORNER).max() < 1e-6
    assert run.stats.constraint_residual < 1e-12


def test_a_method_without_an_estimate_wants_a_step():
    scene, _, _ = pendulum()
    with pytest.raises(fm.FlexmbdError, match=r"no error estimate.*step h.*DORMAND_PRINCE_5"):
        scene.simulate(1.0, integrator=fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4))


def test_a_fixed_step_far_too_long_fails_with_what_was_computed():
    scene, _ = heavy_top(spin=(0.0, 1e100, 1e100))
    with pytest.raises(fm.SimulationError, match="no finite state") as failure:
        scene.simulate(1.0, h=0.1, integrator=fm.ExplicitRungeKutta())
    assert failure.value.trajectory.t[0] == 0.0


def symmetric_top(tilt):
    """BENCHMARKS A8: inertia 5, 5, 1 about the tip, weight moment 20, spin 50 about its axis, tilted."""
    scene = fm.System(gravity=(0.0, 0.0, -20.0))
    top = scene.add(fm.RigidBody(1.0, np.diag([4.0, 4.0, 1.0]), (0.0, 0.0, 1.0)), name="top")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    ball.position = (np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0)
    ball.velocity = (0.0, 0.0, 50.0)
    return scene, top


@pytest.mark.parametrize("rotations", list(fm.Rotations))
@pytest.mark.parametrize("pair", CONTROLLED)
def test_symmetric_top_to_all_digits(pair, rotations):
    """BENCHMARKS A8: the axis at 1, 5 and 10 s, up to the side it leans to at the start."""
    scene, top = symmetric_top(0.05)
    run = scene.simulate(10.0, rtol=1e-11, integrator=fm.ExplicitRungeKutta(pair, rotations))
    axis = run.rotation(top.frame())[:, :, 2]
    height = np.sort(axis[:, 2])
    assert np.cos(0.054551690224342) < height[0] + 1e-12
    np.testing.assert_allclose(run.energy().total, 1269.9750052079, atol=1e-6)
    for t, exact in {
        1.0: (0.021541105, -0.0500103355, 0.998516373),
        5.0: (0.0470679597, 0.0241956756, 0.9985986063),
        10.0: (-0.0471322314, 0.0267486864, 0.9985304505),
    }.items():
        end = scene.simulate(t, rtol=1e-11, integrator=fm.ExplicitRungeKutta(pair, rotations))
        np.testing.assert_allclose(end.rotation(top.frame())[-1, :, 2], exact, atol=2e-10)


# --- functions of time, prescribed motion ----------------------------------------------------


def driven_pendulum():
    """A bar of 1 m on a carriage that a sine moves along x, its hinge loaded by a function of time."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    carriage = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name="carriage")
    bar = scene.add(fm.RigidBody(1.0, (1e-4, 1 / 12, 1 / 12), (0.5, 0.0, 0.0)), name="bar")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), carriage.frame())
    slide.prescribe(fm.Sine(0.2, 7.0, 0.3))
    hinge = scene.connect(fm.joint.Revolute("z"), carriage.frame(), bar.frame())
    return scene, slide, hinge


def driven_angle(t_end):
    """Angle and rate of the bar, by its own equation."""

    def equations(t, y):
        pull = 0.2 * 49.0 * np.sin(7.0 * t + 0.3)  # minus the carriage's acceleration
        torque = np.cos(3.0 * t) - 0.5 * 9.81 * np.cos(y[0]) - 0.5 * pull * np.sin(y[0])
        return y[1], 3.0 * torque

    return solve_ivp(equations, (0.0, t_end), (0.0, 0.0), method="DOP853", rtol=3e-14, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("pair", PAIRS)
def test_order_with_prescribed_motion_and_a_python_function(pair):
    scene, slide, hinge = driven_pendulum()
    scene.add_force(fm.force.JointTorque(hinge, lambda t: np.cos(3.0 * t)))
    angle, rate = driven_angle(1.0)
    errors = []
    for n in (16, 32) if pair.order == 8 else (100, 200):
        run = scene.simulate(1.0, h=1.0 / n, integrator=fm.ExplicitRungeKutta(pair))
        errors.append([abs(run.beta(hinge)[-1] - angle), abs(run.beta_rate(hinge)[-1] - rate)])
        for found, exact in (
            (run.beta(slide), 0.2 * np.sin(7.0 * run.t + 0.3)),
            (run.beta_rate(slide), 1.4 * np.cos(7.0 * run.t + 0.3)),
        ):
            np.testing.assert_allclose(found, exact, atol=1e-14)
    assert observed_orders(errors).min() > pair.order - 0.5, errors


@pytest.mark.parametrize("pair", PAIRS)
def test_a_function_that_raises_stops_the_run_where_it_stands(pair):
    scene, _, hinge = driven_pendulum()

    def torque(t):
        if t > 0.4:
            raise ValueError("no table beyond 0.4 s")
        return 0.0

    scene.add_force(fm.force.JointTorque(hinge, torque))
    with pytest.raises(fm.SimulationError, match="no table beyond") as failure:
        scene.simulate(1.0, h=0.03, integrator=fm.ExplicitRungeKutta(pair))
    assert failure.value.trajectory.t[-1] == pytest.approx(0.39)


# --- long runs ---------------------------------------------------------------------------------


def tumbling(spin=(0.3, 2.0, 0.1)):
    """A free body about its middle axis, no load: angular momentum and energy are kept."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, np.diag([1.0, 2.0, 3.0])), name="body")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    ball.velocity = spin
    return scene


def momentum(x, v):
    return turn(x) @ (np.array([1.0, 2.0, 3.0]) * v)


@pytest.mark.parametrize("rotations", list(fm.Rotations))
def test_many_steps_keep_rotations_and_momentum(rotations):
    """Tumbling for 10^5 steps: unit quaternion to round-off, momentum to the method's error."""
    start = tumbling().start()
    method = fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4, rotations)
    snapshot = new_snapshot(start, method, t_start=0.0, t_end=1e3, rtol=1e-6, h=0.01)
    integration = Integration(start, method, Alone(), snapshot, one_by_one=False)
    before = momentum(start.x, start.v)
    code = st.OUTPUT
    while code == st.OUTPUT:
        code = integration.advance(1e3)
    assert integration.state.counts[st.STEPS] == pytest.approx(100_000, abs=1)
    x = integration.state.x
    np.testing.assert_allclose(turn(x).T @ turn(x), np.eye(3), atol=1e-14)
    assert np.linalg.norm(x) == pytest.approx(1.0, abs=1e-15)
    drift = np.linalg.norm(momentum(x, integration.state.v) - before) / np.linalg.norm(before)
    assert drift < 1e-6


@pytest.mark.parametrize("rotations", list(fm.Rotations))
@pytest.mark.parametrize("pair", PAIRS)
def test_momentum_drifts_with_the_order(pair, rotations):
    scene = tumbling()
    drifts = []
    for n in (60, 120):
        run = scene.simulate(20.0, h=20.0 / n, integrator=fm.ExplicitRungeKutta(pair, rotations))
        drifts.append(np.abs(momentum(run.x[-1], run.v[-1]) - momentum(run.x[0], run.v[0])).max())
    assert np.log2(drifts[0] / drifts[1]) > pair.order - 0.5, drifts


def test_restart_from_a_checkpoint_is_the_same_to_the_bit():
    scene, _, _ = loaded_slider_crank()
    method = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
    whole = scene.simulate(0.1, rtol=1e-7, integrator=method, checkpoints=[0.05])
    rest = scene.simulate(0.1, integrator=method, restart=whole.checkpoints[0])
    np.testing.assert_array_equal(rest.x[-1], whole.x[-1])
    np.testing.assert_array_equal(rest.multipliers[-1], whole.multipliers[-1])
