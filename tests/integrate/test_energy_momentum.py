"""Order, energy, momenta and the work of loads of the energy-momentum method."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from machines import slider_crank, slider_position
from particles import particle_body, strain_energy
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, discrete_body
from flexmbd.forms import beam_timoshenko
from flexmbd.integrate.controller import arrays_of
from flexmbd.integrate.discrete_gradient.energy_momentum import ORDER, projector
from flexmbd.integrate.discrete_gradient.momentum_balance import average_strain
from flexmbd.integrate.discrete_gradient.newton import bind
from flexmbd.integrate.discrete_gradient.polynomial_average import average_polynomials
from flexmbd.integrate.discrete_gradient.workspace import EVALUATE, LINEARISE, PLACE, new_workspace
from flexmbd.integrate.explicit.loop_dynamics import new_loops
from flexmbd.integrate.state import machine_rate, set_scales
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.physics.elasticity import add_elastic_forces
from flexmbd.multibody.kernels.reading.force_tables import storing_plan
from flexmbd.multibody.plan.scene_matrices import mass_matrix, row_sizes

METHOD = fm.EnergyMomentum()
CLOUDS = (particle_body(1, modes=3, stretched=(0, 2)), particle_body(2, modes=4))
NONLINEAR = particle_body(1, modes=3, stretched=(0, 2), nonlinear=True)


def flexible_double_pendulum(*, hold=1.0):
    """Two particle bodies of 3 and 4 modes, the first with stretch, swinging about y."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    a, b = (scene.add(fm.FlexibleBody(cloud.record), name=name) for cloud, name in zip(CLOUDS, "ab", strict=True))
    upper = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), a.frame("root"), name="upper")
    lower = scene.connect(fm.joint.Revolute("y"), a.frame("tip"), b.frame("root"), name="lower")
    if hold is not None:
        upper.position = hold
    lower.position = 0.5
    return scene, upper, lower


def nonlinear_pendulum():
    """A swinging body whose strain energy is a polynomial, with a rigid one on its tip."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(NONLINEAR.record), name="body")
    arm = scene.add(fm.RigidBody(0.5, np.diag([0.01, 0.02, 0.03]), (0.2, 0.1, 0.0)), name="arm")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root")).position = 1.0
    scene.connect(fm.joint.Revolute("x"), body.frame("tip"), arm.frame())
    body.q = (0.3, -0.2, 0.1)
    return scene


def flying_machine(gravity):
    """A tumbling flexible body that carries a rigid one by a ball joint."""
    scene = fm.System(gravity=gravity)
    body = scene.add(fm.FlexibleBody(CLOUDS[1].record), name="body")
    arm = scene.add(fm.RigidBody(0.5, np.diag([0.01, 0.02, 0.03]), (0.2, 0.1, 0.0)), name="arm")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    free.velocity = (0.3, -0.2, 0.5, 3.0, -2.0, 4.0)
    ball = scene.connect(fm.joint.Spherical(), body.frame("tip"), arm.frame())
    ball.velocity = (1.0, 2.0, 3.0)
    return scene, body, arm


def particle_momenta(run, body, arm):
    """Linear and angular momentum (nt, 3) of ``flying_machine`` about the origin, summed over particles."""
    cloud = CLOUDS[1]
    p, R = run.position(body.frame()), run.rotation(body.frame())
    v, w = run.velocity(body.frame()), run.angular_velocity(body.frame())
    local = cloud.x + np.einsum("kai,ti->tka", cloud.phi, run.q(body))
    reach = np.einsum("tab,tkb->tka", R, local)
    speed = v[:, None] + np.cross(w[:, None], reach) + np.einsum("tab,kbi,ti->tka", R, cloud.phi, run.q_rate(body))
    linear = np.einsum("k,tka->ta", cloud.mass, speed)
    angular = np.einsum("k,tka->ta", cloud.mass, np.cross(p[:, None] + reach, speed))
    centre = arm.frame(p=(0.2, 0.1, 0.0))
    R, w, v = run.rotation(centre), run.angular_velocity(centre), 0.5 * run.velocity(centre)
    spin = np.einsum("tij,j,tkj,tk->ti", R, [0.01, 0.02, 0.03], R, w)
    return linear + v, angular + np.cross(run.position(centre), v) + spin


def spread(values):
    """Largest range of the columns."""
    return np.ptp(values, axis=0).max()


def test_order_two_for_positions_velocities_and_accelerations():
    """Against generalized-alpha at a small step."""
    scene, *_ = flexible_double_pendulum()
    exact = scene.simulate(0.5, h=0.5 / 12800, rtol=1e-10)
    errors = []
    for steps in (200, 400, 800):
        run = scene.simulate(0.5, h=0.5 / steps, integrator=METHOD)
        errors.append([np.abs(getattr(run, k)[-1] - getattr(exact, k)[-1]).max() for k in "xva"])
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders, ORDER, atol=0.1)


@pytest.mark.parametrize("h", [0.002, 0.01, 0.04])
def test_energy_of_a_flexible_double_pendulum_does_not_drift(h):
    """Of some 27 J that go to and fro, over 3000 steps, whether the step resolves the modes or not.

    What Newton's iteration leaves, 1e-12 a step, does not add up: the means differ by no more than one step's.
    """
    scene, *_ = flexible_double_pendulum()
    run = scene.simulate(3000 * h, h=h, integrator=METHOD)
    energy = run.energy()
    assert np.ptp(energy.kinetic) > 20.0
    assert np.ptp(energy.total) < 1e-9
    assert abs(energy.total[-300:].mean() - energy.total[:300].mean()) < 27.0 * METHOD.newton
    other = scene.simulate(3000 * h, h=h, integrator=fm.GeneralizedAlpha(1.0)) if h == 0.01 else None
    assert other is None or np.ptp(other.energy().total) > 1e-4


def test_energy_is_kept_at_steps_of_any_length():
    scene, *_ = flexible_double_pendulum()
    exact = scene.simulate(1.0, h=1.0 / 12800, rtol=1e-10)
    errors = []
    for rtol in (1e-3, 1e-5):
        run = scene.simulate(1.0, rtol=rtol, integrator=METHOD)
        assert np.ptp(np.diff(run.t)) > 1e-4 * run.t[-1] / len(run.t)
        assert np.ptp(run.energy().total) < 1e-10
        errors.append(np.abs(run.x[-1] - exact.x[-1]).max())
    assert errors[0] < 1e-3
    assert 30.0 < errors[0] / errors[1] < 300.0


@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_momenta_of_a_flying_machine(gravity):
    """All of them without gravity; with it the horizontal linear and the vertical angular one."""
    scene, body, arm = flying_machine((0.0, 0.0, gravity))
    run = scene.simulate(5.0, h=0.005, integrator=METHOD)
    linear, angular = particle_momenta(run, body, arm)
    horizontal, vertical = (slice(0, 3), slice(0, 3)) if gravity == 0.0 else (slice(0, 2), slice(2, 3))
    assert np.abs(np.diff(run.q(body), axis=0)).max() > 1e-3
    assert spread(linear[:, horizontal]) < 1e-12
    assert spread(angular[:, vertical]) < 1e-11
    assert np.ptp(run.energy().total) < 1e-12 * np.abs(run.energy().kinetic).max() + 1e-11


def rod_in_flight():
    """A slowly tumbling aluminium rod, reduced: its deformations hold a ten-thousandth of a millionth of the energy."""
    section = beam_timoshenko.Parameters.rectangle(
        7e10, 0.3, 2700.0, width=0.02, height=0.03, orientation=(0.0, 1.0, 0.0)
    )
    frame = DiscreteFrame({"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}, {"rod": [("a", "b")]}, {"rod": section}, 8)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(discrete_body(frame, interfaces=["a", "b"], frame="a", modes=6)), name="rod")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("a")).velocity = (0.3, 0.0, 1.0, 0.9, -0.4, 0.6)
    return scene


def nonlinear_flight():
    """The particles of ``nonlinear_pendulum``, stiffer, as they fly."""
    record = dataclasses.replace(NONLINEAR.record, stiffness=1e6 * NONLINEAR.record.stiffness)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="body")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    flight.velocity = (0.3, 0.0, 1.0, 0.9, -0.4, 0.6)
    return scene


@pytest.mark.parametrize("flight", [rod_in_flight, nonlinear_flight])
def test_flights_do_not_stop_where_deformations_hold_next_to_nothing(flight):
    """What rounding leaves of the energy is more than they can take in a step, and waits."""
    run = flight().simulate(6.0, h=1e-3, integrator=METHOD)
    energy, momentum = run.energy(), run.momentum()
    total = energy.total
    assert np.diff(run.t).min() > 0.9e-3  # no step is taken in parts
    assert energy.elastic.max() < 1e-6 * total[0]
    assert np.ptp(total) < 1e-12 * total[0]
    for part in (momentum.linear, momentum.angular):
        assert np.abs(part - part[0]).max() < 1e-12 * np.linalg.norm(part[0])


def test_momentum_of_a_vertical_hinge():
    """A slewing crane with a flexible jib: the momentum of the slewing angle, over 10^4 steps."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    post = scene.add(fm.RigidBody(2.0, np.diag([0.1, 0.1, 0.2]), (0.1, 0.0, 0.0)), name="post")
    jib = scene.add(fm.FlexibleBody(CLOUDS[0].record), name="jib")
    slew = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), post.frame())
    luff = scene.connect(fm.joint.Revolute("y"), post.frame(p=(0.3, 0.0, 0.0)), jib.frame("root"))
    slew.velocity = 3.0
    scene.add_force(fm.force.JointSpring(luff, 5.0))
    run = scene.simulate(50.0, h=0.005, integrator=METHOD)
    work = new_work(run.scene.plan)
    momentum = [(mass_matrix(run.scene, work, x) @ v)[0] for x, v in zip(run.x[::50], run.v[::50], strict=True)]
    assert np.ptp(run.beta_rate(slew)) > 0.1
    assert np.ptp(momentum) < 1e-12 * abs(momentum[0])
    assert np.ptp(run.energy().total) < 1e-10


def test_body_free_of_torque():
    """An unevenly shaped body turns over and over: energy, spatial spin, rotations orthonormal."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, np.diag([1.0, 2.0, 3.0])), name="body")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    ball.velocity = (0.1, 2.0, 0.1)
    run = scene.simulate(200.0, h=0.01, integrator=METHOD)
    R = run.rotation(body.frame())
    spin = np.einsum("tij,j,tj->ti", R, [1.0, 2.0, 3.0], run.v)
    assert run.v[:, 1].min() < -1.9
    assert spread(spin) < 1e-12
    assert np.ptp(run.energy().total) < 1e-10
    assert np.abs(np.einsum("tji,tjk->tik", R, R) - np.eye(3)).max() < 1e-14


def test_heavy_top():
    """BENCHMARKS A7: order 2 at 0.5 s, energy, and the vertical angular momentum."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    inertia = np.array([15.234375, 0.46875, 15.234375])
    top = scene.add(fm.RigidBody(15.0, np.diag(inertia - [15.0, 0.0, 15.0]), (0.0, 1.0, 0.0)), name="top")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    ball.velocity = (0.0, 150.0, -4.61538)
    exact = np.array([-0.702468297057, -0.021165184702, -0.711400257652])
    errors = []
    for h in (4e-4, 2e-4):
        run = scene.simulate(0.5, h=h, integrator=METHOD)
        spin = np.einsum("tij,j,tj->ti", run.rotation(top.frame()), inertia, run.v)
        assert np.ptp(spin[:, 2]) < 1e-11 * abs(spin[0, 2])
        assert np.ptp(run.energy().total) < 1e-12 * run.energy().total[0]
        errors.append(np.abs(run.position(top.frame(p=(0.0, 1.0, 0.0)))[-1] - exact).max())
    assert errors[1] < 5e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)


def test_energy_changes_by_the_work_of_loads_and_dampers():
    """Torque at the middle of the step over the step's turn; modal damping takes some too."""
    scene, upper, lower = flexible_double_pendulum()
    scene.add_force(fm.force.JointSpring(lower, 20.0, rest=0.2, damping=0.1))
    scene.add_force(fm.force.JointTorque(upper, fm.Sine(3.0, 20.0, 0.4)))
    scene.add_force(fm.force.JointDamper(lower, 0.3))
    run = scene.simulate(5.0, h=0.005, integrator=METHOD)
    turns = np.diff([run.beta(upper), run.beta(lower)], axis=1)
    middle = 0.5 * (run.t[1:] + run.t[:-1])
    work = 3.0 * np.sin(20.0 * middle + 0.4) * turns[0] - 0.4 * turns[1] ** 2 / np.diff(run.t)
    total = run.energy().total
    assert np.ptp(total) > 3.0
    np.testing.assert_allclose(total[1:] - total[0], np.cumsum(work), atol=1e-10)


def test_prescribed_motion_by_the_midpoint_rule():
    """Order 2 against generalized-alpha, where a drive moves the upper hinge."""
    scene, upper, _ = flexible_double_pendulum(hold=None)
    upper.prescribe(lambda t: (np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)))
    exact = scene.simulate(0.5, h=1.0 / 12800, rtol=1e-10)
    errors = []
    for h in (1.0 / 400, 1.0 / 800):
        run = scene.simulate(0.5, h=h, integrator=METHOD)
        errors.append([np.abs(getattr(run, k)[-1] - getattr(exact, k)[-1]).max() for k in "xva"])
    np.testing.assert_allclose(np.divide(*errors), 4.0, atol=0.3)


def falling_slider_crank():
    """The slider-crank with its weight in its plane, started at 10 rad/s."""
    scene, piston, crank = slider_crank()
    scene.gravity = (0.0, -9.81, 0.0)
    crank.position = 0.3
    crank.velocity = 10.0
    return scene, piston, crank


def test_order_two_for_loops_and_their_multipliers():
    """Against generalized-alpha at a small step; the loop is closed in position and velocity at each step."""
    scene, piston, crank = falling_slider_crank()
    exact = scene.simulate(0.16, h=0.16 / 25600, rtol=1e-10)
    errors = []
    for steps in (200, 400):
        run = scene.simulate(0.16, h=0.16 / steps, integrator=METHOD)
        errors.append(
            [np.abs(getattr(run, k)[-1] - getattr(exact, k)[-1]).max() for k in ("x", "v", "a", "multipliers")]
        )
    np.testing.assert_allclose(np.divide(*errors), 4.0, atol=0.3)
    np.testing.assert_allclose(run.position(piston.frame())[:, 0], slider_position(run.beta(crank)), atol=1e-13)
    assert np.abs(run.velocity(piston.frame())[:, 1:]).max() < 1e-12


def test_energy_of_a_loop_does_not_drift():
    """Over some twenty swings by wide steps, and by error control."""
    scene, _, crank = falling_slider_crank()
    run = scene.simulate(10.0, h=0.005, integrator=METHOD)
    energy = run.energy()
    assert np.ptp(run.beta(crank)) > 2.0
    assert np.ptp(energy.total) < 1e-11 * np.ptp(energy.kinetic)
    assert run.stats.constraint_residual < 1e-12
    run = scene.simulate(1.0, rtol=1e-3, integrator=METHOD)
    assert np.ptp(run.energy().total) < 1e-11 * np.ptp(energy.kinetic)


def test_momentum_of_a_top_held_by_constraints():
    """A free joint's six coordinates, its point held by three rows: vertical angular momentum and energy."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    top = scene.add(fm.RigidBody(15.0, np.diag([0.234375, 0.46875, 0.234375]), (0.0, 1.0, 0.0)), name="top")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), top.frame())
    free.velocity = (0.0, 0.0, 0.0, 0.0, 150.0, -4.61538)
    scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    run = scene.simulate(0.3, h=1e-3, integrator=METHOD)
    spin = np.einsum("tij,j,tj->ti", run.rotation(top.frame()), [15.234375, 0.46875, 15.234375], run.v[:, 3:])
    assert run.multipliers.shape[1] == 3
    assert np.abs(run.velocity(top.frame())).max() < 1e-12
    assert np.ptp(spin[:, 2]) < 1e-11 * abs(spin[0, 2])
    assert np.ptp(run.energy().total) < 1e-12 * run.energy().total[0]


def test_a_disc_rolls_without_losing_energy():
    """A wobbling disc: rows that hold velocities alone beside one that holds positions; order 2 by halving."""
    radius, tilt = 0.3, 1.2
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    disc = scene.add(fm.RigidBody(2.0, np.diag([0.045, 0.045, 0.09])), name="disc")
    fly = scene.connect(fm.joint.Free(), scene.ground.frame(), disc.frame())
    fly.position = (0.0, 0.0, radius * np.sin(tilt), np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0)
    rate = np.array([0.2, 0.5, 6.0])  # in the disc's axes
    c, s = np.cos(tilt), np.sin(tilt)
    to_world, up = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), np.array([0.0, c, s])
    fly.velocity = (*np.cross(to_world @ rate, radius * up), *rate)  # it rolls
    scene.connect(fm.joint.RollingDisc(radius), scene.ground.frame(), disc.frame())
    runs = [scene.simulate(0.4, h=0.4 / steps, integrator=METHOD) for steps in (40, 80, 160)]
    for run in runs:
        assert np.ptp(run.energy().kinetic) > 1.0
        assert np.ptp(run.energy().total) < 1e-11
        assert run.stats.constraint_residual < 1e-12
    for part in ("x", "v", "multipliers"):
        ends = [getattr(run, part)[-1] for run in runs]
        ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
        assert ratio == pytest.approx(4.0, abs=0.3), part


def loaded_loop(*, stiff=1.0):
    """A crank, driven by a torque, and a flexible coupler on a ball joint whose tip runs on a line.

    Two of its modes are ``stiff`` times as fast as they are of themselves.
    """
    record = CLOUDS[1].record
    record = dataclasses.replace(record, stiffness=record.stiffness * [1.0, 1.0, stiff**2, stiff**2])
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank = scene.add(fm.RigidBody(0.9, (4e-3, 6e-3, 8e-3), (0.02, 0.0, 0.0)), name="crank")
    coupler = scene.add(fm.FlexibleBody(record), name="coupler")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
    scene.connect(fm.joint.Spherical(), crank.frame(p=(0.1, 0.0, 0.0)), coupler.frame("root"))
    tip = record.interfaces[1]
    line = scene.ground.frame(p=np.array([0.1, 0.0, 0.0]) + tip.p_BI_B)
    scene.connect(fm.joint.PointOnLine("x"), line, coupler.frame("tip"))
    scene.add_force(fm.force.JointTorque(hinge, 2.0))
    hinge.velocity = 3.0
    return scene, hinge


def test_error_control_of_a_loop_with_stiff_modes():
    """Against Radau IIA: within 10 rtol, in steps that do not follow vibrations of next to no size.

    The energy is what the torque did.
    """
    scene, hinge = loaded_loop(stiff=1e4)
    exact = scene.simulate(0.3, rtol=1e-9, integrator=fm.RadauIIA())
    for rtol in (1e-3, 1e-4, 1e-5):
        run = scene.simulate(0.3, rtol=rtol, integrator=METHOD)
        assert run.stats.steps < 1000
        assert np.abs(run.x[-1] - exact.x[-1]).max() < 10.0 * rtol
        total, turn = run.energy().total, run.beta(hinge)
        np.testing.assert_allclose(total - total[0], 2.0 * (turn - turn[0]), atol=1e-11)


def test_velocities_of_a_loop_do_not_jump_in_short_steps():
    """Each step's change of velocity is that of its acceleration, though gaps of round-off are closed in it."""
    scene, _ = loaded_loop()
    h = 1e-9
    run = scene.simulate(20 * h, h=h, integrator=METHOD)
    gaps = np.diff(run.v, axis=0) - 0.5 * h * (run.a[1:] + run.a[:-1])
    assert np.abs(gaps).max() < 1e-3 * h * np.abs(run.a).max()


@pytest.mark.parametrize("newton", [0.0, -1e-9, 0.1])
def test_newton_must_be_a_small_number(newton):
    with pytest.raises(fm.FlexmbdError, match="newton must lie between"):
        fm.EnergyMomentum(newton=newton)


@pytest.mark.parametrize("rtol", [1e-6, 1e-7])
def test_steps_below_what_newtons_tolerance_resolves(rtol):
    """Light links of a chain: round-off of the sums alone leaves more than 1e-12 of a short step's velocities."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    end = scene.ground.frame()
    for i in range(8):
        link = scene.add(fm.RigidBody(0.6, (4e-5, 2e-3, 2e-3), (0.1, 0.0, 0.0)), name=f"link {i}")
        scene.connect(fm.joint.Revolute("z"), end, link.frame())
        end = link.frame(p=(0.2, 0.0, 0.0))
    run = scene.simulate(0.3, rtol=rtol, integrator=METHOD)
    assert run.stats.rejected < 0.01 * run.stats.steps
    assert np.ptp(run.energy().total) < 1e-11 * np.ptp(run.energy().kinetic)


def forearm_held_beside_its_pin(lever, *, seed):
    """Two links about parallel axes somewhere in space, the outer held by a point ``lever`` (m) beside its pin."""
    R = Rotation.from_rotvec(np.random.default_rng(seed).uniform(-2.0, 2.0, 3)).as_matrix()
    beside = lever * R[0]
    pin = np.array([1.1, 0.2, 0.3])
    scene = fm.System(gravity=(2.0, -9.0, 3.0))
    arm = scene.add(fm.RigidBody(2.0, (0.15, 0.17, 0.16), (0.5, 0.0, 0.0)), name="arm")
    fore = scene.add(fm.RigidBody(2.0, (0.15, 0.17, 0.16), (0.1, 0.3, 0.2)), name="forearm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(0.3, 0.1, 0.0), R=R), arm.frame())
    scene.connect(fm.joint.Revolute("z"), arm.frame(p=pin, R=R.T), fore.frame(R=R.T))
    scene.connect(fm.joint.PointOnPlane("y"), arm.frame(p=pin + beside, R=R.T), fore.frame(p=beside, R=R.T))
    hinge.position, hinge.velocity = 0.3, 0.25
    return scene


@pytest.mark.parametrize("seed", range(4))
def test_round_off_of_a_row_on_a_short_lever(seed):
    """A gap is a difference of positions, rounded as these are, though the row moves by 1e-4 m a radian alone."""
    run = forearm_held_beside_its_pin(1e-4, seed=seed).simulate(0.0625, rtol=1e-4, integrator=METHOD)
    assert run.stats.iterations <= 4 * run.stats.steps
    total = run.energy().total
    assert np.ptp(total) < METHOD.newton * run.stats.steps * np.abs(total).max()


@entry_kernel
def call(address, arguments):
    """A kernel at its address."""
    call_separate(address, arguments)


@entry_kernel
def put_scales(state, groups, s):
    """Scales of corrections."""
    set_scales(state, groups, s, machine_rate(state, groups), 1e-12)


def parts(scene, h):
    """Arrays of the method at the start of a simulation with steps of h, and what the kernels take."""
    kept = {}

    class Method(fm.EnergyMomentum):
        def stepper(self, scene, state, groups, work):
            stepper = super().stepper(scene, state, groups, work)
            kept.update(scene=scene, state=state, groups=groups, work=work, memory=arrays_of(stepper.memory))
            return stepper

    scene.simulate(3 * h, h=h, integrator=Method())
    compiled, state, groups, work = (kept[name] for name in ("scene", "state", "groups", "work"))
    plan = compiled.plan
    stored = storing_plan(plan)
    s = new_workspace(plan, work, compiled.nx, compiled.nv, projector(compiled, stored), row_sizes(compiled))
    for name, part in arrays_of(s.memory).items():
        part[...] = kept["memory"][name]
    loops = new_loops(plan, s.memory.loops, compiled.nv)
    bind(plan, stored, work, loops, state, groups, s)
    put_scales(state, groups, s)
    return plan, stored, work, loops, state, groups, s


def slow_iterations(scene, h):
    """Largest share of an error that an iteration with the analytic matrix leaves, by differences of the equations."""
    plan, stored, work, loops, state, groups, s = parts(scene, h)
    n = len(plan.free)

    def equation(unknown):
        s.unknown[:] = unknown
        call(s.kernels[EVALUATE], (plan, stored, work, loops, state, s, h, False, False))
        return s.equation.copy()

    start = np.concatenate([state.v[plan.free] + 0.5 * h * state.a[plan.free], 0.5 * h * state.multipliers])
    equation(start)
    call(s.kernels[LINEARISE], (plan, work, state, groups, s, h))
    sizes = np.full(len(start), 1e-5)
    sizes[n:] = 1e-5 * max(1.0, np.abs(start[n:]).max(initial=0.0))
    columns = [(equation(start + e) - equation(start - e)) / (2.0 * e.max()) for e in np.diag(sizes)]
    left = scipy.linalg.lu_solve((s.matrix.T, s.pivot - 1), np.array(columns).T, trans=1)
    return np.abs(np.linalg.eigvals(left - np.eye(len(start)))).max()


@pytest.mark.parametrize(
    ("machine", "ratio"),
    [
        (lambda: flexible_double_pendulum()[0], 3.0),
        (lambda: flying_machine((0.0, 0.0, -9.81))[0], 1.8),
        (nonlinear_pendulum, 3.0),
        (lambda: falling_slider_crank()[0], 3.0),
    ],
    ids=["flexible", "flying", "nonlinear", "loop"],
)
def test_analytic_matrix_is_right_but_for_powers_of_the_step(machine, ratio):
    """The second, but the first where rotations are the unknowns."""
    shares = [slow_iterations(machine(), h) for h in (2e-3, 1e-3)]
    assert shares[1] < 5e-3
    assert shares[0] / shares[1] > ratio


MEANS = [
    (lambda: flexible_double_pendulum()[0], CLOUDS[0], lambda plan, s, h: average_strain(plan, s, h)),
    (nonlinear_pendulum, NONLINEAR, lambda plan, s, h: average_polynomials(plan, s)),
]


@pytest.mark.parametrize(("machine", "cloud", "average"), MEANS, ids=["strain", "polynomial"])
def test_mean_force_is_an_exact_discrete_gradient(machine, cloud, average):
    """The forces of deformation times the step's motion are the change of the particles' strain energy."""
    plan, _, _, _, state, _, s = parts(machine(), 1e-2)
    record = cloud.record
    h = 1e-2
    rng = np.random.default_rng(5)
    s.u[:] = rng.standard_normal(len(s.u))
    s.gradient[:] = s.stored_gradient[:] = 0.0
    x = state.x.copy()
    modes = slice(int(plan.tree[0, at.MODAL_X]), int(plan.tree[0, at.MODAL_X]) + len(record.stiffness))
    x[modes] = 0.1 * rng.standard_normal(len(record.stiffness))
    call(s.kernels[PLACE], (plan, x, s, h))
    flex, forces = plan.flex[plan.tree[0, at.FLEX]], s.stored_gradient[1:4]
    add_elastic_forces(plan, flex, s.x_mid[modes], np.zeros(3), np.zeros(3), forces)
    middle = s.stored_gradient[1:4] @ s.increment[1:4]
    entry_kernel(average)(plan, s, h)
    change = strain_energy(record, s.x_end[modes]) - strain_energy(record, x[modes])
    assert s.stored_gradient[1:4] @ s.increment[1:4] == pytest.approx(change, rel=1e-11)
    assert abs(middle - change) > 1e-6 * abs(change)


def test_a_machine_at_rest_stays_there():
    """No energy there, none to come: nothing to divide by."""
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(0.5, (0.01, 0.01, 0.01)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), wheel.frame())
    run = scene.simulate(0.1, integrator=METHOD)
    np.testing.assert_array_equal(run.beta(hinge), 0.0)
    np.testing.assert_array_equal(run.beta_rate(hinge), 0.0)
