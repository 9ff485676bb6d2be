"""Loads that jump or pulse on machines with bodies that have a history: steps end there, and the order is kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, PPoly
from spring_interior import ExplicitSprings, ImplicitSprings, as_continuum

import flexmbd as fm

STIFFNESS, MIDDLE, END = 40.0, 0.5, 2.0
WAYS = {
    "alpha": (ImplicitSprings, fm.GeneralizedAlpha(), 0.3),
    "undamped alpha": (ImplicitSprings, fm.GeneralizedAlpha(rho=1.0), 0.3),
    "damped alpha": (ImplicitSprings, fm.GeneralizedAlpha(rho=0.0), 0.3),
    "central": (ExplicitSprings, fm.CentralDifference(), 0.0),
}


def bar(kind, load, bonded):
    """A bar of two springs with a mass between them, held at one end, pulled by a load at the other.

    The free end's frame and the mass ``bonded`` (kg) to it slide along the bar.
    """
    scene = fm.System()
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, 0.0, 0.0)]
    interior = kind(points, [0, 1], [(0, 2), (2, 1)], [0.0, bonded, MIDDLE], stiffness=STIFFNESS)
    _, (a, b) = as_continuum(scene, interior)
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), a)
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(1.0, 0.0, 0.0)), b)
    scene.add_force(fm.force.JointForce(slide, load))
    return scene, slide, interior.frames[1].mass + bonded


def exact(load, mass, *, knots):
    """The free end's displacement at the end, by scipy from knot to knot."""
    k = STIFFNESS
    y = np.zeros(4)
    for begin, end in zip([0.0, *knots], [*knots, END], strict=True):
        force = PPoly(load.c, load.x)

        def rate(t, y, begin=begin, end=end, force=force):
            pull = float(force(min(max(t, begin + 1e-13), end - 1e-13)))
            return [*y[2:], (pull - k * (y[0] - y[1])) / mass, k * (y[0] - 2.0 * y[1]) / MIDDLE]

        y = solve_ivp(rate, (begin, end), y, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return y[0]


@pytest.mark.parametrize("offset", [0.0, 0.02, 0.37], ids=["on a step", "early", "inside"])
@pytest.mark.parametrize("way", WAYS)
def test_fixed_steps_keep_their_order_across_a_jump(way, offset):
    kind, method, bonded = WAYS[way]
    coarse = 0.02
    jump = 0.6 + offset * coarse / 4.0
    load = PPoly([[1.0, -0.5]], [0.0, jump, 10.0])
    errors = []
    for h in (coarse, coarse / 2.0, coarse / 4.0):
        scene, slide, mass = bar(kind, load, bonded)
        run = scene.simulate(END, h=h, rtol=1e-10, integrator=method)
        errors.append(abs(run.beta(slide)[-1] - exact(load, mass, knots=[jump])))
        grid = h * np.arange(round(END / h) + 1)
        assert len(run.t) == len(grid) + (offset > 0.0)
        assert np.abs(run.t[:, None] - grid).min(axis=0).max() < 1e-12
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-3
    assert orders[-1] > 1.75, errors


@pytest.mark.parametrize(("way", "how"), [*((way, "fixed") for way in WAYS), ("central", "the body's own")])
@pytest.mark.parametrize("width", [1e-3, 1e-5])
def test_a_short_pulse_of_data_is_not_stepped_over(way, how, width):
    """An impulse of 0.2 N s in a table whose curve has no break: what follows is the motion that it sets going."""
    kind, method, bonded = WAYS[way]
    begin = 0.5123
    near = begin + 0.5 * width * np.arange(-12, 15)
    t = np.concatenate([[0.0, 0.25], near, [1.5, END, END + 1.0]])
    y = np.where(np.arange(len(t)) == 15, 0.4 / width, 0.0)
    scene, slide, mass = bar(kind, fm.Table(t, y, monotone=True), bonded)
    run = scene.simulate(END, integrator=method, **({"h": 5e-3, "rtol": 1e-9} if how == "fixed" else {}))
    blow = PPoly([[0.0, 0.2 / width, 0.0]], [0.0, begin + 0.5 * width, begin + 1.5 * width, 10.0])
    wanted = exact(blow, mass, knots=[begin + 0.5 * width, begin + 1.5 * width])
    swing = 0.2 / np.sqrt(0.5 * STIFFNESS * mass)
    assert run.beta(slide)[-1] == pytest.approx(wanted, abs=0.01 * swing)


@pytest.mark.parametrize("way", ["alpha", "undamped alpha", "damped alpha"])
def test_error_control_keeps_its_tolerance_across_a_jump(way):
    kind, method, bonded = WAYS[way]
    jump = 0.6037
    load = PPoly([[1.0, -0.5]], [0.0, jump, 10.0])
    for rtol in (1e-4, 1e-5):
        scene, slide, mass = bar(kind, load, bonded)
        run = scene.simulate(END, rtol=rtol, integrator=method)
        assert jump in run.t
        assert abs(run.beta(slide)[-1] - exact(load, mass, knots=[jump])) < 20.0 * rtol


@pytest.mark.parametrize("rtol", [1e-4, 1e-5])
@pytest.mark.parametrize("way", ["alpha", "undamped alpha", "damped alpha"])
def test_error_control_keeps_its_tolerance_across_a_pulse_in_a_spline(way, rtol):
    """A bell of 5 ms with an impulse of 0.2 N s: the motion after it is as exact as after a jump."""
    kind, method, bonded = WAYS[way]
    t = np.linspace(0.0, END + 0.01, 4021)
    bell = np.exp(-(((t - 0.5123) / 2.5e-3) ** 2))
    table = fm.Table(t, 0.2 / (2.5e-3 * np.sqrt(np.pi)) * bell)
    scene, slide, mass = bar(kind, table, bonded)
    run = scene.simulate(END, rtol=rtol, integrator=method)
    spline = CubicSpline(table.t, table.y)
    assert abs(run.beta(slide)[-1] - exact(spline, mass, knots=[0.49, 0.5, 0.51, 0.52, 0.535])) < 20.0 * rtol
