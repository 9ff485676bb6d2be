"""Kane's equations against the recursion, and forces that users give through them."""

from __future__ import annotations

import numpy as np
import pytest
from machines import slider_crank
from mixed_machine import GRAVITY, mixed_scene
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kane.equations import Kinematics, active_forces, elastic_forces, inertia_forces
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.motion.reaction import reactions as reactions_of
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian
from flexmbd.run.stopped import SimulationError


def moving(compiled, seed):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * 0.5, x)
    v, a = rng.standard_normal((2, compiled.nv))
    return x, v, a


def residual_of(compiled, x, v, a, multipliers):
    out = np.zeros(compiled.nv)
    residual(compiled.plan, new_work(compiled.plan), x, v, a, multipliers, out)
    return out


def test_partial_velocities_are_slopes_of_the_motion():
    """v_r and w_r of frames on rigid bodies and at flexible tips, by differences of their poses."""
    scene, bodies, _, _ = mixed_scene()
    compiled = scene.compile().scene
    x, v, _ = moving(compiled, 0)
    frames = [bodies[1].frame("tip"), bodies[3].frame("tip"), bodies[5].frame(p=(0.1, 0.2, 0.3))]
    here, other = Kinematics(compiled).move(0.0, x, v), Kinematics(compiled)
    linear, angular = here.partial_velocities(frames)
    h = 1e-3
    for r, unit in enumerate(np.eye(compiled.nv)):
        for k, frame in enumerate(frames):
            shift, turn = np.zeros(3), np.zeros(3)
            for step, weight in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0)):
                for sign in (-1.0, 1.0):
                    place = np.empty_like(x)
                    retract(compiled.plan, x, sign * step * h * unit, place)
                    other.move(0.0, place, v)
                    shift += sign * weight * other.position(frame) / h
                    back = other.rotation(frame) @ here.rotation(frame).T
                    turn += sign * weight * Rotation.from_matrix(back).as_rotvec() / h
            np.testing.assert_allclose(linear[k, :, r], shift, atol=1e-9)
            np.testing.assert_allclose(angular[k, :, r], turn, atol=1e-9)
    for k, frame in enumerate(frames):
        np.testing.assert_allclose(linear[k] @ v, here.velocity(frame), atol=1e-12)
        np.testing.assert_allclose(angular[k] @ v, here.angular_velocity(frame), atol=1e-12)


@pytest.mark.parametrize("rotors", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_kane_is_the_recursion(seed, rotors):
    """F_r + F*_r - C^T nu = -residual on a machine of all joints, rigid and flexible, with loops and rotors inside."""
    scene, bodies, _, _ = mixed_scene(rotors=rotors)
    compiled = scene.compile().scene
    x, v, a = moving(compiled, seed)
    rng = np.random.default_rng(seed + 10)
    load = rng.standard_normal((2, 2, 3))
    ends = [bodies[1].frame("tip"), bodies[5].frame(p=(0.1, 0.2, 0.3))]
    for frame, (force, torque) in zip(ends, load, strict=True):
        scene.add_force(fm.force.FrameForce(frame, tuple(force), tuple(torque)))
    loaded = scene.compile().scene
    nu = rng.standard_normal(len(loaded.plan.rows))
    assert len(nu) > 10
    kinematics = Kinematics(loaded).move(0.0, x, v, a)
    active = active_forces(kinematics, [(f, *pair) for f, pair in zip(ends, load, strict=True)])
    total = active + elastic_forces(kinematics, loaded) + inertia_forces(kinematics, GRAVITY)
    total -= constraint_jacobian(loaded, new_work(loaded.plan), x).T @ nu
    expected = -residual_of(loaded, x, v, a, nu)
    np.testing.assert_allclose(total, expected, atol=1e-12 * np.abs(expected).max())


def test_the_motion_of_a_loop_fulfils_kane():
    """At the start of a slider-crank with a rigid rod: F_r + F*_r = C^T nu."""
    scene, _, j1 = slider_crank()
    j1.velocity = 30.0
    j1.position = 0.7
    start = scene.start()
    kinematics = Kinematics(start.scene).move(0.0, start.x, start.v, start.a)
    total = inertia_forces(kinematics, scene.gravity)
    reaction = constraint_jacobian(start.scene, new_work(start.scene.plan), start.x).T @ start.multipliers
    assert np.abs(reaction).max() > 1.0
    np.testing.assert_allclose(total, reaction, atol=1e-10 * np.abs(total).max())


def test_one_sweep_gives_the_forces_of_the_definition():
    scene, bodies, _, _ = mixed_scene()
    compiled = scene.compile().scene
    x, v, _ = moving(compiled, 4)
    rng = np.random.default_rng(3)
    frames = [bodies[1].frame("tip"), scene.ground.frame(), bodies[4].frame(p=(0.1, 0.0, 0.2)), bodies[1].frame("tip")]
    loads = [(frame, *rng.standard_normal((2, 3))) for frame in frames]
    kinematics = Kinematics(compiled).move(0.0, x, v)
    expected = active_forces(kinematics, loads)
    np.testing.assert_allclose(kinematics.generalised_forces(loads), expected, atol=1e-12 * np.abs(expected).max())


def test_a_spring_by_kane_is_the_spring_element():
    """The law of a point-to-point spring and damper written by hand, at a flexible tip."""
    runs = []
    for by_hand in (True, False):
        scene = fm.System()
        body = scene.add(fm.FlexibleBody(particle_body(5, modes=3).record), name="body")
        hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root"))
        hinge.velocity = 1.0
        ends = scene.ground.frame(p=(1.0, 0.5, 0.0)), body.frame("tip")

        def pull(motion, ends=ends):
            d = motion.position(ends[1]) - motion.position(ends[0])
            length = np.linalg.norm(d)
            rate = d @ (motion.velocity(ends[1]) - motion.velocity(ends[0])) / length
            force = -(40.0 * (length - 0.8) + 2.0 * rate) * d / length
            return [(ends[1], force, np.zeros(3)), (ends[0], -force, np.zeros(3))]

        scene.add_force(fm.force.KaneForce(pull) if by_hand else fm.force.SpringDamper(*ends, 40.0, 0.8, 2.0))
        runs.append(scene.simulate(0.3, h=2e-3))
    assert np.ptp(runs[0].x[:, 1]) > 1e-3
    np.testing.assert_allclose(runs[0].x, runs[1].x, atol=1e-9)


def test_a_gyrostat_turns_as_its_closed_form():
    """An axisymmetric body with a rotor h along its axis: w across turns at ((C - A) w3 + h) / A in the body.

    The rotor is a user-defined body: its mass is in the rigid body's, and what its spin adds to inertia, w x h, is
    given through partial angular velocities.
    """
    A, C, h = 0.3, 0.5, 0.8
    scene = fm.System()
    body = scene.add(fm.RigidBody(2.0, (A, A, C)), name="satellite")
    socket = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    socket.velocity = (0.4, 0.0, 1.0)

    def rotor(motion):
        spin = h * motion.rotation(body.frame())[:, 2]
        return [(body.frame(), np.zeros(3), -np.cross(motion.angular_velocity(body.frame()), spin))]

    scene.add_force(fm.force.KaneForce(rotor))
    run = scene.simulate(2.0, rtol=1e-7)
    rate = ((C - A) * 1.0 + h) / A
    exact = np.column_stack([0.4 * np.cos(rate * run.t), 0.4 * np.sin(rate * run.t), np.ones_like(run.t)])
    np.testing.assert_allclose(run.beta_rate(socket), exact, atol=3e-6)
    momentum = np.einsum("tij,tj->ti", run.rotation(body.frame()), run.beta_rate(socket) * [A, A, C] + [0.0, 0.0, h])
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(run.t), 1)), atol=1e-5)


def test_kinematics_know_joints_and_modes():
    scene, bodies, _, _ = mixed_scene()
    compiled = scene.compile().scene
    x, v, _ = moving(compiled, 5)
    kinematics = Kinematics(compiled).move(0.7, x, v)
    hinge, flexible = scene._connections[1], bodies[1]
    slots, modes = compiled.index.joints[hinge], compiled.index.modes[flexible]
    assert kinematics.t == 0.7
    np.testing.assert_array_equal(kinematics.beta(hinge), x[slots.x])
    np.testing.assert_array_equal(kinematics.beta_rate(hinge), v[slots.v])
    np.testing.assert_array_equal(kinematics.q(flexible), x[modes.x])
    np.testing.assert_array_equal(kinematics.q_rate(flexible), v[modes.v])
    with pytest.raises(SceneError, match="has no joint coordinate"):
        kinematics.beta(scene._connections[-1])
    with pytest.raises(SceneError, match="no modal coordinates"):
        kinematics.q(bodies[0])


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (lambda frame: [(fm.RigidBody(1.0, (1, 1, 1), name="stray").frame(), np.zeros(3), np.zeros(3))], "stray"),
        (lambda frame: [(frame, (0.0, np.nan, 0.0), np.zeros(3))], "the force on disc must be three finite numbers"),
        (lambda frame: [(frame, np.zeros(3), 1.0)], "the torque on disc must be three finite numbers"),
        (lambda frame: 3.0, "not iterable"),
    ],
)
def test_a_kane_force_that_fails_says_which_and_when(load, message):
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (0.25, 0.25, 0.25)), name="disc")
    scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame())

    def thrust(motion):
        return load(disc.frame()) if motion.t > 0.2 else [(disc.frame(), np.zeros(3), np.array([0.0, 0.0, 1.0]))]

    scene.add_force(fm.force.KaneForce(thrust))
    with pytest.raises(SimulationError, match=rf"KaneForce 'thrust' at t = 0\.2.*{message}") as caught:
        scene.simulate(1.0)
    assert 0.1 < caught.value.trajectory.t[-1] <= 0.2
    with pytest.raises(SceneError, match="KaneForce '': float is not a function"):
        scene.add_force(fm.force.KaneForce(1.0))


def test_joints_bear_forces_by_kane():
    """Reactions of joints of all kinds, with forces given by frames and by Kane."""
    rng = np.random.default_rng(7)
    loads = rng.standard_normal((3, 2, 3))
    reactions = []
    for kane in (False, True):
        scene, bodies, _, loops = mixed_scene()
        joints = [c for c in scene._connections if c not in loops]
        frames = [bodies[1].frame("tip"), bodies[3].frame(), bodies[5].frame(p=(0.1, 0.2, 0.3))]
        if kane:
            given = [(f, *load) for f, load in zip(frames, loads, strict=True)]
            scene.add_force(fm.force.KaneForce(lambda m, given=given: given, name="loads"))
        else:
            for frame, load in zip(frames, loads, strict=True):
                scene.add_force(fm.force.FrameForce(frame, *map(tuple, load)))
        compiled = scene.compile().scene
        x, v, a = (part[None] for part in moving(compiled, 3))
        nu = np.random.default_rng(8).standard_normal((1, len(compiled.plan.rows)))
        times = np.zeros(1)
        reactions.append([reactions_of(compiled, joint, times, x, v, a, nu) for joint in joints])
    assert len(reactions[0]) == 6
    np.testing.assert_allclose(reactions[1], reactions[0], atol=1e-11 * np.abs(reactions[0]).max())


@pytest.mark.parametrize("backwards", [False, True])
def test_a_hinge_run_from_child_to_parent_bears_forces_by_kane(backwards):
    """A sideways force on a bob, in inertial axes; on the ground as the joint's child the opposite."""
    scene = fm.System()
    bob = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="bob")
    ends = [scene.ground.frame(), bob.frame()]
    pin = scene.connect(fm.joint.Revolute("z"), *(ends[::-1] if backwards else ends))
    tip = bob.frame(p=(0.5, 0.0, 0.0))
    scene.add_force(fm.force.KaneForce(lambda m: [(tip, [3.0, 0.0, 2.0], [0.5, 0.0, 0.0])], name="push"))
    run = scene.simulate(0.01, h=0.01)
    on_bob = np.array([-3.0, 0.0, -2.0, -0.5, 1.0, 0.0])
    np.testing.assert_allclose(run.reaction(pin)[0], -on_bob if backwards else on_bob, atol=1e-12)
