"""What cannot be linearised is refused, and the message names it; equilibria are found, or it is said where not."""

from __future__ import annotations

import numpy as np
import pytest
from linear_machines import G, chain, loaded, loop, rotor
from machines import pendulum

import flexmbd as fm
from flexmbd.errors import SceneError


def two_bladed(spin=20.0):
    """A rotor of unequal moments of inertia on a gimbal: its equations change as it turns."""
    scene = fm.System()
    gimbal = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="gimbal")
    blades = scene.add(fm.RigidBody(2.0, (0.02, 0.09, 0.1)), name="blades")
    tilt = scene.connect(fm.joint.Universal("x", "y"), scene.ground.frame(), gimbal.frame(), name="tilt")
    axle = scene.connect(fm.joint.Revolute("z"), gimbal.frame(), blades.frame(), name="axle")
    for k in range(2):
        scene.add_force(fm.force.JointSpring(tilt, 40.0, 0.0, 0.0, coordinate=k))
    axle.prescribe(lambda t: (spin * t, spin, 0.0))
    return scene


def flat_four_bar():
    """A parallelogram all of whose bars lie in one line, where it may go on as either of two mechanisms."""
    scene = fm.System()
    turn, end, bars = fm.joint.Revolute("y"), scene.ground.frame(), []
    for name, length in (("crank", 0.3), ("rod", 0.5), ("rocker", -0.3)):
        bar = scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.02), (0.5 * length, 0.0, 0.0)), name=name)
        bars.append(scene.connect(turn, end, bar.frame(), name=f"at {name}"))
        end = bar.frame(p=(length, 0.0, 0.0))
    scene.connect(turn, end, scene.ground.frame(p=(0.5, 0.0, 0.0)), name="closing")
    return scene, bars


def refusal(call):
    with pytest.raises(SceneError) as caught:
        call()
    return str(caught.value)


def test_what_is_not_in_balance_is_named_with_its_residual():
    scene, _, hinge = pendulum()
    said = refusal(scene.linearize)
    assert "not steady" in said
    assert hinge.name in said
    assert "9.81" in said  # m g l


def test_a_prescribed_acceleration_is_named():
    scene, _, hinge = pendulum()
    hinge.position = 0.0
    hinge.prescribe(lambda t: (t**2, 2.0 * t, 2.0))
    said = refusal(scene.linearize)
    assert "acceleration of 2" in said
    assert hinge.name in said


def test_equations_that_change_along_the_motion_are_refused():
    said = refusal(two_bladed().linearize)
    assert "changes" in said
    assert "tilt" in said
    two_bladed(0.0).linearize()


def test_outputs_that_change_along_the_motion_are_refused():
    scene, _, _, blade = rotor()
    eq = scene.equilibrium()
    said = refusal(lambda: scene.linearize(about=eq, outputs=[fm.output.Position(blade.frame("tip"))]))
    assert "blade.tip" in said
    scene.linearize(about=eq, outputs=[fm.output.Velocity(blade)])


def test_singular_constraints_are_named():
    scene, bars = flat_four_bar()
    said = refusal(scene.linearize)
    assert "singular" in said
    assert "closing" in said
    bars[0].position, bars[1].position, bars[2].position = 0.6, -0.6, 0.6
    assert len(scene.linearize().M) == 1


@pytest.mark.parametrize(
    ("port", "word"),
    [
        (lambda scene, joint: fm.force.JointSpring(joint, 1.0, 0.0, 0.0), "follows the machine's state"),
        (lambda scene, joint: joint, "prescribe"),
        (lambda scene, joint: pendulum()[2], "not in this scene"),
        (lambda scene, joint: fm.force.JointTorque(pendulum()[2], 1.0), "not in this scene"),
        (lambda scene, joint: fm.force.FrameForce(joint.child, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "does nothing"),
        (lambda scene, joint: fm.force.FrameForce(scene.ground.frame(), (1.0, 0.0, 0.0)), "does nothing"),
        (lambda scene, joint: fm.force.FrameForce(joint.child, (1.0, 0.0, 0.0)), "does nothing"),
        (lambda scene, joint: "torque", "an input must be a force element"),
    ],
)
def test_bad_inputs(port, word):
    scene, joints = chain(2)
    assert word in refusal(lambda: scene.linearize(inputs=[port(scene, joints[0])]))


@pytest.mark.parametrize(
    ("output", "word"),
    [
        (lambda scene, joints: "angle", "not an output"),
        (lambda scene, joints: joints[0], "not an output"),
        (lambda scene, joints: fm.output.Position(pendulum()[2]), "no coordinates"),
        (lambda scene, joints: fm.output.Position(pendulum()[1].frame()), "no body of this scene"),
        (lambda scene, joints: fm.output.Rotation(joints[0]), "give a frame"),
        (lambda scene, joints: fm.output.Position(scene), "give a frame"),
    ],
)
def test_bad_outputs(output, word):
    scene, joints = chain(2)
    assert word in refusal(lambda: scene.linearize(outputs=[output(scene, joints)]))


def test_joints_held_by_constraints_have_no_coordinates_to_observe():
    scene, _, lift, _ = loop()
    eq = scene.equilibrium()
    assert "held by constraints" in refusal(lambda: scene.linearize(about=eq, outputs=[fm.output.Position(lift)]))


def test_another_scenes_equilibrium():
    other = chain(3)[0].equilibrium()
    assert "another scene" in refusal(lambda: chain(2)[0].linearize(about=other))


def test_nothing_balances_a_body_that_falls():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)), name="ball")
    scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame(), name="chute")
    said = refusal(scene.equilibrium)
    assert "chute" in said
    assert "-19.62" in said


def test_equilibria_in_closed_form():
    """A weight on a spring and a hinge sprung against a weight: m g = k x, and k beta = m g l sin(beta)."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)), name="ball")
    chute = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame(), name="chute")
    scene.add_force(fm.force.JointSpring(chute, 800.0, 0.0, 0.0))
    assert scene.equilibrium().beta(chute) == pytest.approx(-2.0 * G / 800.0, rel=1e-12)

    scene = fm.System(gravity=(0.0, 0.0, -G))
    mast = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1), (0.0, 0.0, 1.0)), name="mast")
    foot = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), mast.frame(), name="foot")
    scene.add_force(fm.force.JointSpring(foot, 15.0, 0.0, 0.0))
    foot.position = 0.01  # beside the upright, which is unstable: 15 < m g l
    beta = scene.equilibrium().beta(foot)
    assert beta > 0.5
    assert 15.0 * beta == pytest.approx(2.0 * G * np.sin(beta), rel=1e-12)


def test_loops_and_quaternions_settle_where_their_energy_is_least():
    """From far away, a flexible machine and a loop: nothing accelerates, and no shift lowers the energy."""
    for scene in (loaded()[0], loop()[0]):
        eq = scene.equilibrium()
        lin = scene.linearize(about=eq)
        assert np.linalg.eigvalsh(0.5 * (lin.K + lin.K.T)).min() > 0.0
        assert lin.eigenvalues().real.max() < 1e-9


def test_a_steady_motion_may_be_the_end_of_a_simulation():
    """A damped pendulum that was let swing out."""
    scene, joints = chain(1)
    scene.add_force(fm.force.JointDamper(joints[0], 5.0))
    joints[0].position = 0.2
    run = scene.simulate(12.0, rtol=1e-9)
    found = scene.linearize(about=run).eigenvalues()
    expected = np.roots([1.3, 5.0, 1.3 * G])
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-6)


def test_a_mode_as_a_motion():
    """The slow mode of a chain: in step, at its own frequency, of the size asked for; and it can be filmed."""
    scene, joints = chain(3)
    lin = scene.linearize()
    run = lin.mode_motion(0, amplitude=0.2, periods=2.0, instants=201)
    first = lin.frequencies()[0]
    assert run.t[-1] == pytest.approx(2.0 / first)
    angles = np.array([run.beta(joint) for joint in joints])
    assert np.abs(angles).max() == pytest.approx(0.2, rel=1e-3)
    np.testing.assert_allclose(angles[:, 100], angles[:, 0], atol=1e-10)
    vibration = lin.M @ run.a.T + lin.K @ angles
    assert np.abs(vibration).max() < 1e-10 * np.abs(lin.K @ angles).max()
    np.testing.assert_allclose(run.beta_rate(joints[2]), np.gradient(angles[2], run.t, edge_order=2), atol=1e-3)


def test_modes_that_do_not_swing_and_those_that_are_not_there():
    scene, _, hinge = pendulum()
    hinge.position = 0.5 * np.pi  # upright
    lin = scene.linearize()
    run = lin.mode_motion(1)
    assert run.t[-1] == pytest.approx(1.0 / np.sqrt(G), rel=1e-6)
    assert "not 2" in refusal(lambda: lin.mode_motion(2))
    free = fm.System()
    ball = free.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)), name="ball")
    free.connect(fm.joint.Prismatic("z"), free.ground.frame(), ball.frame())
    assert "zero" in refusal(lambda: free.linearize().mode_motion(0))


def test_inputs_beside_friction_that_follows_the_reaction():
    """The reaction follows the input at once; by itself the chain is damped."""
    scene, joints = chain(1)
    scene.add_force(fm.force.BearingFriction(joints[0], 0.2, 0.1, radius=0.05))
    assert "follows the machine's accelerations" in refusal(
        lambda: scene.linearize(inputs=[fm.force.JointTorque(joints[0], 1.0)])
    )
    assert (scene.linearize().eigenvalues().real < -1e-3).all()


def test_a_force_of_several_functions_is_as_many_inputs():
    """Each component by a function of time has a column of its own, beside the one of what is given by numbers."""
    scene, joints = chain(1)
    end = joints[0].child.body.frame(p=(0.0, 0.0, -1.0))
    push = fm.force.FrameForce(end, (lambda t: 7.0, 0.0, lambda t: 0.0), (0.0, 3.0, 0.0))
    lin = scene.linearize(inputs=[push, fm.force.JointTorque(joints[0], 0.0)])
    np.testing.assert_allclose(lin.V, [[3.0, -1.0, 0.0, 1.0]], atol=1e-12)
    assert len(set(lin.controls)) == 4
