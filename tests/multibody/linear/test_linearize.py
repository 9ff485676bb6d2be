"""Linearised machines against closed forms, and against differences of the nonlinear equations of motion."""

from __future__ import annotations

from dataclasses import replace

import bicycle
import numpy as np
import pytest
from linear_machines import G, chain, loaded, loop, rotor
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.plan.compiled_scene import add_probe
from flexmbd.multibody.start.consistent_start import consistent_start
from flexmbd.run.input_values import evaluate_inputs


def test_a_hanging_chain_swings_at_the_zeros_of_laguerres_polynomial():
    """Daniel Bernoulli's: omega^2 = g/l times the zeros of L_n."""
    scene, joints = chain(5, length=0.7)
    joints[0].position, joints[3].position = 2.8, -1.0
    lin = scene.linearize(about=scene.equilibrium(stable=True))
    zeros = np.polynomial.laguerre.lagroots(np.eye(6)[5])
    expected = np.sqrt(G / 0.7 * zeros) / (2.0 * np.pi)
    np.testing.assert_allclose(lin.frequencies(), expected, rtol=1e-9)
    np.testing.assert_allclose(lin.damping_ratios(), 0.0, atol=1e-12)
    assert lin.coordinates == tuple(f"hinge {k}.angle" for k in range(5))


@pytest.mark.parametrize("speed", [0.0, 3.5, 5.0, 8.0])
def test_bicycle(speed):
    """M, C, K in roll and steer and the eigenvalues of Meijaard et al. 2007."""
    scene, _, steer = bicycle.bicycle(speed)
    lin = scene.linearize(inputs=[fm.force.JointTorque(steer, 1.0)])
    roll = [lin.velocities.index(name) for name in ("ride.wx", "steer.angle")]
    lean = [lin.coordinates.index(name) for name in ("ride.wx", "steer.angle")]
    stiffness = G * bicycle.K0 + speed**2 * bicycle.K2
    np.testing.assert_allclose(lin.M[np.ix_(roll, roll)], bicycle.M, rtol=1e-9)
    np.testing.assert_allclose(lin.C[np.ix_(roll, roll)], speed * bicycle.C1, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(lin.K[np.ix_(roll, lean)], stiffness, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(lin.V[roll, 0], [0.0, 1.0], atol=1e-12)
    rates = -np.linalg.solve(bicycle.M, np.hstack([stiffness, speed * bicycle.C1]))
    expected = np.linalg.eigvals(np.vstack([np.eye(4)[2:], rates]))
    found = lin.eigenvalues()
    assert len(found) == 10  # seven positions and three velocities, of which six are free
    np.testing.assert_array_equal(found[:6], 0.0)
    np.testing.assert_allclose(np.sort_complex(found[6:]), np.sort_complex(expected), rtol=1e-8)


def test_bicycle_at_the_published_digits():
    found = bicycle.bicycle(5.0)[0].linearize().eigenvalues()[6:]
    published = [-0.32286643, -0.77534188 + 4.46486771j, -0.77534188 - 4.46486771j, -14.07838969]
    np.testing.assert_allclose(found, published, atol=6e-9)
    still = bicycle.bicycle(0.0)[0].linearize().eigenvalues()[6:]
    np.testing.assert_allclose(np.sort(still.real), [-5.53094372, -3.13164325, 3.13164325, 5.53094372], atol=6e-9)


def test_bicycle_weaves_and_capsizes_at_the_published_speeds():
    """The weave's real part, and the capsize eigenvalue, change sign there."""
    for speed, which in ((4.29238253634111, "weave"), (6.02426201538837, "capsize")):
        found = bicycle.bicycle(speed)[0].linearize().eigenvalues()[6:]
        swings = np.abs(found.imag) > 1.0
        part = found[swings] if which == "weave" else found[~swings]
        assert np.abs(part.real).min() < 1e-11


def test_whirl_of_a_rotor():
    """A disc on a gimbal with springs: A w^2 -+ C spin w - k = 0."""
    across, along, stiffness, spin = 0.06, 0.1, 40.0, 30.0
    scene = fm.System()
    gimbal = scene.add(fm.RigidBody(1.0, (1e-12, 1e-12, 1e-12)), name="gimbal")
    disc = scene.add(fm.RigidBody(2.0, (across, across, along)), name="disc")
    tilt = scene.connect(fm.joint.Universal("x", "y"), scene.ground.frame(), gimbal.frame(), name="tilt")
    axle = scene.connect(fm.joint.Revolute("z"), gimbal.frame(), disc.frame(), name="axle")
    for k in range(2):
        scene.add_force(fm.force.JointSpring(tilt, stiffness, 0.0, 0.0, coordinate=k))
    axle.prescribe(lambda t: (spin * t, spin, 0.0))
    lin = scene.linearize()
    root = np.sqrt((0.5 * along * spin) ** 2 + across * stiffness)
    expected = np.sort([root - 0.5 * along * spin, root + 0.5 * along * spin]) / across
    np.testing.assert_allclose(2.0 * np.pi * lin.frequencies(), expected, rtol=1e-9)
    np.testing.assert_allclose(lin.C, -lin.C.T, atol=1e-12)


@pytest.mark.parametrize("spin", [15.0, 40.0])
def test_a_sleeping_top(spin):
    """On a spherical joint, whose coordinates turn with the top: A w^2 - C spin w + m g l = 0, seen from the top."""
    mass, arm, across, along = 1.5, 0.2, 0.03, 0.01
    scene = fm.System(gravity=(0.0, 0.0, -G))
    top = scene.add(fm.RigidBody(mass, (across, across, along), (0.0, 0.0, arm)), name="top")
    tip = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame(), name="tip")
    tip.velocity = [0.0, 0.0, spin]
    found = scene.linearize().eigenvalues()
    inertia = across + mass * arm**2
    nutation = np.roots([inertia, -along * spin, mass * G * arm]).astype(complex)
    seen = 1j * (nutation - spin)  # of exp(i w t) in axes that turn with the spin
    expected = np.concatenate([seen, seen.conj(), [0.0, 0.0]])
    key = np.lexsort((np.round(expected.imag, 6), np.round(expected.real, 6)))
    other = np.lexsort((np.round(found.imag, 6), np.round(found.real, 6)))
    np.testing.assert_allclose(found[other], expected[key], rtol=1e-8, atol=1e-8)


# the nonlinear machine that the linear one is held against






def compare(scene, lin, variant, outputs, *, step=2e-4, rtol=1e-8, idle=()):
    """A, B, C, D against differences of accelerations and kinematics of the nonlinear machine.

    ``variant(name, value)`` is a scene in which one input of V or W has that value more; outputs are (name of a
    body, place on it), of which position, velocity and acceleration are seen.
    """
    e, point = lin.equations, lin.point
    y, z = e.by.y, e.by.z
    names = [*lin.controls, *lin.disturbances]

    def state(name, dy, dz, value):
        changed = scene if name is None else variant(name, value)
        compiled = changed.compile().scene.keep_rows(
            [k for k, row in enumerate(changed.compile().scene.row_names) if row in lin.scene.row_names]
        )
        work = new_work(compiled.plan)
        evaluate_inputs(compiled, work, 0.0)
        near, move = np.empty_like(point.x), np.zeros(compiled.nv)
        move[y] = dy
        retract(compiled.plan, point.x, move, near)
        v = point.v.copy()
        v[z] += dz
        held_x, held_v = np.zeros((2, compiled.nv), bool)
        held_x[y], held_v[z] = True, True
        start = consistent_start(compiled, work, near, v, held_x=held_x, held_v=held_v)
        return np.concatenate([start.a[z], *(nonlinear_motion(start, frame(changed, *seen)) for seen in outputs)])

    def slope(name, dy, dz, value):
        parts = [state(name, k * step * dy, k * step * dz, k * step * value) for k in (1, -1, 2, -2)]
        return (8.0 * (parts[0] - parts[1]) - (parts[2] - parts[3])) / (12.0 * step)

    found = [slope(None, unit, 0.0 * point.v[z], 0.0) for unit in np.eye(len(y))]
    found += [slope(None, np.zeros(len(y)), unit, 0.0) for unit in np.eye(len(z))]
    found += [slope(name, np.zeros(len(y)), np.zeros(len(z)), 1.0) for name in names]
    A, B = lin._system
    C, D = lin._observed
    mine = np.hstack([np.vstack([A[len(y) :], C]), np.vstack([B[len(y) :], D])])
    expected = np.array(found).T
    error = np.abs(mine - expected) / (np.abs(expected).max(axis=1, keepdims=True) + 0.05)
    assert error.max() < rtol, (error.max(), np.unravel_index(error.argmax(), error.shape))
    acts = np.abs(expected[:, len(y) + len(z) :]).max(axis=0) > 1e-3
    assert [name for name, does in zip(names, acts, strict=True) if not does] == list(idle)


def frame(scene, name, place):
    return next(body for body in scene._bodies if body.name == name).frame(p=place)


def nonlinear_motion(start, frame):
    """(9,) position, velocity, acceleration."""
    plan, out = add_probe(start.scene, frame), np.zeros((1, 21))
    frame_series(plan, new_work(plan), len(plan.frames) - 1, start.x[None], start.v[None], start.a[None], out)
    return out[0, [0, 1, 2, 12, 13, 14, 18, 19, 20]]


def watch(frame):
    return [fm.output.Position(frame), fm.output.Velocity(frame), fm.output.Acceleration(frame)]


MOTIONS = {"motion of ": 0, "rate of motion of ": 1, "acceleration of motion of ": 2}


def moved(joint, name, value, base=0.0):
    """Let the prescribed motion ``name`` have a value beyond its own."""
    order = MOTIONS[name.removesuffix(joint.name)]
    values = np.array([base, 0.0, 0.0]) + value * np.eye(3)[order]
    joint.prescribe(lambda t: tuple(values))


def test_flexible_machine_against_differences():
    scene, guide, hinge, _, _, hand = loaded()
    torque, push = fm.force.JointTorque(hinge, 1.0), fm.force.FrameForce(hand.frame(p=(0.1, 0.0, 0.2)), (1.0, 2.0, 0.5))
    eq = scene.equilibrium()
    seen = ("hand", (0.2, 0.1, 0.0))
    lin = scene.linearize(about=eq, inputs=[torque, push], disturbances=[guide], outputs=watch(frame(scene, *seen)))
    assert lin.V.shape == (7, 2)
    assert lin.W.shape == (7, 3)

    def variant(name, value):
        other, guide, hinge, _, _, hand = loaded()
        if "motion" in name:
            moved(guide, name, value)
        elif "Torque" in name:
            other.add_force(fm.force.JointTorque(hinge, value))
        else:
            force = tuple(value * np.array([1.0, 2.0, 0.5]))
            other.add_force(fm.force.FrameForce(hand.frame(p=(0.1, 0.0, 0.2)), force))
        return other

    compare(scene, lin, variant, [seen])


@pytest.mark.parametrize("enforce", [None, fm.Penalty(3e3, 20.0)])
def test_loop_against_differences(enforce):
    """A closure's prescribed motion enters by the loop, or by a penalty; the reactions' change by the stiffness."""
    scene, hinge, lift, _ = loop(enforce)
    eq = scene.equilibrium(stable=True)
    assert enforce or np.abs(eq.multipliers).max() > 20.0
    seen = ("rod", (0.3, 0.0, 0.1))
    torque = fm.force.JointTorque(hinge, 1.0)
    lin = scene.linearize(about=eq, inputs=[torque], disturbances=[lift], outputs=watch(frame(scene, *seen)))
    assert lin.M.shape == ((4, 4) if enforce else (1, 1))

    def variant(name, value):
        other, hinge, lift, _ = loop(enforce)
        if "motion" in name:
            moved(lift, name, value, base=0.05)
        else:
            other.add_force(fm.force.JointTorque(hinge, value))
        return other

    compare(scene, lin, variant, [seen], idle=("acceleration of motion of lift",) if enforce else ())




def test_rotor_against_differences():
    """Coriolis and centrifugal terms, and the speed as an input."""
    scene, axle, flap, _ = rotor()
    eq = scene.equilibrium()
    lin = scene.linearize(about=eq, inputs=[fm.force.JointTorque(flap, 1.0)], disturbances=[axle])
    assert np.abs(lin.C - lin.C.T).max() > 0.1

    def variant(name, value):
        other, axle, flap, _ = rotor()
        if "motion" in name:
            order = MOTIONS[name.removesuffix("axle")]
            values = np.array([0.0, 3.0, 0.0]) + value * np.eye(3)[order]
            axle.prescribe(lambda t: tuple(values))
        else:
            other.add_force(fm.force.JointTorque(flap, value))
        return other

    # turning by an angle changes nothing
    assert not lin.W[:, 0].any() or np.abs(lin.W[:, 0]).max() < 1e-9 * np.abs(lin.W).max()
    compare(scene, lin, variant, [], idle=("motion of axle",))


def test_rolling_machine_against_differences():
    """The bicycle with a passenger's push and a swinging weight, at speed."""

    def riding(push=(0.0, 0.0, 0.0), torque=0.0):
        scene, body, steer = bicycle.bicycle(4.0)
        weight = scene.add(fm.RigidBody(3.0, (0.1, 0.1, 0.05), (0.0, 0.0, -0.4)), name="weight")
        swing = scene.connect(fm.joint.Revolute("x"), body.frame(p=(0.2, 0.0, 0.9)), weight.frame(), name="swing")
        scene.add_force(fm.force.JointSpring(swing, 3.0, 0.0, 0.2))
        scene.add_force(fm.force.FrameForce(body.frame(p=(0.3, 0.1, 1.2)), push))
        scene.add_force(fm.force.JointTorque(steer, torque))
        return scene, body, steer

    scene, body, steer = riding()
    push = fm.force.FrameForce(body.frame(p=(0.3, 0.1, 1.2)), (0.0, 1.0, 0.3))
    seen = ("frame", (0.2, 0.1, 0.4))
    torque = fm.force.JointTorque(steer, 1.0)
    lin = scene.linearize(inputs=[torque, push], outputs=watch(frame(scene, *seen)))
    assert lin.K.shape == (4, 8)

    def variant(name, value):
        push = value * np.array([0.0, 1.0, 0.3])
        return riding(torque=value)[0] if "Torque" in name else riding(push=tuple(push))[0]

    compare(scene, lin, variant, [seen])


def test_rotations_joints_and_modes_are_seen_as_they_move():
    """Each state alone: what the nonlinear machine's frame turns by, and where its own coordinates are."""
    scene, _, hinge, _, limb, hand = loaded()
    eq, place = scene.equilibrium(), hand.frame()
    kinds = (fm.output.Position, fm.output.Velocity, fm.output.Acceleration)
    outputs = [fm.output.Rotation(place), *(kind(of) for of in (hinge, limb) for kind in kinds)]
    lin = scene.linearize(about=eq, outputs=outputs)
    A, _, C, _ = lin.state_space()
    rows = {name: row for name, row in zip(lin.outputs, C, strict=True)}
    n, plan = len(lin.coordinates), lin.scene.plan
    R, step = eq.rotation(place), 1e-5
    for k, name in enumerate(lin.coordinates):
        turns, moved = [], []
        for sign in (1.0, -1.0):
            x = np.empty_like(eq.x)
            retract(plan, eq.x, sign * step * np.eye(lin.scene.nv)[lin.equations.by.y[k]], x)
            there = replace(eq, x=x)
            turns.append(Rotation.from_matrix(R.T @ there.rotation(place)).as_rotvec())
            moved.append(np.append(there.beta(hinge), there.q(limb)))
        found = np.array([rows[f"rotation {axis} of {place.label}"][k] for axis in "xyz"])
        np.testing.assert_allclose(found, (turns[0] - turns[1]) / (2.0 * step), atol=1e-8)
        own = ["hinge.angle", *(f"limb.q[{i}]" for i in range(3))]
        slopes = (moved[0] - moved[1]) / (2.0 * step)
        np.testing.assert_allclose([rows[f"position of {one}"][k] for one in own], slopes, atol=1e-9)
        np.testing.assert_allclose([rows[f"velocity of {one}"][n + k] for one in own], slopes, atol=1e-9)
        if name in own:
            np.testing.assert_allclose(rows[f"acceleration of {name}"], A[n + k], atol=1e-12 * np.abs(A).max())
    assert abs(C[:3]).max() > 0.5


def test_frequency_response_is_that_of_the_state_space():
    """Per displacement the response of accelerations over -omega^2."""
    scene, guide, hinge, _, limb, hand = loaded()
    outputs = [fm.output.Position(hand.frame()), fm.output.Position(limb), fm.output.Rotation(hand.frame())]
    torque = fm.force.JointTorque(hinge, 1.0)
    lin = scene.linearize(about=scene.equilibrium(), inputs=[torque], disturbances=[guide], outputs=outputs)
    omega = np.array([0.7, 5.0, 31.0])
    response = lin.frequency_response(omega)
    assert response.shape == (3, 9, 2)
    assert lin.drivers == ("JointTorque on joint 'hinge'", "motion of guide")
    A, B, C, D = lin.state_space()
    for s, found in zip(1j * omega, response, strict=True):
        expected = C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D
        np.testing.assert_allclose(found, expected * [1.0, s**2], rtol=1e-9, atol=1e-12)


def test_a_pseudo_rigid_block_on_a_pivot_against_differences():
    """It stretches under its weight; its own modes of the machine, and the pivot's turn."""

    def hung(torque=0.0):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        solid = fm.Solid.box((0.3, 0.1, 0.2), density=1000.0)
        block = fm.PseudoRigidBody(solid, fm.StVenantKirchhoff(E=2e4, nu=0.3), damping=0.05)
        scene.add(block, name="block")
        arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="arm")
        pivot = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), arm.frame(), name="pivot")
        scene.connect(fm.joint.Spherical(), arm.frame((0.0, 0.0, -0.4)), block.frame(solid.com), name="hook")
        corner = block.frame((0.1, 0.0, 0.1))
        scene.add_force(fm.force.SpringDamper(arm.frame((0.2, 0.0, 0.0)), corner, 300.0, 0.1, 0.5))
        scene.add_force(fm.force.SpringDamper(arm.frame((0.0, 0.2, 0.0)), corner, 200.0, 0.1, 0.5))
        scene.add_force(fm.force.JointTorque(pivot, torque))
        return scene, block, pivot

    scene, block, pivot = hung()
    eq = scene.equilibrium()
    assert np.abs(eq.q(block)).max() > 1e-4
    outputs = [fm.output.Velocity(block)]
    lin = scene.linearize(about=eq, inputs=[fm.force.JointTorque(pivot, 1.0)], outputs=outputs)
    assert lin.M.shape == (10, 10)
    compare(scene, replace(lin, equations=replace(lin.equations, outputs=())), lambda _, value: hung(value)[0], [])


def test_a_steered_bicycle_against_differences():
    """A prescribed steering angle, its rate and its acceleration enter by what rolls without slip."""
    scene, _, steer = bicycle.bicycle(4.0)
    moved(steer, "motion of steer", 0.0)
    seen = ("frame", (0.2, 0.1, 0.4))
    lin = scene.linearize(disturbances=[steer], outputs=watch(frame(scene, *seen)))
    assert lin.K.shape == (2, 6)

    def variant(name, value):
        other, _, steer = bicycle.bicycle(4.0)
        moved(steer, name, value)
        return other

    compare(scene, lin, variant, [seen])


def mass_chain(count, *, held, damping=0.0):
    """Masses of 2 kg in a row on springs of 50 N/m, held at one end or at none."""
    scene, before = fm.System(), None
    for n in range(count):
        mass = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name=f"mass {n}")
        scene.connect(fm.joint.Prismatic("x"), scene.ground.frame((float(n), 0, 0)), mass.frame())
        if before is not None:
            scene.add_force(fm.force.SpringDamper(before, mass.frame(), 50.0, 1.0, damping))
        elif held:
            scene.add_force(fm.force.SpringDamper(scene.ground.frame((-1.0, 0, 0)), mass.frame(), 50.0, 1.0, damping))
        before = mass.frame()
    return scene


def test_a_few_eigenvalues_of_many():
    """Of a chain held at one end: 2 sqrt(k / m) sin((2 j - 1) pi / (4 n + 2)), damped in proportion."""
    n, damping = 120, 0.4
    few = mass_chain(n, held=True, damping=damping).linearize().eigenvalues(modes=7)
    rate = 2.0 * 5.0 * np.sin((2.0 * np.arange(1, 5) - 1.0) * np.pi / (4.0 * n + 2.0))
    decay = damping / 50.0 * rate**2 / 2.0
    expected = -decay + 1j * np.sqrt(rate**2 - decay**2)
    np.testing.assert_allclose(few, np.ravel([expected, expected.conj()], order="F"), rtol=1e-9)  # 8: no pair is parted


def test_a_few_eigenvalues_of_what_is_free_to_move():
    """Two that are zero, of the whole chain's motion, as the root of round-off lets them be."""
    n = 110
    machine = mass_chain(n, held=False).linearize()
    few = machine.eigenvalues(modes=6)
    rates = 2.0 * 5.0 * np.sin(np.arange(1, 3) * np.pi / (2.0 * n))
    assert abs(few[:2]).max() < 1e-5
    np.testing.assert_allclose(few[2:], 1j * np.ravel([rates, -rates], order="F"), rtol=0, atol=1e-7)
    np.testing.assert_array_equal(mass_chain(3, held=True).linearize().eigenvalues(modes=99).shape, (6,))


@pytest.mark.parametrize("modes", [0, -3, 2.5, True, "all"])
def test_no_number_of_eigenvalues(modes):
    with pytest.raises(fm.errors.SceneError, match="modes"):
        mass_chain(3, held=True).linearize().eigenvalues(modes=modes)
