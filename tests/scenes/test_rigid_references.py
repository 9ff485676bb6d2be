"""Pendulums, tops and closed loops against closed forms and independent solutions, by every integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mechanisms as machine
import numpy as np
import pytest
from mechanisms import Mechanism
from scipy.interpolate import CubicHermiteSpline

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator


@dataclass(frozen=True)
class Method:
    """An integrator, the rtol it is run with, and how far from the references it may end by its order.

    Attributes:
        reach: largest distance (m) from each mechanism's references; the references' own digits bound it below.
        stiff: whether it runs stiff machines in few steps.
    """

    label: str
    make: Callable[[], Integrator]
    rtol: float
    reach: dict[str, float]
    stiff: bool = True


# what is read off between the steps, like periods, is less certain than their ends
_ALL_DIGITS = {
    "pendulum": 5e-9,
    "rods, both horizontal": 2e-9,
    "rods, second hanging": 2e-9,
    "tip masses, both horizontal": 5e-10,
    "tip masses, second hanging": 5e-10,
    "heavy top": 2e-9,
    "fast top": 2e-9,
}

# of second order: what it reaches in a second; the errors fall with rtol
METHODS = [
    Method(
        "generalized-alpha",
        fm.GeneralizedAlpha,
        1e-8,
        {
            "pendulum": 1e-6,
            "rods, both horizontal": 5e-6,
            "rods, second hanging": 1e-4,
            "tip masses, both horizontal": 5e-7,
            "tip masses, second hanging": 1e-6,
            "heavy top": 5e-5,
            "fast top": 5e-5,
            "governor": 1e-4,
        },
    ),
    Method(
        "Radau IIA",
        fm.RadauIIA,
        1e-11,
        {
            "pendulum": 1e-9,
            "rods, both horizontal": 1e-8,
            "rods, second hanging": 1e-8,
            "tip masses, both horizontal": 1e-8,
            "tip masses, second hanging": 1e-8,
            "heavy top": 3e-6,
            "fast top": 1e-6,
            "governor": 1e-6,
        },
    ),
    Method("Dormand-Prince 5(4)", fm.ExplicitRungeKutta, 1e-11, {**_ALL_DIGITS, "heavy top": 2e-8}, stiff=False),
    Method(
        "Dormand-Prince 8(5,3)",
        partial(fm.ExplicitRungeKutta, fm.Pair.DORMAND_PRINCE_8),
        1e-11,
        {**_ALL_DIGITS, "fast top": 1e-8},
        stiff=False,
    ),
]

TREES: dict[str, Callable[..., Mechanism]] = {
    "pendulum": machine.pendulum,
    "rods, both horizontal": partial(machine.double_pendulum, "rods", "both horizontal"),
    "rods, second hanging": partial(machine.double_pendulum, "rods", "second hanging"),
    "tip masses, both horizontal": partial(machine.double_pendulum, "tip masses", "both horizontal"),
    "tip masses, second hanging": partial(machine.double_pendulum, "tip masses", "second hanging"),
    "heavy top": machine.heavy_top,
    "fast top": machine.fast_top,
}

by_every_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: method.label)


@by_every_method
@pytest.mark.parametrize("name", TREES)
def test_a_tree_follows_its_reference(name, method):
    """The observed point at each instant of the reference, and the energy kept meanwhile."""
    for instant in TREES[name]().reference:
        mechanism = TREES[name]()
        run = mechanism.scene.simulate(instant, rtol=method.rtol, integrator=method.make())
        assert mechanism.error(run, instant) < method.reach[name]
        energy = run.energy()
        swing = max(np.ptp(energy.gravitational), 1.0)
        assert np.abs(energy.total - energy.total[0]).max() < 10.0 * method.reach[name] * swing


@by_every_method
def test_the_heavy_top_turns_by_its_reference(method):
    """Rotation after 2 s, and the energy, which has the constant of the gravity potential in it."""
    mechanism = machine.heavy_top()
    run = mechanism.scene.simulate(2.0, rtol=method.rtol, integrator=method.make())
    found = run.beta(mechanism.joint)[-1]
    assert abs(found @ np.array(machine.HEAVY_TOP_QUATERNION)) == pytest.approx(1.0, abs=1e-9)
    alike = np.copysign(1.0, found[0]) * found
    # the spin's phase, 300 rad in all, is the least certain
    assert alike == pytest.approx(machine.HEAVY_TOP_QUATERNION, abs=20.0 * method.reach["heavy top"])
    assert run.energy().total[[0, -1]] == pytest.approx(machine.HEAVY_TOP_ENERGY, rel=method.reach["heavy top"] / 1e3)


@by_every_method
@pytest.mark.parametrize(("bar", "period"), [(False, machine.PERIOD_POINT), (True, machine.PERIOD_BAR)])
def test_the_period_of_a_large_swing(bar, period, method):
    """Twice downwards through the lowest point: 4 sqrt(L/g) K(sin(pi/4))."""
    mechanism = machine.pendulum(bar=bar)
    run = mechanism.scene.simulate(1.5 * period, rtol=method.rtol, integrator=method.make())
    t = np.linspace(0.0, run.t[-1], 3001)
    curve = CubicHermiteSpline(t, run.beta(mechanism.joint, t=t), run.beta_rate(mechanism.joint, t=t))
    through = [t for t in curve.solve(1.5 * np.pi, extrapolate=False) if curve(t, 1) > 0.0]
    assert np.diff(through) == pytest.approx([period], abs=0.2 * method.reach["pendulum"])


@by_every_method
@pytest.mark.parametrize("tilt", machine.NUTATION)
def test_a_fast_top_nods_as_it_should(tilt, method):
    """Range and period of the nutation, and the precession in a period."""
    exact = machine.NUTATION[tilt]
    mechanism = machine.fast_top(tilt)
    run = mechanism.scene.simulate(1.1 * exact.period, rtol=method.rtol, integrator=method.make())
    t = np.linspace(0.0, run.t[-1], 3001)
    velocity = run.velocity(mechanism.point, t=t)
    position = CubicHermiteSpline(t, run.position(mechanism.point, t=t), velocity)
    rate = CubicHermiteSpline(t, velocity[:, 2], run.acceleration(mechanism.point, t=t)[:, 2])
    lowest, highest = (t for t in rate.roots(extrapolate=False) if t > 0.1 * exact.period)
    tilts = np.arccos([position(t)[2] for t in (highest, lowest)])
    assert tilts == pytest.approx(exact.range, abs=method.reach["fast top"])
    assert highest == pytest.approx(exact.period, abs=method.reach["fast top"])
    start, end = (np.arctan2(x[1], x[0]) for x in (position(0.0), position(highest)))
    assert (end - start) == pytest.approx(exact.precession, abs=2.0 * method.reach["fast top"] / tilt)


def test_large_rotations_in_a_step_stay_stable():
    """Steps of 26 degrees of spin (Simo & Wong 1991): the tilt stays in its range, the energy near its value."""
    mechanism = machine.fast_top(0.3)
    run = mechanism.scene.simulate(20.0, h=np.deg2rad(26.0) / 50.0, rtol=1e-8)
    tilt = np.arccos(run.position(mechanism.point)[:, 2])
    low, high = machine.NUTATION[0.3].range
    assert low - 0.02 < tilt.min()
    assert tilt.max() < high + 0.02
    energy = run.energy().total
    assert np.ptp(energy) < 1e-3 * energy[0]


@by_every_method
@pytest.mark.parametrize("name", ["pendulum", "heavy top"])
def test_the_error_falls_with_rtol(name, method):
    """Tenfold for a hundredth of the tolerance at the least, or to the reference's last digit."""
    errors = []
    for rtol in (1e-4, 1e-6):
        mechanism = TREES[name]()
        run = mechanism.scene.simulate(1.0, rtol=rtol, integrator=method.make())
        errors.append(mechanism.error(run, 1.0))
    assert errors[1] < max(0.1 * errors[0], 1e-9)


@pytest.mark.parametrize("method", [m for m in METHODS if m.stiff], ids=lambda method: method.label)
@pytest.mark.parametrize(("t_end", "times"), [(0.25, 1.0), (10.0, 5.0)])
def test_a_stiff_governor(t_end, times, method):
    """The slide and the shaft's speed by Lagrange's equations, which SciPy's Radau method solved."""
    governor = machine.Governor()
    mechanism = governor.mechanism()
    run = mechanism.scene.simulate(t_end, rtol=100.0 * method.rtol, integrator=method.make())
    slide, _, speed = machine.GOVERNOR_LATE if t_end == 10.0 else governor.solution(t_end)
    assert abs(slide - np.cos(governor.tilt)) > 1e-2
    within = times * method.reach["governor"]
    assert run.beta(mechanism.joint)[-1] == pytest.approx(slide, abs=within)
    assert run.angular_velocity(run.bodies["shaft"].frame())[-1, 2] == pytest.approx(speed, abs=20.0 * within)


# -- closed loops ------------------------------------------------------------------------------------------------------


def test_four_bars_pass_their_singular_positions():
    """At the horizontal the constraints lose rank, twice a turn; five turns in 10 s."""
    for instant, within in ((0.5, 5e-6), (1.0, 1e-5), (2.0, 2e-5), (5.0, 4e-4), (10.0, 2e-4)):
        mechanism = machine.four_bars(2)
        run = mechanism.scene.simulate(instant, rtol=1e-6)
        assert mechanism.error(run, instant) < within


def test_redundant_rows_are_found_and_kept():
    """Revolute joints of three dimensions close two planar loops with 10 rows, of which 4 say something."""
    mechanism = machine.four_bars(2)
    start = mechanism.scene.start()
    assert len(start.unreduced.plan.rows) == 10
    assert len(start.scene.plan.rows) == 4
    run = mechanism.scene.simulate(2.0, h=1e-3, rtol=1e-8)
    assert run.stats.constraint_residual < 1e-10
    assert np.isfinite(run.multipliers).all()
    ends = [run.position(body.frame(p=(1, 0, 0))) for name, body in run.bodies.items() if name.startswith("beam")]
    tops = [run.position(run.bodies[f"upright {i}"].frame(p=(0, 1, 0))) for i in (1, 2)]
    np.testing.assert_allclose(ends, tops, atol=1e-10)
    # and their velocities, at the level of which the rows are kept too
    ends = [run.velocity(body.frame(p=(1, 0, 0))) for name, body in run.bodies.items() if name.startswith("beam")]
    tops = [run.velocity(run.bodies[f"upright {i}"].frame(p=(0, 1, 0))) for i in (1, 2)]
    np.testing.assert_allclose(ends, tops, atol=1e-7)


def test_a_crank_as_long_as_its_rod_goes_on():
    """At +-90 degrees the slider may stay at the centre or go on; it does not switch: x = 2 r cos(angle)."""
    mechanism = machine.slider_crank(0.2, 0.2, speed=10.0)
    run = mechanism.scene.simulate(2.5, rtol=1e-6)
    angle = run.beta(mechanism.joint)
    assert angle[-1] > 3.5 * np.pi
    np.testing.assert_allclose(run.position(mechanism.point)[:, 0], 0.4 * np.cos(angle), atol=1e-6)
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=1e-3)


@pytest.mark.parametrize("masses", [(1e6, 1.0), (1.0, 1e6)], ids=["heavy above", "heavy at the end"])
def test_masses_a_million_apart(masses):
    """A double pendulum of point masses, against its two equations of motion by SciPy."""
    scene, tip = machine.point_masses(masses)
    run = scene.simulate(1.0, rtol=1e-7)
    assert run.position(tip)[-1, [0, 2]] == pytest.approx(machine.point_masses_end(masses, 1.0), abs=2e-6)


def test_no_step_is_too_small_for_the_loop():
    """Steps from 1e-2 to 1e-9 s: Newton converges; rows, their rates and the multipliers keep to round-off."""
    for h in 10.0 ** -np.arange(2.0, 9.5):
        mechanism = machine.slider_crank(0.08, 0.3, speed=20.0, start=0.4)
        run = mechanism.scene.simulate(20.0 * h, h=h, rtol=1e-8)
        assert run.stats.constraint_residual < 1e-11
        assert np.abs(run.velocity(mechanism.point)[:, 1]).max() < 1e-9
        # they change by about 250 N/s; 1e-5 N of round-off in the accelerations is what steps of 1e-9 s may leave
        assert np.abs(run.multipliers - run.multipliers[0]).max() < 20.0 * h * 400.0 + 1e-5


# -- all joints by constraints -----------------------------------------------------------------------------------------

BY_CONSTRAINTS: dict[str, Callable[..., Mechanism]] = {
    **TREES,
    "pendulum": partial(machine.pendulum, bar=True),  # a point mass has no inertia to fly with
    "four-bars": partial(machine.four_bars, 2),
    "slider-crank": partial(machine.slider_crank, 0.08, 0.3, speed=20.0, start=0.4),
    "governor": machine.Governor().mechanism,
}


@pytest.mark.parametrize("name", BY_CONSTRAINTS)
def test_all_joints_by_constraints_give_the_same_motion(name):
    """Every joint as constraint rows between bodies that fly, against joint coordinates along the tree."""
    ends = []
    for way in (None, fm.Way.CONSTRAINTS):
        mechanism = BY_CONSTRAINTS[name](way=way)
        t_end = min(mechanism.reference, default=0.1)
        run = mechanism.scene.simulate(t_end, rtol=1e-6)
        assert run.multipliers.shape[1] > 0 or way is None
        assert run.stats.constraint_residual < 1e-8
        if name != "governor":
            assert np.ptp(run.energy().total) < 1e-3 * np.ptp(run.energy().kinetic) + 1e-3
        ends.append(run.position(mechanism.point)[-1])
        bound = 1e-3 if name.endswith("top") else 2e-5
        assert not mechanism.reference or mechanism.error(run, t_end) < bound
    np.testing.assert_allclose(ends[1], ends[0], atol=bound)
