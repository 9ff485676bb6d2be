"""Force elements against closed forms: laws on coordinates and wrenches between frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mixed_machine import mixed_scene
from particles import particle_body
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.force.beam_strain import BeamStrain
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.elements.element import FrameElement
from flexmbd.multibody.kernels.elements.table import ELEMENTS, coordinate_law, element_wrench, element_wrench_variation
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.kernels.sampling.series import energy_series
from flexmbd.record.groups import DistributedLoads


def wheel(inertia=0.25):
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (inertia, inertia, inertia)), name="disc")
    return scene, disc, scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame(), name="hinge")


def test_a_joint_spring_and_damper_make_an_oscillator():
    """I b'' + c b' + k (b - r) = 0: decay and period in closed form, whichever way the damping is given."""
    k, c, rest, inertia = 25.0, 0.8, 0.1, 0.25
    for apart in (False, True):
        scene, _, hinge = wheel(inertia)
        scene.add_force(fm.force.JointSpring(hinge, k, rest, 0.0 if apart else c))
        if apart:
            scene.add_force(fm.force.JointDamper(hinge, c))
        hinge.position = 0.4
        run = scene.simulate(2.0, rtol=1e-7)
        decay = c / (2.0 * inertia)
        omega = np.sqrt(k / inertia - decay**2)
        swing = np.cos(omega * run.t) + decay / omega * np.sin(omega * run.t)
        exact = rest + 0.3 * np.exp(-decay * run.t) * swing
        np.testing.assert_allclose(run.beta(hinge), exact, atol=2e-6)


def test_the_energy_of_a_spring_is_counted():
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointSpring(hinge, 25.0, 0.1))
    hinge.position = 0.4
    run = scene.simulate(2.0, rtol=1e-7)
    energy = run.energy()
    np.testing.assert_allclose(energy.spring, 12.5 * (run.beta(hinge) - 0.1) ** 2, rtol=1e-12)
    np.testing.assert_allclose(energy.total, 12.5 * 0.09, rtol=1e-5)
    assert energy.spring.min() < 1e-2 * energy.spring.max()  # it was exchanged


def test_a_spring_by_its_characteristic():
    """A table resists by its spline, here with straight ends; its energy is the spline's integral."""
    deflection = np.linspace(-0.3, 0.3, 7)
    force = 20.0 * deflection + 90.0 * deflection**3
    spline = CubicSpline(deflection, force)
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointSpring(hinge, fm.Table(deflection, force, beyond=fm.Beyond.LINEAR), rest=0.2))
    hinge.position = 0.9
    start = scene.start()
    expected = -(float(spline(0.3)) + 0.4 * float(spline(0.3, 1))) / 0.25
    assert start.a[0] == pytest.approx(expected, rel=1e-12)
    run = scene.simulate(1.5, rtol=1e-7)
    stretch = run.beta(hinge) - 0.2
    inside = np.abs(stretch) < 0.3
    stored = np.array([spline.integrate(0.0, s) for s in stretch[inside]])
    np.testing.assert_allclose(run.energy().spring[inside], stored, atol=1e-12)
    total = run.energy().total
    np.testing.assert_allclose(total, total[0], rtol=1e-5)
    assert inside.any()
    assert not inside.all()


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_a_stop_gives_back_what_hunt_and_crossley_say(damping):
    """A wheel runs into its stop at w and leaves it at u: w/a - ln(1 + a w)/a^2 = -u/a - ln(1 - a u)/a^2."""
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointStop(hinge, -0.5, 0.3, 4e4, damping))
    hinge.velocity = 6.0
    run = scene.simulate(0.35, h=2e-5)
    rate, angle = run.beta_rate(hinge), run.beta(hinge)
    assert angle.max() > 0.301
    first = _rebound(damping, 6.0)
    second = _rebound(damping, first)
    between = (angle > -0.5) & (angle < 0.3)
    np.testing.assert_allclose(rate[between & (rate < 0.0)], -first, rtol=1e-5)
    np.testing.assert_allclose(rate[between & (rate > 0.0) & (run.t > 0.2)], second, rtol=1e-5)
    controlled = scene.simulate(0.07, rtol=1e-7)
    assert controlled.beta_rate(hinge)[-1] == pytest.approx(-first, rel=1e-5)
    assert controlled.stats.steps < 4500  # nearly all in the contact, by a method of order 2
    energy = run.energy()
    if damping == 0.0:
        np.testing.assert_allclose(energy.total[between], energy.total[0], rtol=1e-5)
        assert energy.spring.max() == pytest.approx(energy.total[0], rel=0.05)
    else:
        assert (np.diff(energy.total) < 1e-5 * energy.total[0]).all()
    rate2 = run.a[:, 0]
    assert (rate2[angle > 0.3] <= 0.0).all()  # it never pulls
    assert (rate2[angle < -0.5] >= 0.0).all()
    assert np.abs(rate2[(angle < 0.3) & (angle > -0.5)]).max() < 1e-10 * np.abs(rate2).max()


def _rebound(a, w):
    if a == 0.0:
        return w
    lost = w / a - np.log1p(a * w) / a**2
    low, high = 0.0, w
    for _ in range(100):
        u = 0.5 * (low + high)
        low, high = (u, high) if -u / a - np.log1p(-a * u) / a**2 < lost else (low, u)
    return 0.5 * (low + high)


def test_friction_brings_a_wheel_to_rest_in_its_time():
    """I w' = -T tanh(w / s): sinh(w / s) = sinh(w0 / s) exp(-T t / (I s)), at rest after I w0 / T."""
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointFriction(hinge, 0.5, 0.01))
    hinge.velocity = 2.0
    run = scene.simulate(1.2, rtol=1e-7)
    late = run.t > 1.0
    exact = np.where(late, 0.01 * np.exp(-np.clip((run.t - 1.0) * 200.0, 0.0, 600.0)), 2.0 - 2.0 * run.t)
    near = np.abs(run.t - 1.0) < 0.02
    w = run.beta_rate(hinge)
    np.testing.assert_allclose(w[~near], exact[~near], atol=1e-4)
    log = np.exp(200.0 - 200.0 * run.t[near]) / 2.0  # sinh(200) is e^200 / 2
    np.testing.assert_allclose(w[near], 0.01 * np.arcsinh(log), atol=2e-5)
    assert run.beta(hinge)[-1] == pytest.approx(1.0, abs=2e-4)


def test_stribeck_and_viscous_friction_hold_a_speed():
    """A motor at the speed where its torque equals the law: it stays."""
    w = 0.7
    torque = (2.0 + 1.5 * np.exp(-((w / 0.5) ** 2))) * np.tanh(w / 0.1) + 0.3 * w
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointFriction(hinge, 2.0, 0.1, 3.5, 0.5, 0.3))
    scene.add_force(fm.force.JointTorque(hinge, torque))
    hinge.velocity = w
    np.testing.assert_allclose(scene.start().a, 0.0, atol=1e-14)


def test_a_spring_on_an_oblique_pair_of_bodies():
    """Two free bodies on a spring: the distance swings with the reduced mass about their centre at rest."""
    scene = fm.System()
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    bodies = [scene.add(fm.RigidBody(m, (1.0, 1.0, 1.0)), name=f"{m}") for m in (2.0, 3.0)]
    flights = [scene.connect(fm.joint.Free(), scene.ground.frame(), b.frame()) for b in bodies]
    flights[1].position = (*(1.3 * direction), 1.0, 0.0, 0.0, 0.0)
    scene.add_force(fm.force.SpringDamper(bodies[0].frame(), bodies[1].frame(), 60.0, 1.0, 0.4))
    run = scene.simulate(2.0, rtol=1e-7)
    gap = run.position(bodies[1].frame()) - run.position(bodies[0].frame())
    mass = 2.0 * 3.0 / 5.0
    decay = 0.4 / (2.0 * mass)
    omega = np.sqrt(60.0 / mass - decay**2)
    exact = 1.0 + 0.3 * np.exp(-decay * run.t) * (np.cos(omega * run.t) + decay / omega * np.sin(omega * run.t))
    np.testing.assert_allclose(gap, np.outer(exact, direction), atol=3e-6)
    centre = (2.0 * run.position(bodies[0].frame()) + 3.0 * run.position(bodies[1].frame())) / 5.0
    np.testing.assert_allclose(centre, np.tile(0.78 * direction, (len(run.t), 1)), atol=1e-10)


def on_bushing(stiffness, inertia=(0.2, 0.3, 0.4)):
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.5, inertia), name="block")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.Bushing(scene.ground.frame(), body.frame(), stiffness))
    return scene, body, flight


def test_a_bushing_is_six_oscillators():
    """Small motions in each direction with the frequency of its own stiffness and mass."""
    stiffness = np.array([100.0, 150.0, 240.0, 30.0, 20.0, 50.0])
    scene, body, flight = on_bushing(stiffness)
    turned = 1e-3 * np.array([1.0, -1.0, 0.5])
    turn = Rotation.from_rotvec(turned).as_quat()
    flight.position = (0.1, 0.2, -0.1, turn[3], *turn[:3])
    run = scene.simulate(1.0, rtol=1e-8)
    omega = np.sqrt(stiffness / np.array([1.5, 1.5, 1.5, 0.2, 0.3, 0.4]))
    exact = np.array([0.1, 0.2, -0.1, *turned]) * np.cos(np.outer(run.t, omega))
    found = Rotation.from_matrix(run.rotation(body.frame())).as_rotvec()
    np.testing.assert_allclose(run.position(body.frame()), exact[:, :3], atol=1e-6)
    np.testing.assert_allclose(found, exact[:, 3:], atol=1e-6)


def test_a_bushing_keeps_the_energy_of_large_turns():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 6))
    scene, body, flight = on_bushing(20.0 * root @ root.T)
    turn = Rotation.from_rotvec([0.9, -1.2, 0.8]).as_quat()
    flight.position = (0.3, -0.2, 0.1, turn[3], *turn[:3])
    run = scene.simulate(2.0, rtol=1e-7)
    energy = run.energy()
    np.testing.assert_allclose(energy.total, energy.total[0], rtol=3e-5)
    turned = np.linalg.norm(Rotation.from_matrix(run.rotation(body.frame())).as_rotvec(), axis=1)
    assert turned.max() > 1.5
    assert energy.spring.min() < 0.2 * energy.spring.max()


def loaded_scene():
    """Conservative elements all over the machine of every joint, at flexible tips too."""
    scene, bodies, _, _ = mixed_scene()
    scene.gravity = (0.0, 0.0, 0.0)
    scene._connections = scene._connections[:-3]  # a tree
    a, b, c, d, e, _ = bodies
    rng = np.random.default_rng(8)
    force = fm.force
    turn = Rotation.from_rotvec([0.4, 0.2, -0.3]).as_matrix()
    root = rng.standard_normal((6, 6))
    deflection = np.linspace(-2.0, 2.0, 9)
    elements = [
        force.SpringDamper(a.frame(p=(0.3, 0.0, 0.1)), d.frame("tip"), 30.0, 0.4),
        force.SpringDamper(scene.ground.frame(p=(1, 0, 0)), b.frame("tip"), 20.0, 0.0),
        force.Bushing(b.frame("tip"), e.frame(p=(0.1, 0.2, 0.0), R=turn), 5.0 * root @ root.T),
        force.Bushing(c.frame(R=turn), scene.ground.frame(), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        force.BeamElement(b.frame("tip"), e.frame(p=(0.1, 0.2, 0.0)), 3.0 * root.T @ root, np.linspace(0.1, 0.7, 6)),
        force.JointSpring(scene._connections[1], 7.0, 0.3),
        force.JointSpring(scene._connections[3], fm.Table(deflection, np.sinh(deflection))),
        force.JointStop(scene._connections[4], -0.01, 0.01, 90.0, transition=0.1),
    ]
    for element in elements:
        scene.add_force(element)
    return scene, bodies


def state(compiled, seed):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    return x, rng.standard_normal(compiled.nv)


def spring_energy(compiled, x):
    out, zero = np.zeros((1, 4)), np.zeros(compiled.nv)
    energy_series(compiled.plan, new_work(compiled.plan), x[None], zero[None], zero, zero.copy(), out)
    return out[0, 3]


def element_forces(compiled, x, v):
    """Generalised forces of the elements alone."""
    zero, none = np.zeros(compiled.nv), np.zeros(0)
    with_, without = np.zeros((2, compiled.nv))
    residual(compiled.plan, new_work(compiled.plan), x, v, zero, none, with_)
    bare = without_forces(compiled.plan)
    residual(bare, new_work(bare), x, v, zero, none, without)
    return without - with_


@pytest.mark.parametrize("seed", [0, 1])
def test_forces_are_the_slope_of_the_energy(seed):
    """All conservative elements on a tree with flexible parents: force = -dV/dx along every velocity."""
    scene, _ = loaded_scene()
    compiled = scene.compile().scene
    x, _ = state(compiled, seed)
    forces = element_forces(compiled, x, np.zeros(compiled.nv))
    slope = np.zeros(compiled.nv)
    for j, unit in enumerate(np.eye(compiled.nv)):
        for k, w in ((1, 2.0 / 3.0), (2, -1.0 / 12.0)):
            for sign in (-1.0, 1.0):
                place = np.empty_like(x)
                retract(compiled.plan, x, sign * k * 1e-3 * unit, place)
                slope[j] += sign * w * spring_energy(compiled, place) / 1e-3
    np.testing.assert_allclose(forces, -slope, atol=2e-8 * np.abs(slope).max())


def test_the_energy_of_a_bushing_by_another_logarithm():
    scene, body, flight = on_bushing((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    for angle in (1e-9, 1e-3, 0.4, 0.6, 3.0, 3.14):
        theta = angle * np.array([2.0, -1.0, 2.0]) / 3.0
        turn = Rotation.from_rotvec(theta).as_quat()
        flight.position = (0.3, -0.2, 0.1, turn[3], *turn[:3])
        u = np.array([0.3, -0.2, 0.1, *theta])
        expected = 0.5 * np.sum(np.arange(1.0, 7.0) * u**2)
        compiled = scene.compile().scene
        assert spring_energy(compiled, scene.start().x) == pytest.approx(expected, rel=1e-12)
    assert body.name == "block"


def test_dampers_take_away_the_power_of_their_laws():
    """Power of all dampers = -(dissipation of each), from the frames' velocities by differences."""
    scene, bodies, _, _ = mixed_scene()
    scene.gravity = (0.0, 0.0, 0.0)
    scene._connections = scene._connections[:-3]
    a, b, _, d, e, _ = bodies
    root = np.random.default_rng(9).standard_normal((6, 6))
    matrix = root @ root.T
    frames = b.frame("tip"), e.frame(p=(0.1, 0.2, 0.0))
    ends = a.frame(p=(0.3, 0.0, 0.1)), d.frame("tip")
    scene.add_force(fm.force.Bushing(*frames, np.zeros(6), matrix))
    scene.add_force(fm.force.SpringDamper(*ends, 0.0, 0.0, 3.0))
    scene.add_force(fm.force.JointDamper(scene._connections[3], 0.7))
    compiled = scene.compile().scene
    x, v = state(compiled, 3)

    def motion(step):
        place = np.empty_like(x)
        retract(compiled.plan, x, step * v, place)
        still = np.zeros((1, compiled.nv))
        run = fm.Trajectory(compiled, np.zeros(1), place[None], still, still, np.zeros((1, 0)), None, {}, None)
        R = run.rotation(frames[0])[0]
        d = R.T @ (run.position(frames[1]) - run.position(frames[0]))[0]
        theta = Rotation.from_matrix(R.T @ run.rotation(frames[1])[0]).as_rotvec()
        return np.array([*d, *theta, np.linalg.norm(run.position(ends[1]) - run.position(ends[0]))])

    h = 1e-3
    rate = (motion(-2 * h) - 8 * motion(-h) + 8 * motion(h) - motion(2 * h)) / (12 * h)
    slide = v[compiled.index.joints[scene._connections[3]].v][0]
    expected = -rate[:6] @ matrix @ rate[:6] - 3.0 * rate[6] ** 2 - 0.7 * slide**2
    assert element_forces(compiled, x, v) @ v == pytest.approx(expected, rel=1e-8)


def test_a_given_force_does_the_work_of_its_frame():
    """Power = F . v + T . w in either axes, functions of time included, at a flexible tip."""
    for axes in fm.force.Axes:
        scene, bodies, _, _ = mixed_scene()
        scene.gravity = (0.0, 0.0, 0.0)
        scene._connections = scene._connections[:-3]
        tip = bodies[1].frame("tip")
        scene.add_force(fm.force.FrameForce(tip, (1.0, lambda t: 2.0 + t, 3.0), (-4.0, 5.0, fm.Sine(6.0, 1.0)), axes))
        compiled = scene.compile().scene
        x, v = state(compiled, 4)
        work = new_work(compiled.plan)
        evaluate_times(compiled.plan, 0.5, work.time)
        zero, none = np.zeros(compiled.nv), np.zeros(0)
        with_, without = np.zeros((2, compiled.nv))
        residual(compiled.plan, work, x, v, zero, none, with_)
        bare = without_forces(compiled.plan)
        residual(bare, new_work(bare), x, v, zero, none, without)
        run = fm.Trajectory(compiled, np.zeros(1), x[None], v[None], zero[None], none[None], None, {}, None)
        R = run.rotation(tip)[0] if axes is fm.force.Axes.FRAME else np.eye(3)
        force, torque = R @ [1.0, 2.5, 3.0], R @ [-4.0, 5.0, 6.0 * np.sin(0.5)]
        power = force @ run.velocity(tip)[0] + torque @ run.angular_velocity(tip)[0]
        assert (without - with_) @ v == pytest.approx(power, rel=1e-12)


def test_a_distributed_load_is_the_sum_of_forces_on_its_particles():
    """Forces f_i on the particles, in the body's axes: their work on the body's motion and on its modes."""
    cloud = particle_body(4, modes=3)
    rng = np.random.default_rng(5)
    f = rng.standard_normal(cloud.x.shape)
    moment = np.cross(cloud.x, f).sum(axis=0)
    loads = DistributedLoads(
        ("wind",), f.sum(axis=0)[None], moment[None], np.einsum("ki,kin->n", f, cloud.phi)[None]
    )
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(replace(cloud.record, loads=loads)), name="sail")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.DistributedLoad(body, "wind", 2.0))
    compiled = scene.compile().scene
    start = scene.start()
    R = Rotation.from_rotvec([0.3, 0.2, 0.1])
    x = start.x.copy()
    x[3:7] = R.as_quat()[[3, 0, 1, 2]]
    work = new_work(compiled.plan)
    work.time[0, 0] = 2.0
    v, out, zero = rng.standard_normal(compiled.nv), np.zeros(compiled.nv), np.zeros(compiled.nv)
    residual(compiled.plan, work, x, 0 * v, zero, np.zeros(0), out)
    particle = R.as_matrix().T @ v[:3] + np.cross(v[3:6], cloud.x) + cloud.phi @ v[6:]
    assert -out @ v == pytest.approx(2.0 * np.sum(f * particle), rel=1e-12)
    with pytest.raises(SceneError, match="'rain' on sail: the record has no such load; it has: 'wind'"):
        scene.add_force(fm.force.DistributedLoad(body, "rain"))


# --- variations ------------------------------------------------------------------------------


def element_rows():
    """A plan with one element between frames of every kind, and one on a coordinate of every kind."""
    scene, disc, hinge = wheel()
    root = np.random.default_rng(1).standard_normal((2, 6, 6))
    frames = scene.ground.frame(), disc.frame()
    force = fm.force
    damped_beam = force.BeamElement(*frames, root[0] @ root[0].T, np.linspace(-0.4, 0.9, 6), root[1] @ root[1].T)
    for element in (
        force.SpringDamper(*frames, 7.0, 0.4, 0.9),
        force.Bushing(*frames, root[0] @ root[0].T, root[1] @ root[1].T),
        force.BeamElement(*frames, root[0] @ root[0].T, np.linspace(-0.4, 0.9, 6)),
        damped_beam,
        BeamStrain([damped_beam], [1.3], 5, fm.Sine(1.0, 2.0), "bend"),
        force.FrameForce(disc.frame(), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
        force.FrameForce(disc.frame(), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), force.Axes.FRAME),
        force.JointSpring(hinge, 3.0, 0.1, 0.2),
        force.JointSpring(hinge, fm.Table([-1.0, 0.0, 0.5, 2.0], [-3.0, 0.0, 1.0, 9.0]), 0.1, 0.2),
        force.JointStop(hinge, -0.2, 0.3, 50.0, 0.4, 0.3),
        force.JointFriction(hinge, 1.0, 0.2, 2.5, 0.4, 0.3),
    ):
        scene.add_force(element)
    plan = scene.compile().scene.plan
    of_frames = [isinstance(ELEMENTS[row[at.EL_KIND]], FrameElement) for row in plan.elements]
    return plan, plan.elements[of_frames], plan.elements[~np.array(of_frames)]


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.3, 0.49, 0.51, 2.9])
def test_variations_of_wrenches_against_differences(angle):
    plan, between, _ = element_rows()
    work = new_work(plan)
    work.time[:, :2] = 0.7, -0.4
    rng = np.random.default_rng(3)
    axis = rng.standard_normal(3)
    R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    d, rate, spin, dd, dtheta, drate, dspin = (tuple(map(float, u)) for u in rng.standard_normal((7, 3)))

    def wrench(row, s):
        moved = [tuple(np.add(u, s * np.array(du))) for u, du in ((d, dd), (rate, drate), (spin, dspin))]
        turned = (Rotation.from_rotvec(s * np.array(dtheta)) * R).as_matrix()
        return np.array(element_wrench(plan, work, row, moved[0], tuple(turned.ravel()), moved[1], moved[2]))

    assert len(between) == 7
    for row in between:
        h = 1e-3
        slope = sum(
            w * (wrench(row, k * h) - wrench(row, -k * h)) for k, w in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
        )
        exact = element_wrench_variation(
            plan, work, row, d, tuple(R.as_matrix().ravel()), rate, spin, dd, dtheta, drate, dspin, 1e-6
        )
        np.testing.assert_allclose(np.array(exact), slope / h, atol=1e-8 * max(1.0, np.abs(slope / h).max()))


@pytest.mark.parametrize("x", [-2.3, -0.4, -0.25, 0.2, 0.4, 0.7, 3.0])
@pytest.mark.parametrize("rate", [-3.0, -0.3, 0.05, 0.9])
def test_derivatives_of_laws_against_differences(x, rate):
    plan, _, laws = element_rows()
    h = 1e-4
    assert len(laws) == 4
    for row in laws:
        _, by_x, by_rate = coordinate_law(plan, row, x, rate)
        weights = ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0))
        slope_x = sum(w * coordinate_law(plan, row, x + k * h, rate)[0] for k, w in weights) / (12 * h)
        slope_v = sum(w * coordinate_law(plan, row, x, rate + k * h)[0] for k, w in weights) / (12 * h)
        assert by_x == pytest.approx(slope_x, rel=1e-8, abs=1e-8)
        assert by_rate == pytest.approx(slope_v, rel=1e-8, abs=1e-8)


# --- bad input -------------------------------------------------------------------------------


def test_elements_that_no_joint_takes():
    scene, disc, hinge = wheel()
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    socket = scene.connect(fm.joint.Spherical(), disc.frame(), ball.frame(), name="socket")
    with pytest.raises(SceneError, match="JointSpring on joint 'socket': a Spherical has no coordinate that is one"):
        scene.add_force(fm.force.JointSpring(socket, 1.0))
    with pytest.raises(SceneError, match="coordinate 1 of joint 'hinge': a Revolute has coordinates 0 to 0"):
        scene.add_force(fm.force.JointDamper(hinge, 1.0, coordinate=1))
    with pytest.raises(SceneError, match=r"stiffness = -1\.0 must not be negative"):
        scene.add_force(fm.force.JointSpring(hinge, -1.0))
    with pytest.raises(SceneError, match="damping = nan is not a finite number"):
        scene.add_force(fm.force.JointDamper(hinge, np.nan))
    with pytest.raises(SceneError, match=r"lower = 0\.3 must lie below upper = 0\.3"):
        scene.add_force(fm.force.JointStop(hinge, 0.3, 0.3, 1.0))
    with pytest.raises(SceneError, match=r"transition = 0\.0 must be positive"):
        scene.add_force(fm.force.JointStop(hinge, -0.3, 0.3, 1.0, transition=0.0))
    with pytest.raises(SceneError, match="static friction needs Stribeck's speed"):
        scene.add_force(fm.force.JointFriction(hinge, 1.0, 0.1, static=2.0))
    with pytest.raises(SceneError, match=r"static = 0\.5 must not be below coulomb = 1\.0"):
        scene.add_force(fm.force.JointFriction(hinge, 1.0, 0.1, 0.5, 0.2))
    with pytest.raises(SceneError, match=r"regularisation = 0\.0 must be positive"):
        scene.add_force(fm.force.JointFriction(hinge, 1.0, 0.0))
    ends = scene.ground.frame(), disc.frame()
    with pytest.raises(SceneError, match="stiffness must be symmetric"):
        scene.add_force(fm.force.Bushing(*ends, np.eye(6) + np.eye(6, k=1)))
    with pytest.raises(SceneError, match="damping has a negative eigenvalue"):
        scene.add_force(fm.force.Bushing(*ends, np.ones(6), (1, 1, 1, 1, 1, -1)))
    with pytest.raises(SceneError, match=r"stiffness must be finite numbers of shape \(6, 6\)"):
        scene.add_force(fm.force.Bushing(*ends, np.ones(5)))
    with pytest.raises(SceneError, match="force takes three components"):
        scene.add_force(fm.force.FrameForce(disc.frame(), (1.0, 2.0)))
    with pytest.raises(SceneError, match=r"axes must be fm.force.Axes.WORLD or fm.force.Axes.FRAME, got Frame"):
        scene.add_force(fm.force.FrameForce(disc.frame(), axes=disc.frame()))
    stranger = fm.RigidBody(1.0, (1, 1, 1), name="stranger")
    with pytest.raises(SceneError, match="on a body that is not in this scene"):
        scene.add_force(fm.force.SpringDamper(ends[0], stranger.frame(), 1.0, 1.0))
    _, _, foreign = wheel()
    with pytest.raises(SceneError, match="'hinge' is not in this scene"):
        scene.add_force(fm.force.JointDamper(foreign, 1.0))


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_the_transition_of_a_stop_goes_with_the_unit_of_length(unit):
    """A block at rest in its stop by a hundredth of the range: stiffness (s - transition / 2), a thousandth of it."""
    scene = fm.System()
    block = scene.add(fm.RigidBody(1.0, (unit**2, unit**2, unit**2)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    scene.add_force(fm.force.JointStop(slide, -1.0 * unit, 1.0 * unit, 300.0, transition=1.0 * unit))
    scene.add_force(fm.force.JointStop(slide, -0.5 * unit, 0.5 * unit, 300.0))
    slide.position = 0.501 * unit
    assert scene.start().a[0] == pytest.approx(-300.0 * (1e-3 - 5e-4) * unit, rel=1e-9)
    with pytest.raises(SceneError, match="a stop of one limit has no range to take the transition from"):
        scene.add_force(fm.force.JointStop(slide, 0.0, np.inf, 300.0))
    scene.add_force(fm.force.JointStop(slide, -0.5 * unit, np.inf, 300.0, transition=1e-3 * unit))


def test_a_start_beyond_a_stop():
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointStop(hinge, -0.5, 0.3, 1e3))
    hinge.position = 0.3005  # it may rest in its stop
    scene.start()
    hinge.position = 0.35
    with pytest.raises(SceneError, match=r"JointStop on joint 'hinge': the start at 0\.35 lies beyond"):
        scene.start()
