"""Redundant loops: reported by name, and loads shared by the smallest multipliers."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from machines import slider_crank
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import AssemblyError, SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian
from flexmbd.run.stopped import SimulationError


def cranks(n, angle, rate=0.0):
    """A rod on n equal cranks in space: one motion, and rows of n - 1 pins that agree on parallel cranks alone."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    turn = fm.joint.Revolute("z")
    rod = scene.add(fm.RigidBody(2.0, (1e-3, 1.0, 1.0), com=((n - 1) / 2, 0, 0)), name="rod")
    feet = []
    for k in range(n):
        crank = scene.add(fm.RigidBody(1.0, (1e-3, 0.1, 0.1), com=(0.25, 0, 0)), name=f"crank {k}")
        foot = scene.connect(turn, scene.ground.frame((float(k), 0, 0)), crank.frame(), name=f"foot {k}")
        foot.position, foot.velocity = angle, rate
        pin = scene.connect(turn, crank.frame((0.5, 0, 0)), rod.frame((float(k), 0, 0)), name=f"pin {k}")
        if k == 0:
            pin.position, pin.velocity = -angle, -rate
        feet.append(foot)
    return scene, feet


@pytest.mark.parametrize("angle", [-0.5, 0.0, 1e-3, 1.1, 3.0])
@pytest.mark.parametrize("n", [2, 3, 5, 7])
def test_parallel_cranks_keep_one_freedom(n, angle):
    """The rank at every angle but the flat one: n + 1 angles of which one is free."""
    start = cranks(n, angle)[0].start()
    assert start.scene.nv == n + 1
    assert len(start.scene.row_names) == n


def test_rounded_angles_of_parallel_cranks_keep_one_freedom():
    scene, feet = cranks(5, -0.5)
    for k, foot in enumerate(feet):
        foot.position = -0.5 + 1e-3 * k
    start = scene.start()
    assert len(start.scene.row_names) == 5
    angles = [start.x[start.scene.index.joints[foot].x][0] for foot in feet]
    assert np.ptp(angles) < 1e-12
    assert angles[0] == pytest.approx(-0.5 + 2e-3, abs=1e-3)


@pytest.mark.parametrize(
    "integrator", [fm.RadauIIA(), fm.GeneralizedAlpha(), fm.EnergyMomentum(), fm.ExplicitRungeKutta()]
)
def test_parallel_cranks_swing_as_one_pendulum(integrator):
    """Closed form: the energy of the one angle that all cranks share."""
    n = 3
    scene, feet = cranks(n, -0.5)
    h = 1e-3 if isinstance(integrator, fm.EnergyMomentum) else None
    run = scene.simulate(0.3, integrator=integrator, rtol=1e-8, h=h)
    angle, rate = run.beta(feet[0]), run.beta_rate(feet[0])
    inertia = n * (0.1 + 0.25**2) + 2.0 * 0.5**2
    lever = 9.81 * (n * 0.25 + 2.0 * 0.5)
    fallen = lever * (np.sin(-0.5) - np.sin(angle))
    np.testing.assert_allclose(0.5 * inertia * rate**2, fallen, atol=1e-5 * lever)
    assert abs(rate[-1]) > 0.5


def test_a_singular_start_takes_rates_of_one_of_its_ways():
    """Flat, the cranks may go on parallel; with one crank's rate alone nothing says which way."""
    scene, feet = cranks(3, 0.0, 1.5)
    start = scene.start()
    rates = [start.v[start.scene.index.joints[foot].v][0] for foot in feet]
    assert rates == [1.5, 1.5, 1.5]
    feet[2].velocity = -1.5
    with pytest.raises(SceneError, match="singular position"):
        scene.start()


def test_the_smallest_multipliers_move_the_machine_alike():
    """A planar slider-crank of 3-D joints: two of five rows hold it, all share the load."""
    scene, _, crank = slider_crank(axis="y")
    crank.velocity = 20.0
    start = scene.start()
    run = scene.simulate(0.1, rtol=1e-6)
    full, kept = start.unreduced, start.scene
    assert run.multipliers.shape[1] == len(full.row_names) == 5
    assert len(kept.row_names) == 2
    work = new_work(full.plan)
    independent = [full.row_names.index(name) for name in kept.row_names]
    for k in (0, len(run.t) // 2, len(run.t) - 1):
        jacobian = constraint_jacobian(full, work, run.x[k])
        load = jacobian.T @ run.multipliers[k]
        alone, _, rank, _ = np.linalg.lstsq(jacobian[independent].T, load, rcond=None)
        assert rank == 2
        # nothing of the load is lost, and no other share is smaller: no part lies in the kernel
        assert jacobian[independent].T @ alone == pytest.approx(load, abs=1e-9 * np.abs(load).max())
        weight = np.array([1.0, 1.0, 1.0, 1.0 / full.extent, 1.0 / full.extent])
        weighted = weight * run.multipliers[k]
        _, _, vt = np.linalg.svd((jacobian / weight[:, None]).T)
        assert np.abs(vt[2:] @ weighted).max() < 1e-9 * np.abs(weighted).max()
    named = scene.explain()
    for name in kept.redundant:
        assert name in named


@pytest.mark.parametrize("tilt", [[0.0, 0.0, 0.0], [0.3, -0.5, 0.8], [1.1, 0.2, -0.4], [-0.7, 2.0, 0.1]])
def test_a_loop_that_holds_nothing_leaves_all_free(tilt):
    """A slide along a line of the plane that a second joint asks for: all its rows are rounding, however tilted."""
    R = Rotation.from_rotvec(tilt).as_matrix()
    scene = fm.System(gravity=(1.0, -2.0, -9.81))
    sledge = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.25), com=(0.1, 0.2, 0.3)), name="sledge")
    ends = scene.ground.frame(R=R), sledge.frame(R=R)
    slide = scene.connect(fm.joint.Prismatic((1.0, 2.0, 0.0)), *ends, way=fm.Way.COORDINATES)
    scene.connect(fm.joint.Planar("z"), *ends, way=fm.Way.CONSTRAINTS)
    slide.position = 0.7
    start = scene.start()
    assert len(start.scene.row_names) == 0
    along = R @ np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
    np.testing.assert_allclose(start.a, [along @ scene.gravity], atol=1e-12)
    assert scene.simulate(0.1).beta(slide)[-1] == pytest.approx(0.7 + 0.005 * along @ scene.gravity, abs=1e-9)


def driven_plate(motion, *, second_pin):
    """A plate on a hinge with a motion, a bob that swings on it, and a second hinge beside it that would hold it."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    plate = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.2)), name="plate")
    joint = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), plate.frame(), name="driven")
    joint.prescribe(motion)
    bob = scene.add(fm.RigidBody(0.5, (0.01, 0.01, 0.01), com=(0.2, 0.0, 0.0)), name="bob")
    scene.connect(fm.joint.Revolute("z"), plate.frame((0.0, 0.3, 0.0)), bob.frame(), name="swing")
    if second_pin:
        apart = (PIN, 0.0, 0.0)
        scene.connect(fm.joint.Revolute("z"), scene.ground.frame(apart), plate.frame(apart), name="second")
    return scene


def driven_alone(motion, apart):
    """A plate that a motion drives altogether, with a second hinge as far as ``apart`` (m) from the first."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    plate = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.2)), name="plate")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), plate.frame(), name="driven").prescribe(motion)
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(apart), plate.frame(apart), name="second")
    return scene, plate


PIN, BEGIN = 0.5, 0.125


METHODS = [fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.GeneralizedAlpha()]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_motion_that_the_loops_forbid_tears_them_and_is_told(method):
    """At rest the second hinge says nothing; as soon as the plate moves, it leaves it by 2 L sin(angle / 2)."""
    motion = PPoly([[0.0, 3.0], [0.0, 0.0], [0.0, 0.0]], [-1.0, BEGIN, 2.0])
    assert driven_plate(motion, second_pin=False).simulate(0.5, rtol=1e-6).stats.constraint_residual < 1e-12
    with pytest.raises(SimulationError, match=r"forbid .*'driven.angle'.*second") as told:
        driven_plate(motion, second_pin=True).simulate(0.5, rtol=1e-6, integrator=method)
    t = told.value.trajectory.t
    assert BEGIN <= t[-1] < 0.5
    assert 2.0 * PIN * np.sin(0.5 * 3.0 * max(t[-1] - BEGIN, 0.0) ** 2) <= 1e-6 * 2.0 * PIN


@pytest.mark.parametrize("rtol", [1e-1, 1e-2])
@pytest.mark.parametrize("method", [*METHODS, fm.EnergyMomentum()], ids=lambda method: method.name)
def test_a_loose_tolerance_tears_no_loop(method, rtol):
    """A planar four-bar, whose rows out of the plane are left out: loops are as open as the tolerance says."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank, coupler, rocker = (scene.add(fm.RigidBody(1.0, (1e-2, 2e-2, 3e-2), (0.1, 0.0, 0.0))) for _ in range(3))
    turn = fm.joint.Revolute("z")
    drive = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(0.2, 0.0, 0.0)), coupler.frame())
    scene.connect(turn, scene.ground.frame(p=(0.5, 0.0, 0.0)), rocker.frame())
    scene.connect(turn, coupler.frame(p=(0.5, 0.0, 0.0)), rocker.frame(p=(0.4, 0.0, 0.0)))
    drive.position, drive.velocity = 1.0, -3.0
    run = scene.simulate(1.0, rtol=rtol, integrator=method)
    assert run.stats.constraint_residual < 1e-2 * rtol
    angle = np.unwrap(run.beta(drive))
    fine = scene.simulate(1.0, rtol=1e-10, integrator=fm.ExplicitRungeKutta()).beta(drive, t=run.t)
    assert np.abs(angle - fine).max() < rtol * np.ptp(angle)  # rtol a radian


@pytest.mark.parametrize("method", [*METHODS, fm.EnergyMomentum()], ids=lambda method: method.name)
def test_a_machine_that_motions_drive_altogether_needs_no_rows(method):
    """Nothing is left for rows to hold, redundant ones as well: it moves as it is driven, or the rows are torn."""
    scene, plate = driven_alone(fm.Sine(0.5, 10.0), (0.0, 0.0, 1.0))
    run = scene.simulate(0.5, integrator=method)
    angle = 0.5 * np.sin(10.0 * run.t)
    np.testing.assert_allclose(run.rotation(plate.frame())[:, 0, 0], np.cos(angle), atol=1e-14)
    scene, _ = driven_alone(fm.Sine(0.5, 10.0), (PIN, 0.0, 0.0))
    with pytest.raises(AssemblyError, match=r"second.* opens at 2\.5.*check prescribed motions and joint velocities$"):
        scene.simulate(0.5, integrator=method)
    scene, _ = driven_alone(fm.Sine(0.5, 10.0, phase=0.5 * np.pi, offset=-0.5), (PIN, 0.0, 0.0))  # from rest
    with pytest.raises(SimulationError, match=r"forbid .*'driven.angle'.*second"):
        scene.simulate(0.5, integrator=method)


def test_what_a_motion_by_constraints_leaves_open_is_told_in_the_stats():
    scene = fm.System()
    cart = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), way=fm.Way.CONSTRAINTS)
    slide.prescribe(fm.Sine(0.3, 2.0, 0.0, 0.2))
    run = scene.simulate(0.5, rtol=1e-6)
    moved = run.position(cart.frame())[:, 0] - 0.2 - 0.3 * np.sin(2.0 * run.t)
    assert run.stats.constraint_residual == pytest.approx(np.abs(moved).max(), abs=1e-14)
    assert run.stats.constraint_residual < 1e-9


@pytest.mark.parametrize("turn", [0.3, 2.0])
@pytest.mark.parametrize("tilt", [0.2, 0.5, 1.0, 1.3])
def test_rolling_gives_way_to_what_holds_positions(tilt, turn):
    """A body that slides on a plane, its disc rolling on another one that cuts it in a line.

    That the touching point stands still is one condition too many for the velocities.  The touching is the one to be
    kept: it leaves two of the three coordinates free, and all of rolling one velocity.
    """
    axis = Rotation.from_euler("ZX", [turn, 0.5 * np.pi - 0.2]).as_matrix()
    plane = Rotation.from_euler("ZX", [1.7 * turn, tilt]).as_matrix()
    down = plane[:, 2] @ axis[:, 2] * axis[:, 2] - plane[:, 2]
    lowest = 0.3 * down / np.linalg.norm(down)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.15)), name="body")
    scene.connect(fm.joint.Planar("z"), scene.ground.frame(), body.frame())
    scene.connect(fm.joint.RollingDisc(0.3), scene.ground.frame(lowest, R=plane), body.frame(R=axis), name="disc")
    linear = scene.linearize()
    assert scene.start().scene.redundant in (("disc: no slip along x",), ("disc: no slip along y",))
    assert linear.M.shape == (1, 1)
    assert linear.K.shape == (1, 2)


def test_two_motions_may_drive_one_mechanism():
    """An isosceles slider-crank, its crank turned and its slider led along: the rod turns back as fast."""
    length, rate, angle = 0.3, 4.0, 0.6
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = fm.RigidBody(1.0, (0.1, 0.1, 0.1))
    crank, rod, slider = (scene.add(replace(body), name=name) for name in ("crank", "rod", "slider"))
    hinge, far = fm.joint.Revolute("z"), (length, 0.0, 0.0)
    turn = scene.connect(hinge, scene.ground.frame(), crank.frame(), name="turn")
    turn.prescribe(PPoly([[rate], [angle]], [0.0, 1.0]))
    scene.connect(hinge, crank.frame(far), rod.frame(), name="elbow").position = -2.0 * angle
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="slide")
    slide.prescribe(fm.Sine(2.0 * length, rate, angle + 0.5 * np.pi))
    scene.connect(hinge, rod.frame(far), slider.frame(), name="pin")
    run = scene.simulate(0.1, rtol=1e-8)
    np.testing.assert_allclose(run.rotation(rod.frame())[:, 1, 0], -np.sin(angle + rate * run.t), atol=1e-7)


def flat_triangle(*, rates, on_cart=False, order=("one", "two", "tip")):
    """Bars of 0.5 m and 0.75 m between two pins of a plate 0.25 m apart: they lie in line and lock each other.

    Axes of the pins are turned, so that no row is along the bars, or across.
    """
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    plate = scene.ground
    if on_cart:
        plate = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="plate")
        cart = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), plate.frame(), name="cart")
        cart.prescribe(fm.Sine(0.3, 7.0))
    short = scene.add(fm.RigidBody(1.0, (0.01, 0.1, 0.1), com=(0.25, 0.0, 0.0)), name="short")
    long = scene.add(fm.RigidBody(1.0, (0.01, 0.1, 0.1)), name="long")
    hinge = fm.joint.Revolute("z")
    R, Q = (Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix() for turn in (0.9, 0.4))
    ends = {
        "one": (plate.frame((0.25, 0.0, 0.0)), short.frame()),
        "two": (plate.frame(R=R), long.frame(R=R)),
        "tip": (short.frame((0.5, 0.0, 0.0), R=Q), long.frame((0.75, 0.0, 0.0), R=Q)),
    }
    pins = {name: scene.connect(hinge, *ends[name], name=name) for name in order}
    for name, rate in zip(ends, rates, strict=True):
        pins[name].velocity = rate
    return scene


@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (3.0, 2.0, -1.0)])
@pytest.mark.parametrize("on_cart", [False, True])
@pytest.mark.parametrize("order", list(permutations(["one", "two", "tip"])), ids=" ".join)
def test_bars_that_lock_each_other_are_refused(order, on_cart, rates):
    """At first order their tip moves along both circles; these touch there and nowhere else, whichever pin is cut."""
    with pytest.raises(SceneError, match=r"its loops lock: .* holds nothing there"):
        flat_triangle(rates=rates, on_cart=on_cart, order=order).start()
