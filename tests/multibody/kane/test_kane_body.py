"""A body that the user gives in Kane's form moves as the same body does in the recursion."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.scene_matrices import mass_matrix
from flexmbd.run.stopped import SimulationError

GRAVITY = np.array([0.4, -9.81, 1.2])
INERTIA = np.array([[0.05, 0.004, -0.003], [0.004, 0.06, 0.002], [-0.003, 0.002, 0.07]])
MASS, COM = 1.7, np.array([0.1, -0.2, 0.15])
METHODS = {
    "radau": fm.RadauIIA(),
    "explicit": fm.ExplicitRungeKutta(),
    "alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
}


def cross_matrix(p):
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


def rigid(frame):
    """A rigid body in Kane's form, at a frame that is not its centre of mass."""

    def body(motion):
        R = motion.rotation(frame)
        c, w = R @ COM, motion.angular_velocity(frame)
        J = R @ INERTIA @ R.T
        C = cross_matrix(c)
        inertia = np.block([[MASS * np.eye(3), -MASS * C], [MASS * C, J - MASS * C @ C]])
        force = MASS * (GRAVITY - np.cross(w, np.cross(w, c)))
        return inertia, np.concatenate([force, np.cross(c, force) - np.cross(w, J @ w)])

    return body


def chain(*, kane, loop=False):
    """Two links on crossed hinges, a rigid body at the tip of the second; or that body given in Kane's form."""
    scene = fm.System(gravity=tuple(GRAVITY))
    links = [scene.add(fm.RigidBody(0.6, (0.02, 0.03, 0.04), (0.2, 0.0, 0.0)), name=name) for name in ("one", "two")]
    first = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), links[0].frame(), name="first")
    second = scene.connect(fm.joint.Revolute("y"), links[0].frame(p=(0.5, 0.0, 0.0)), links[1].frame(), name="second")
    tip = links[1].frame(p=(0.4, 0.1, 0.0))
    if kane:
        scene.add_force(fm.force.KaneBody([tip], rigid(tip), name="load"))
    else:
        load = scene.add(fm.RigidBody(MASS, INERTIA, COM), name="load")
        scene.connect(fm.joint.Fixed(), tip, load.frame(), name="bond")
    if loop:
        scene.connect(fm.joint.PointOnPlane((1.0, 0.5, 0.2)), scene.ground.frame(p=(0.3, 0.0, 0.0)), tip, name="plane")
    first.position, second.position = 0.3, -0.4
    if not loop:
        first.velocity, second.velocity = 2.0, -3.0
    return scene, first, second


def difference(method, *, loop, h):
    """Largest difference of positions and rates after 0.25 s between the two ways to give the load."""
    runs = []
    for kane in (False, True):
        scene, *joints = chain(kane=kane, loop=loop)
        run = scene.simulate(0.25, h=h, rtol=1e-11, integrator=METHODS[method])
        runs.append(np.array([[run.beta(j)[-1], run.beta_rate(j)[-1]] for j in joints]))
    assert np.abs(runs[0]).max() > 1.0
    return np.abs(runs[1] - runs[0]).max()


@pytest.mark.parametrize(
    ("method", "loop"), [("radau", False), ("radau", True), ("explicit", False), ("explicit", True), ("alpha", False)]
)
def test_it_is_the_rigid_body(method, loop):
    """Step by step the same, with a tree and with a loop; the load outweighs the links."""
    assert difference(method, loop=loop, h=2.5e-3) < 1e-9


@pytest.mark.parametrize(("method", "loop"), [("alpha", True), ("energy-momentum", False), ("energy-momentum", True)])
def test_it_is_the_rigid_body_as_the_step_falls(method, loop):
    """Where the method weighs mass and forces otherwise, in its own order, two: splitting, or multipliers' weights."""
    coarse, fine = (difference(method, loop=loop, h=h) for h in (5e-3, 2.5e-3))
    assert coarse < 1e-4
    assert coarse / fine == pytest.approx(4.0, rel=0.03)


def test_accelerations_and_masses_are_those_of_the_rigid_body():
    """At the start to round-off, and so the generalised mass: M + G^T I G by Kane, by the recursion with the body."""
    starts = [chain(kane=kane)[0].start() for kane in (False, True)]
    np.testing.assert_allclose(starts[1].a, starts[0].a, rtol=1e-12)
    masses = [mass_matrix(s.scene, new_work(s.scene.plan), s.x) for s in starts]
    assert np.abs(masses[0] - masses[1]).max() > 0.1  # the recursion knows nothing of the given body


@pytest.mark.parametrize("loop", [False, True])
def test_joints_bear_it(loop):
    """Reactions of both hinges, force and moment, as with the rigid body in its place."""
    reactions = []
    for kane in (False, True):
        scene, *joints = chain(kane=kane, loop=loop)
        run = scene.simulate(0.05, h=2.5e-3, rtol=1e-12, integrator=fm.ExplicitRungeKutta())
        reactions.append(np.hstack([run.reaction(j) for j in joints]))
    np.testing.assert_allclose(reactions[1], reactions[0], atol=1e-9 * np.abs(reactions[0]).max())


def test_small_vibrations_are_those_of_the_rigid_body():
    """Of themselves; what an input does depends on the accelerations that follow, and is refused."""
    values = []
    for kane in (True, False):
        scene, first, second = chain(kane=kane)
        first.velocity = second.velocity = 0.0
        for joint in (first, second):
            scene.add_force(fm.force.JointSpring(joint, 60.0, 0.0, 0.8))
        eq = scene.equilibrium()
        lin = scene.linearize(about=eq, outputs=[fm.output.Acceleration(second)])
        values.append(lin.eigenvalues())
        torque = fm.force.JointTorque(first, 1.0)
        if kane:
            with pytest.raises(SceneError, match=r"load.* follows the machine's accelerations, and so the inputs"):
                scene.linearize(about=eq, inputs=[torque])
        else:
            assert scene.linearize(about=eq, inputs=[torque]).V.shape == (2, 1)
    assert abs(values[1].real).max() > 0.1
    np.testing.assert_allclose(values[0], values[1], rtol=1e-6)


def test_added_mass_of_a_fluid():
    """A sphere that rises in water: half of the displaced mass moves with it; z = (buoyancy - weight) t^2 / 2 M."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3)), name="ball")
    rise = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    water = 1.2

    def fluid(motion):
        inertia = np.zeros((6, 6))
        inertia[:3, :3] = 0.5 * water * np.eye(3)
        return inertia, [0.0, 0.0, water * 9.81, 0.0, 0.0, 0.0]

    scene.add_force(fm.force.KaneBody([ball.frame()], fluid))
    run = scene.simulate(1.0, rtol=1e-9)
    a = (water - 0.5) * 9.81 / (0.5 + 0.5 * water)
    np.testing.assert_allclose(run.beta(rise), 0.5 * a * run.t**2, atol=1e-9)
    assert np.abs(run.drive(rise)).max() < 1e-8


def test_a_body_between_two_frames():
    """An inerter (a mass that resists relative acceleration) between two sleds, by Newton's second law for each."""
    scene = fm.System()
    sleds = [scene.add(fm.RigidBody(m, (0.1, 0.1, 0.1)), name=f"m{m}") for m in (1.0, 2.0)]
    slides = [scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), s.frame(), name=s.name) for s in sleds]
    scene.add_force(fm.force.JointForce(slides[0], 3.0))
    inertance = 5.0
    coupling = np.zeros((12, 12))
    coupling[np.ix_([0, 6], [0, 6])] = inertance * np.array([[1.0, -1.0], [-1.0, 1.0]])
    scene.add_force(fm.force.KaneBody([s.frame() for s in sleds], lambda m: (coupling, np.zeros(12)), name="inerter"))
    start = scene.start()
    mass = np.diag([1.0, 2.0]) + inertance * np.array([[1.0, -1.0], [-1.0, 1.0]])
    np.testing.assert_allclose(start.a, np.linalg.solve(mass, [3.0, 0.0]), rtol=1e-12)


def test_bodies_are_solved_together():
    """Two halves of the load are the load."""
    scene, *_ = chain(kane=True)
    halves, *_ = chain(kane=False)
    halves = fm.System(gravity=tuple(GRAVITY))
    links = [halves.add(fm.RigidBody(0.6, (0.02, 0.03, 0.04), (0.2, 0.0, 0.0)), name=name) for name in ("one", "two")]
    first = halves.connect(fm.joint.Revolute("z"), halves.ground.frame(), links[0].frame())
    second = halves.connect(fm.joint.Revolute("y"), links[0].frame(p=(0.5, 0.0, 0.0)), links[1].frame())
    first.position, second.position, first.velocity, second.velocity = 0.3, -0.4, 2.0, -3.0
    tip = links[1].frame(p=(0.4, 0.1, 0.0))
    whole = rigid(tip)
    for share in (0.25, 0.75):
        halves.add_force(
            fm.force.KaneBody([tip], lambda m, s=share: tuple(s * part for part in whole(m)), name=f"{share}")
        )
    np.testing.assert_allclose(halves.start().a, scene.start().a, rtol=1e-11)
    assert "KaneBody '0.25'; KaneBody '0.75': Python, called at each evaluation" in halves.explain()


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ((np.eye(3), np.zeros(6)), r"shapes \(6, 6\) and \(6,\)"),
        ((np.eye(6), np.full(6, np.nan)), "finite"),
    ],
)
def test_bad_answers_are_named(answer, text):
    scene = fm.System()
    ball = scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3)), name="ball")
    scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    scene.add_force(fm.force.KaneBody([ball.frame()], lambda m: answer, name="odd"))
    with pytest.raises((SceneError, SimulationError), match=f"KaneBody 'odd'.*{text}"):
        scene.simulate(1.0)


def test_bodies_that_are_none():
    scene = fm.System()
    ball = scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3)), name="ball")
    with pytest.raises(SceneError, match="one frame"):
        scene.add_force(fm.force.KaneBody([], lambda m: None))  # type: ignore[return-value]
    with pytest.raises(SceneError, match="not a function"):
        scene.add_force(fm.force.KaneBody([ball.frame()], 3.0))
    other = fm.System().add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3)), name="other")
    with pytest.raises(SceneError, match="not in this scene"):
        scene.add_force(fm.force.KaneBody([other.frame()], lambda m: None))  # type: ignore[return-value]
