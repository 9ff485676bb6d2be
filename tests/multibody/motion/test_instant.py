"""One instant of a machine answers alike, whoever asks: an event, a trajectory, a working point, Kane's equations."""

import numpy as np
import pytest
from beam_records import Beam
from machines import slider_crank

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.force import Kinematics

MASS, ARM, J, G = 2.0, 0.5, 0.03, 9.81


def pendulum():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    bob = scene.add(fm.RigidBody(MASS, (J, J, J), (ARM, 0.0, 0.0)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), bob.frame())
    hinge.position, hinge.velocity = 0.4, 1.5
    return scene, hinge, bob.frame((ARM, 0.0, 0.0))


def at_start(scene):
    """The same instant as four callers have it."""
    seen = []
    watch = fm.Event(lambda moment: seen.append(moment) or 1.0)
    run = scene.simulate(1e-3, h=1e-3, integrator=fm.GeneralizedAlpha(), events=[watch])
    kane = Kinematics(run.scene).move(0.0, run.x[0], run.v[0], run.a[0])
    point = fm.WorkingPoint(run.scene, 0.0, run.x[0], run.v[0], run.multipliers[0])
    return run, [run.at(0.0), seen[0], kane, point]


def test_a_pendulum_moves_and_pulls_as_in_closed_form():
    scene, hinge, com = pendulum()
    run, instants = at_start(scene)
    beta, rate = 0.4, 1.5
    along, across = np.array([np.cos(beta), 0.0, -np.sin(beta)]), np.array([-np.sin(beta), 0.0, -np.cos(beta)])
    alpha = MASS * G * ARM * np.cos(beta) / (J + MASS * ARM**2)  # about y, which lowers the bob
    for instant in instants:
        np.testing.assert_allclose(instant.position(com), ARM * along, atol=1e-15)
        np.testing.assert_allclose(instant.velocity(com), ARM * rate * across, atol=1e-15)
        np.testing.assert_allclose(instant.angular_velocity(com), [0.0, rate, 0.0], atol=1e-15)
        np.testing.assert_allclose(instant.rotation(com) @ [1.0, 0.0, 0.0], along, atol=1e-15)
        assert (instant.beta(hinge), instant.beta_rate(hinge)) == (beta, rate)
    for instant in instants[:3]:
        np.testing.assert_allclose(instant.angular_acceleration(com), [0.0, alpha, 0.0], atol=1e-13)
        expected = ARM * alpha * across - ARM * rate**2 * along
        np.testing.assert_allclose(instant.acceleration(com), expected, atol=1e-13)
    pull = MASS * (ARM * alpha * across - ARM * rate**2 * along + [0.0, 0.0, G])
    R = instants[0].rotation(com)
    for instant in instants[:2]:
        np.testing.assert_allclose(instant.reaction(hinge), [*(R.T @ pull), 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(instants[0].reaction(hinge), run.reaction(hinge)[0])


def test_reactions_between_the_ends_of_steps_of_a_tree():
    """The pull of a pendulum in closed form, of what the instant itself says of its motion."""
    scene, hinge, com = pendulum()
    run = scene.simulate(0.5, rtol=1e-10)
    for t in 0.5 * (run.t[3:8] + run.t[4:9]):
        instant = run.at(t)
        pull = MASS * (instant.acceleration(com) + np.array([0.0, 0.0, G]))
        np.testing.assert_allclose(instant.reaction(hinge)[:3], instant.rotation(com).T @ pull, atol=1e-12 * MASS * G)


def rigid_slider_crank():
    """Planar, of joints in space: three of its five rows are redundant."""
    scene, _, crank = slider_crank(axis="y")
    crank.velocity = 20.0
    return scene, [crank, *scene.compile().scene.index.closures]


def elastic_slider_crank():
    """A bent beam on two balls between crank and slider."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    crank = scene.add(fm.RigidBody(0.9, (4e-4, 6e-4, 8e-4), (0.02, 0.0, 0.0)), name="crank")
    beam = scene.add(Beam(0.3, 0.02, 0.03, 2e11, 7800.0, 3, 0.02, "a").build(), name="beam")
    slider = scene.add(fm.RigidBody(0.5, (2e-4, 2e-4, 2e-4)), name="slider")
    turn = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), crank.frame())
    big = scene.connect(fm.joint.Spherical(), crank.frame((0.08, 0.0, 0.0)), beam.frame("a"))
    small = scene.connect(fm.joint.Spherical(), beam.frame("b"), slider.frame())
    guide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame())
    turn.position, turn.velocity = 0.3, 20.0
    return scene, [turn, big, small, guide]


@pytest.mark.parametrize("machine", [rigid_slider_crank, elastic_slider_crank])
def test_reactions_between_the_ends_of_steps_of_loops(machine):
    """Those of a run that ends there; redundant joints share the load by the smallest multipliers."""
    scene, joints = machine()
    run = scene.simulate(0.03, rtol=1e-9)
    for k in (2, len(run.t) // 2, len(run.t) - 4):
        t = float(0.4 * run.t[k] + 0.6 * run.t[k + 1])
        there, others = machine()
        exact = there.simulate(t, rtol=1e-9)
        wanted = np.array([exact.reaction(joint)[-1] for joint in others])
        found = np.array([run.at(t).reaction(joint) for joint in joints])
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


def test_what_is_not_there_is_told_alike():
    scene, hinge, com = pendulum()
    run, instants = at_start(scene)
    _, foreign, elsewhere = pendulum()
    for one in [run, *instants]:
        with pytest.raises(SceneError, match="has no joint coordinate here: it closes a loop, or belongs to another"):
            one.beta(foreign)
        with pytest.raises(SceneError, match="'bob' has no modal coordinates here"):
            one.q(com.body)
        with pytest.raises(SceneError, match="belongs to no body of this scene"):
            one.position(elsewhere)
    with pytest.raises(SceneError, match=r"reaction of joint .* is not known: nobody has solved for it there"):
        instants[2].reaction(hinge)
    with pytest.raises(SceneError, match="outside the trajectory"):
        run.at(1.0)
    for wrong in (np.nan, "0.0", False, [0.0, 0.0]):
        with pytest.raises(SceneError, match="t must be one time in s, got"):
            run.at(wrong)
    for wrong in (np.nan, "0.0", False, [], [0.0, np.inf], [[0.0]]):
        with pytest.raises(SceneError, match=r"t must be a time, or an array .* of times, in s, got"):
            run.position(com, t=wrong)


def test_kane_s_motion_goes_on_with_frames_asked_before():
    scene, hinge, com = pendulum()
    compiled = scene.compile().scene
    kinematics = Kinematics(compiled)
    for beta in (0.0, 1.0, -0.7):
        kinematics.move(0.0, np.array([beta]), np.zeros(1))
        place = ARM * np.array([np.cos(beta), 0.0, -np.sin(beta)])
        np.testing.assert_allclose(kinematics.position(com), place, atol=1e-15)
        assert kinematics.beta(hinge) == beta
