"""Pendulums, tops and closed loops against closed forms and independent solutions, by every integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import mechanisms as machine
import numpy as np
import pytest
from mechanisms import Mechanism

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator


@dataclass(frozen=True)
class Method:
    """An integrator, the rtol it is run with, and how far from the references it may end by its order.

    Attributes:
        loop_rtol: for closed loops that pass where their constraints lose rank.
        reach: largest distance (m) from each mechanism's references; the references' own digits bound it below.
    """

    label: str
    make: Callable[[], Integrator]
    rtol: float
    loop_rtol: float
    reach: dict[str, float]


METHODS = [
    # of second order: what it reaches in a second; the errors fall with rtol
    Method(
        "generalized-alpha",
        fm.GeneralizedAlpha,
        1e-8,
        1e-6,
        {
            "pendulum": 1e-6,
            "rods, both horizontal": 5e-6,
            "rods, second hanging": 1e-4,
            "tip masses, both horizontal": 5e-7,
            "tip masses, second hanging": 1e-6,
            "heavy top": 5e-5,
            "fast top": 5e-5,
            "governor": 1e-4,
            "four-bars": 4e-4,
        },
    ),
    # to the digits that the references have
    Method(
        "Dormand-Prince 8(5,3)",
        partial(fm.ExplicitRungeKutta, fm.Pair.DORMAND_PRINCE_8),
        1e-12,
        1e-10,
        {
            "pendulum": 2e-12,
            "rods, both horizontal": 2e-10,
            "rods, second hanging": 1e-9,
            "tip masses, both horizontal": 1e-10,
            "tip masses, second hanging": 1e-10,
            "heavy top": 5e-11,
            "fast top": 2e-10,
            "governor": 1e-11,
            "four-bars": 1e-7,
        },
    ),
    Method(
        "Radau IIA",
        fm.RadauIIA,
        1e-11,
        1e-9,
        {
            "pendulum": 1e-9,
            "rods, both horizontal": 1e-8,
            "rods, second hanging": 1e-8,
            "tip masses, both horizontal": 1e-8,
            "tip masses, second hanging": 1e-8,
            "heavy top": 3e-6,
            "fast top": 1e-6,
            "governor": 1e-6,
            "four-bars": 1e-6,
        },
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
    kept = max(method.reach["heavy top"] / 1e3, 2e-12)
    assert run.energy().total[[0, -1]] == pytest.approx(machine.HEAVY_TOP_ENERGY, rel=kept)


@by_every_method
@pytest.mark.parametrize(("bar", "period"), [(False, machine.PERIOD_POINT), (True, machine.PERIOD_BAR)])
def test_the_period_of_a_large_swing(bar, period, method):
    """After 4 sqrt(L/g) K(sin(pi/4)) it is at rest where it began; its speed tells by how long it is late."""
    mechanism = machine.pendulum(bar=bar)
    run = mechanism.scene.simulate(period, rtol=method.rtol, integrator=method.make())
    late = run.beta_rate(mechanism.joint)[-1] / (machine.G * (1.5 if bar else 1.0))
    assert abs(late) < 0.2 * method.reach["pendulum"]
    assert run.beta(mechanism.joint)[-1] == pytest.approx(np.pi, abs=method.reach["pendulum"])


@by_every_method
@pytest.mark.parametrize("tilt", machine.NUTATION)
def test_a_fast_top_nods_as_it_should(tilt, method):
    """Lowest after half the period of nutation, back after the whole, having precessed."""
    exact = machine.NUTATION[tilt]
    within = method.reach["fast top"]
    for share, expected in ((0.5, exact.range[1]), (1.0, exact.range[0])):
        mechanism = machine.fast_top(tilt)
        run = mechanism.scene.simulate(share * exact.period, rtol=method.rtol, integrator=method.make())
        x = run.position(mechanism.point)
        assert np.arctan2(np.hypot(*x[-1, :2]), x[-1, 2]) == pytest.approx(expected, abs=within)
        assert abs(run.velocity(mechanism.point)[-1, 2]) < 10.0 * within
    azimuth = np.arctan2(x[[0, -1], 1], x[[0, -1], 0])
    assert np.ptp(azimuth) == pytest.approx(exact.precession, abs=within / tilt)


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
    """Tenfold for a hundredth of the tolerance at the least, or to the reference's last digit.

    From 1e-5 on the top's steps are below a radian, to which looser tolerances hold them.
    """
    errors = []
    for rtol in (1e-5, 1e-7):
        mechanism = TREES[name]()
        run = mechanism.scene.simulate(1.0, rtol=rtol, integrator=method.make())
        errors.append(mechanism.error(run, 1.0))
    assert errors[1] < max(0.1 * errors[0], 1e-9)


@by_every_method
def test_a_stiff_governor(method):
    """The slide and the shaft's speed by Lagrange's equations, which SciPy's Radau method solved."""
    governor = machine.Governor()
    mechanism = governor.mechanism()
    run = mechanism.scene.simulate(0.25, rtol=100.0 * method.rtol, integrator=method.make())
    slide, _, speed = governor.solution(0.25)
    assert abs(slide - np.cos(governor.tilt)) > 1e-2
    within = method.reach["governor"]
    assert run.beta(mechanism.joint)[-1] == pytest.approx(slide, abs=within)
    shaft = run.bodies["shaft"].frame()  # type: ignore[attr-defined]
    assert run.angular_velocity(shaft)[-1, 2] == pytest.approx(speed, abs=20.0 * within)


# -- closed loops ------------------------------------------------------------------------------------------------------


def test_a_stiff_governor_later():
    """The slide after 10 s."""
    mechanism = machine.Governor().mechanism()
    run = mechanism.scene.simulate(10.0, rtol=1e-6)
    assert run.beta(mechanism.joint)[-1] == pytest.approx(machine.GOVERNOR_LATE[0], abs=2e-4)


@by_every_method
def test_four_bars_pass_their_singular_positions(method):
    """At the horizontal the constraints lose rank, twice a turn; five turns in 10 s."""
    for instant in machine.FOUR_BAR[2]:
        mechanism = machine.four_bars(2)
        run = mechanism.scene.simulate(instant, rtol=method.loop_rtol, integrator=method.make())
        assert mechanism.error(run, instant) < method.reach["four-bars"]
        assert np.isfinite(run.multipliers).all()


def test_many_four_bars():
    """Forty windows, 81 rods and 200 rows of which 80 say something, through ten singular positions."""
    for instant in machine.FOUR_BAR[40]:
        mechanism = machine.four_bars(40)
        run = mechanism.scene.simulate(instant, rtol=1e-8, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        assert mechanism.error(run, instant) < 1e-6
        assert run.stats.constraint_residual < 1e-10


def test_redundant_rows_are_found_and_kept():
    """Revolute joints of three dimensions close two planar loops with 10 rows, of which 4 say something."""
    mechanism = machine.four_bars(2)
    start = mechanism.scene.start()
    assert len(start.unreduced.plan.rows) == 10
    assert len(start.scene.plan.rows) == 4
    run = mechanism.scene.simulate(2.0, h=1e-3, rtol=1e-8)
    assert run.stats.constraint_residual < 1e-10
    assert np.isfinite(run.multipliers).all()
    beams: list[Any] = [body for name, body in run.bodies.items() if name.startswith("beam")]
    ends = [run.position(body.frame(p=(1, 0, 0))) for body in beams]
    tops = [run.position(run.bodies[f"upright {i}"].frame(p=(0, 1, 0))) for i in (1, 2)]  # type: ignore[attr-defined]
    np.testing.assert_allclose(ends, tops, atol=1e-10)
    # and their velocities, at the level of which the rows are kept too
    ends = [run.velocity(body.frame(p=(1, 0, 0))) for body in beams]
    tops = [run.velocity(run.bodies[f"upright {i}"].frame(p=(0, 1, 0))) for i in (1, 2)]  # type: ignore[attr-defined]
    np.testing.assert_allclose(ends, tops, atol=1e-7)


@by_every_method
def test_a_crank_as_long_as_its_rod_goes_on(method):
    """At +-90 degrees the slider may stay at the centre or go on; it does not switch: x = 2 r cos(angle)."""
    mechanism = machine.slider_crank(0.2, 0.2, speed=10.0)
    run = mechanism.scene.simulate(2.5, rtol=method.loop_rtol, integrator=method.make())
    angle = run.beta(mechanism.joint)
    assert angle[-1] > 3.5 * np.pi
    np.testing.assert_allclose(run.position(mechanism.point)[:, 0], 0.4 * np.cos(angle), atol=1e-6)
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=1e-3)


@by_every_method
@pytest.mark.parametrize("masses", [(1e6, 1.0), (1.0, 1e6)], ids=["heavy above", "heavy at the end"])
def test_masses_a_million_apart(masses, method):
    """A double pendulum of point masses, against its two equations of motion by SciPy."""
    scene, tip = machine.point_masses(masses)
    run = scene.simulate(0.4, rtol=1e-7, integrator=method.make())
    assert run.position(tip)[-1, [0, 2]] == pytest.approx(machine.point_masses_end(masses, 0.4), abs=1e-6)


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
