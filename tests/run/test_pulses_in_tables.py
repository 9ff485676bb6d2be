"""Short pulses in dense and sparse spline tables, of loads and of motions: the error is that of smooth motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd.multibody.functions.time_function import as_row

OMEGA, END, BEGIN = 2.0, 3.0, 1.2345
# The largest error over rtol: of smooth motion 2 (alpha), 7 (energy), 0.7 (radau) and less.
METHODS = {
    "alpha": (fm.GeneralizedAlpha(), 12.0),
    "energy": (fm.EnergyMomentum(), 12.0),
    "central": (fm.CentralDifference(), 1.0),
    "radau": (fm.RadauIIA(), 4.0),
    "5": (fm.ExplicitRungeKutta(), 1.0),
    "8": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1.0),
}


def pulse(points, width):
    """A table whose pulse has a height of about 1: a few points around it, or equally many everywhere."""
    if points == "sparse":  # the spline swings for some points about a single one
        near = BEGIN + 0.5 * width * np.arange(-12, 15)
        t = np.concatenate([[0.0, 0.6], near, [2.0, END]])
        return t, np.where(np.arange(len(t)) == 15, 1.0, 0.0)
    t = np.linspace(0.0, END, int(20.0 * END / width) + 1)
    return t, np.exp(-(((t - BEGIN) / (0.5 * width)) ** 2)) + 0.2 * width * np.sin(2.0 * t)


def response(table, derivative):
    """z at the end, and the largest, of z'' + OMEGA^2 z = a derivative of the table, at rest first: Duhamel's integral.

    By Gauss' rule of six points, exact to round-off on pieces shorter than a radian.
    """
    row = as_row(table, "table", motion=False)
    poly = PPoly(row.data[row.count + 2 :].reshape(row.count, -1).T, row.data[1 : row.count + 2])
    x = np.clip(poly.x, 0.0, END)
    x = np.unique(np.concatenate([x, np.linspace(0.0, END, 31)]))
    nodes, weights = np.polynomial.legendre.leggauss(6)
    half = 0.5 * np.diff(x)[:, None]
    s = x[:-1, None] + half * (1.0 + nodes)
    load = half * weights * poly(s, derivative)
    return float((load * np.sin(OMEGA * (END - s))).sum() / OMEGA)


def suspended(load, motion=0.0):
    """A mass of 1 kg on a spring to a driven slide, pulled by a load; the joint between the two."""
    scene = fm.System()
    ram = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ram")
    mass = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="mass")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), ram.frame(), name="drive").prescribe(motion)
    spring = scene.connect(fm.joint.Prismatic("x"), ram.frame(), mass.frame(), name="spring")
    scene.add_force(fm.force.JointSpring(spring, OMEGA**2, 0.0))
    scene.add_force(fm.force.JointForce(spring, load))
    return scene, spring


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize(("points", "width"), [("sparse", 1e-4), ("sparse", 1e-2), ("dense", 1e-3), ("dense", 1e-2)])
@pytest.mark.parametrize("method", METHODS)
def test_loads(method, points, width, rtol):
    """An impulse of about 0.5 N s."""
    integrator, bound = METHODS[method]
    t, y = pulse(points, width)
    table = fm.Table(t, 0.5 / width * y)
    scene, spring = suspended(table)
    run = scene.simulate(END, rtol=rtol, integrator=integrator)
    assert abs(run.beta(spring)[-1] - response(table, 0)) < bound * rtol


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize("width", [2e-3, 1e-2])
@pytest.mark.parametrize("method", [name for name in METHODS if name != "8"])
def test_motions(method, width, rtol):
    """A knock of the driven slide, of 0.3 m/s at most: what hangs from it takes its acceleration."""
    integrator, bound = METHODS[method]
    t, y = pulse("dense", width)
    table = fm.Table(t, 0.15 * width * (y - y[0]))
    scene, spring = suspended(0.0, table)
    run = scene.simulate(END, rtol=rtol, integrator=integrator)
    assert abs(run.beta(spring)[-1] + response(table, 2)) < bound * rtol


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize(("points", "width"), [("sparse", 1e-4), ("dense", 1e-2)])
@pytest.mark.parametrize("method", METHODS)
def test_loads_beside_motions(method, points, width, rtol):
    """A pulse on what hangs from a slide that a table drives."""
    integrator, bound = METHODS[method]
    t, y = pulse("dense", 1.0)
    motion = fm.Table(t, 0.15 * (y - y[0]))
    t, y = pulse(points, width)
    load = fm.Table(t, 0.5 / width * y)
    scene, spring = suspended(load, motion)
    run = scene.simulate(END, rtol=rtol, integrator=integrator)
    assert abs(run.beta(spring)[-1] - response(load, 0) + response(motion, 2)) < bound * rtol


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("method", METHODS)
def test_jumps_within_rtol_of_the_range(method, rtol):
    """A pulse of 5 kN, after which jumps of 0.3 to 0.8 N are below rtol of the range, and no breaks for the coarser."""
    integrator, bound = METHODS[method]
    levels = [[0.0, 5e3, 0.0, 0.4, -0.3, 0.45, -0.1]]
    load = PPoly(np.array(levels), np.array([-1.0, 0.3, 0.3001, 1.01, 1.52, 1.77, 2.31, 4.0]))
    scene, spring = suspended(load)
    run = scene.simulate(END, rtol=rtol, integrator=integrator)
    assert abs(run.beta(spring)[-1] - response(load, 0)) < bound * rtol


@pytest.mark.parametrize("method", ["alpha", "energy", "radau", "central"])
def test_a_restart_behind_a_pulse(method, tmp_path):
    """To the bit, wherever among the stretches of the data."""
    integrator, _ = METHODS[method]
    t, y = pulse("dense", 1e-2)
    scene, _ = suspended(fm.Table(t, 50.0 * y))
    times = [BEGIN - 2e-3, BEGIN + 1e-3, BEGIN + 1e-2]
    whole = scene.simulate(END, rtol=1e-4, integrator=integrator, checkpoints=times)
    for k, kept in enumerate(whole.checkpoints):
        path = kept.save(tmp_path / f"{k}.npz")
        again = fm.Checkpoint.load(path)
        rest = scene.simulate(END, rtol=1e-4, integrator=integrator, restart=again, checkpoints=times[k + 1 :])
        np.testing.assert_array_equal(rest.x[-1], whole.x[-1])
