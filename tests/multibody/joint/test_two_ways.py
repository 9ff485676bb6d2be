"""Every joint by coordinates and by constraints: the same motion and the same reactions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm

GRAVITY = (0.4, -1.1, -9.81)
TILT = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
BALL = np.array([0.9, 0.1, -0.3, 0.2]) / np.sqrt(0.95)

# joint, initial position and velocity
JOINTS = {
    "revolute": (fm.joint.Revolute((1.0, 2.0, -1.0)), [0.4], [1.5]),
    "prismatic": (fm.joint.Prismatic((1.0, -0.5, 1.0)), [0.1], [0.6]),
    "screw": (fm.joint.Screw(0.05, (1.0, 0.3, -1.0)), [0.4], [2.5]),
    "cylindrical": (fm.joint.Cylindrical((1.0, 2.0, 0.5)), [0.1, 0.3], [0.4, 2.0]),
    "planar": (fm.joint.Planar((1.0, 2.0, 0.5)), [0.1, -0.2, 0.3], [0.4, 0.2, 2.0]),
    "planar_point": (fm.joint.PlanarPoint((1.0, 2.0, 0.5)), [0.1, -0.2], [0.4, 0.2]),
    "translation": (fm.joint.Translation(), [0.1, -0.2, 0.3], [0.4, 0.2, -0.6]),
    "universal": (fm.joint.Universal("x", (0.0, 1.0, 1.0)), [0.3, -0.4], [1.0, 1.4]),
    "spherical": (fm.joint.Spherical(), BALL, [1.0, -0.6, 1.4]),
    "fixed": (fm.joint.Fixed(), [], []),
    "free": (fm.joint.Free(), [0.1, -0.2, 0.3, *BALL], [0.3, 0.5, -0.1, 1.0, -0.6, 1.4]),
}


def machine(name, *, reverse=False, **choice):
    """A swinging carrier, a body on it by the joint in question, and a pendulum on that body."""
    joint, position, velocity = JOINTS[name]
    scene = fm.System(gravity=GRAVITY)
    carrier = scene.add(fm.RigidBody(1.3, np.diag([0.05, 0.06, 0.07]), (0.2, 0.05, -0.1)), name="carrier")
    body = scene.add(fm.RigidBody(0.9, np.diag([0.02, 0.03, 0.04]), (0.1, 0.05, -0.02)), name="body")
    bob = scene.add(fm.RigidBody(0.3, np.diag([0.01, 0.012, 0.015]), (0.0, 0.2, 0.1)), name="bob")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), carrier.frame())
    hinge.velocity = 1.2
    ends = [carrier.frame(p=(0.4, 0.1, 0.0), R=TILT), body.frame(p=(-0.1, 0.05, 0.02), R=TILT.T)]
    studied = scene.connect(joint, *(ends[::-1] if reverse else ends), name="studied", **choice)
    if len(position):
        studied.position, studied.velocity = position, velocity
    swing = scene.connect(fm.joint.Revolute("x"), body.frame(p=(0.2, 0.0, 0.0)), bob.frame())
    swing.velocity = -0.8
    return scene, (carrier, body, bob), (hinge, studied, swing)


def states(run, bodies):
    """Position, rotation, velocity and angular velocity of all bodies, (nt, k)."""
    parts = []
    for body in bodies:
        frame = body.frame()
        parts += [run.position(frame), run.rotation(frame).reshape(-1, 9)]
        parts += [run.velocity(frame), run.angular_velocity(frame), run.acceleration(frame)]
    return np.hstack(parts)



@pytest.mark.parametrize("reverse", [False, True], ids=["", "reversed"])
@pytest.mark.parametrize("name", JOINTS)
def test_start(name, reverse):
    """Accelerations and reactions of the start, where nothing is integrated, agree to round-off."""
    runs = []
    for way in (fm.Way.COORDINATES, fm.Way.CONSTRAINTS):
        if reverse and not JOINTS[name][0].reversible:  # type: ignore[attr-defined]
            return  # such a joint cannot be turned round along the tree
        scene, bodies, joints = machine(name, reverse=reverse, way=way)
        run = scene.simulate(1e-6, h=1e-6)
        runs.append((states(run, bodies)[0], *(run.reaction(j)[0] for j in joints)))
        assert (len(scene.compile().scene.plan.rows) > 0) == (way is fm.Way.CONSTRAINTS and name != "free")
    for part, other in zip(*runs, strict=True):
        np.testing.assert_allclose(other, part, atol=3e-12 * max(1.0, np.abs(part).max()))
    assert np.abs(runs[0][2]).max() > 0.1 or name == "free"


@pytest.mark.parametrize("name", JOINTS)
def test_trajectory(name):
    """The same end state and reactions, each way to its own error, which is below 3e-7."""
    ends = []
    for way in (fm.Way.COORDINATES, fm.Way.CONSTRAINTS):
        scene, bodies, joints = machine(name, way=way)
        run = scene.simulate(0.2, rtol=1e-8)
        ends.append((states(run, bodies)[-1], *(run.reaction(j)[-1] for j in joints)))
        assert run.stats.constraint_residual < 1e-10
    for part, other in zip(*ends, strict=True):
        np.testing.assert_allclose(other, part, atol=3e-7 * max(1.0, np.abs(part).max()))


def test_reaction_of_a_hanging_weight():
    """At rest the support carries the weight: 2 kg, 0.3 m out, 9.81 m/s^2, in the child's axes."""
    for way in fm.Way:
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1), (0.3, 0.0, 0.0)), name="weight")
        turned = Rotation.from_euler("z", 90, degrees=True).as_matrix()
        held = scene.connect(fm.joint.Fixed(), scene.ground.frame(R=turned), body.frame(R=turned), way=way)
        reaction = scene.simulate(1e-3, h=1e-3).reaction(held)
        # in world axes force (0, 0, mg) and moment (0.3, 0, 0) x force = (0, -0.3 mg, 0)
        expected = np.array([0.0, 0.0, 1.0, -0.3, 0.0, 0.0]) * 2.0 * 9.81
        np.testing.assert_allclose(reaction, [expected, expected], atol=1e-10)


@pytest.mark.parametrize("name", ["revolute", "screw", "universal"])
def test_penalty_yields_by_one_over_its_stiffness(name):
    """Ten times the stiffness leaves a tenth of the difference from the exact motion and reaction."""

    def end(**choice):
        scene, bodies, joints = machine(name, **choice)
        run = scene.simulate(0.25, rtol=1e-7, integrator=fm.GeneralizedAlpha())
        assert len(scene.compile().scene.plan.rows) == 0
        return run.position(bodies[2].frame())[-1], run.reaction(joints[1])[-1]

    exact = end()
    gaps = []
    for stiffness in (1e4, 1e5):
        # well damped, so that the start, which knows nothing of the load, has died away
        place, reaction = end(enforce=fm.Penalty(stiffness, 1.4 * np.sqrt(stiffness)))
        gaps.append([np.linalg.norm(place - exact[0]), np.linalg.norm(reaction - exact[1])])
    ratio = np.array(gaps[0]) / gaps[1]
    assert (7.0 < ratio).all(), ratio
    assert (ratio < 14.0).all(), ratio
    assert gaps[1][0] < 1e-3


def driven(way, what):
    """A cart, a wheel on it and a load on the wheel; the wheel's joint is turned by a torque or a motion."""
    scene = fm.System(gravity=GRAVITY)
    cart = scene.add(fm.RigidBody(1.3, (0.05, 0.06, 0.07)), name="cart")
    wheel = scene.add(fm.RigidBody(0.9, (0.02, 0.03, 0.04), (0.1, 0.05, -0.02)), name="wheel")
    slide = scene.connect(fm.joint.Prismatic((1.0, 0.2, 0.5)), scene.ground.frame(), cart.frame(), way=way)
    turn = scene.connect(fm.joint.Revolute((0.0, 1.0, 1.0)), cart.frame(R=TILT), wheel.frame(), way=way)
    if what == "forces":
        scene.add_force(fm.force.JointTorque(turn, fm.Sine(3.0, 10.0)))
        scene.add_force(fm.force.JointForce(slide, 5.0))
    else:
        turn.prescribe(fm.Sine(7.0, 2.0))  # past a whole turn
        slide.prescribe(fm.Sine(0.2, 6.0))
        if way is fm.Way.COORDINATES:
            return scene, (cart, wheel), (slide, turn)
        slide.velocity, turn.velocity = 1.2, 14.0
    return scene, (cart, wheel), (slide, turn)


@pytest.mark.parametrize("what", ["forces", "motions"])
def test_forces_and_motions_on_joints_held_by_constraints(what):
    """They move the machine, and add to the reaction, as on joint coordinates."""
    ends = []
    for way in fm.Way:
        scene, bodies, joints = driven(way, what)
        run = scene.simulate(0.9, h=3e-4)
        parts = [states(run, bodies)[-1]]
        parts += [run.reaction(j)[-1] for j in joints]
        parts += [run.reaction(j)[0] for j in joints]
        parts += [run.drive(j)[-1:] for j in joints]
        ends.append(parts)
    for part, other in zip(*ends, strict=True):
        np.testing.assert_allclose(other, part, atol=3e-6 * max(1.0, np.abs(part).max()))


@pytest.mark.parametrize("name", ["revolute", "screw", "universal"])
@pytest.mark.parametrize("choice", [(1e6, 0.0), (1e8, 0.0), (1e7, 1e4)], ids=["soft", "stiff", "damped"])
def test_augmented_lagrangian_closes_what_it_enforces(name, choice):
    """To its tolerance, whatever the stiffness; the motion is that of multipliers, at the step's own error."""
    exact, bodies, joints = machine(name, way=fm.Way.CONSTRAINTS)
    exact = exact.simulate(0.1, h=1e-3, rtol=1e-8)
    place, reaction = exact.position(bodies[2].frame())[-1], exact.reaction(joints[1])[-1]
    scene, bodies, joints = machine(name, enforce=fm.AugmentedLagrangian(*choice, tol=1e-10))
    run = scene.simulate(0.1, h=1e-3, rtol=1e-8)
    extent = scene.compile().scene.extent
    assert run.stats.constraint_residual <= 1e-10 * max(1.0, extent)
    np.testing.assert_allclose(run.position(bodies[2].frame())[-1], place, atol=2e-6)
    np.testing.assert_allclose(run.reaction(joints[1])[-1], reaction, atol=2e-2 * np.abs(reaction).max())
    assert run.stats.iterations > 1.5 * exact.stats.iterations or choice[0] == 1e8  # passes were made


@pytest.mark.parametrize("settings", [{}, {"h": 1e-3}])
def test_an_augmented_lagrangian_too_soft_for_the_step_names_its_joint(settings):
    """A pendulum of 1 kg: at steps of 1 ms mass / step^2 is 1e6 N/m, and steps that are made shorter need more."""

    def swing(enforce):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        bob = scene.add(fm.RigidBody(mass=1.0, inertia=(0.01, 0.01, 0.01), com=(0.5, 0.0, 0.0)), name="bob")
        scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), bob.frame(), name="hinge", enforce=enforce)
        return scene.simulate(0.05, integrator=fm.GeneralizedAlpha(), **settings)

    with pytest.raises(fm.SimulationError, match=r"'hinge' \(stiffness 100 N/m\).*larger.*Multipliers"):
        swing(fm.AugmentedLagrangian(100.0))
    for remedy in (fm.AugmentedLagrangian(1e7), fm.Multipliers()):
        assert swing(remedy).t[-1] == 0.05
