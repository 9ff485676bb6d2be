"""The search for an equilibrium: Newton's step, the path, downhill; what nothing resists; what is told and refused."""

import sys
import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.forms.beam_timoshenko import Parameters
from flexmbd.multibody.linear.balance import balance

STEEL = Parameters.rectangle(2.1e11, 0.3, 7850.0, width=2e-3, height=2e-3, orientation=(0, 1.0, 0))
EI = STEEL.E * STEEL.Iz


@pytest.fixture
def balances(monkeypatch):
    """A list that grows by one each time that forces are summed and their derivatives are taken."""
    counted = []

    def counting(*args, **named):
        counted.append(None)
        return balance(*args, **named)

    for name in ("equilibrium", "downhill", "path.corrector"):
        monkeypatch.setattr(sys.modules[f"flexmbd.multibody.linear.{name}"], "balance", counting)
    return counted


def cantilever(n, **load):
    """A scene, and the tip of a beam of 1 m along x."""
    scene = fm.System()
    beam = scene.add(fm.ExactBeam({"a": (0, 0, 0), "b": (1, 0, 0)}, {"x": [("a", "b")]}, {"x": STEEL}, n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("a"))
    scene.add_force(fm.force.FrameForce(beam.frame("b"), **load))
    return scene, beam.frame("b")


def elastica(load):
    """(2,) the tip under a force across it, load EI / L^2: psi'' = - load cos(psi)."""

    def clamp(angle):
        """The clamp's angle and its place from the tip, in axes fixed in the ground."""
        slope = lambda s, y: [y[1], -load * np.cos(y[0]), -np.cos(y[0]), -np.sin(y[0])]  # noqa: E731
        return solve_ivp(slope, (0.0, 1.0), [angle, 0.0, 0.0, 0.0], rtol=1e-11, atol=1e-12).y[[0, 2, 3], -1]

    return -clamp(brentq(lambda angle: clamp(angle)[0], 1e-9, 0.5 * np.pi - 1e-12, xtol=1e-14))[1:]


# --- Newton's step and the path


@pytest.mark.parametrize("load", [1.0, 7.0, 20.0])
def test_what_is_found_at_once_lies_on_the_path_and_nears_the_elastica(load):
    exact, errors = elastica(load), []
    for n in (3, 4, 8):
        scene, tip = cantilever(n, force=(0.0, lambda t: t * load * EI, 0.0))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = scene.equilibrium(t=1.0)
        assert found.unstable == 0
        assert found.neutral == ()
        path = scene.equilibrium(path=fm.Continuation(to=1.0))
        assert found.position(tip) == pytest.approx(path.position(tip)[-1], abs=1e-9)
        errors.append(np.abs(found.position(tip)[:2] - exact).max())
    assert errors[2] < errors[1] / 3.0 < errors[0] / 4.0
    assert errors[2] < 1e-5 * load


@pytest.mark.parametrize("n", [3, 4, 9])
@pytest.mark.parametrize("steps", [1, 4, 8])
def test_a_beam_is_rolled_up_to_a_circle(balances, n, steps):
    scene, tip = cantilever(n, torque=(0.0, 0.0, lambda t: 2.0 * np.pi * t * EI))
    about = None
    for t in np.arange(1, steps + 1) / steps:
        balances.clear()
        about = scene.equilibrium(t=t, about=about)
        assert len(balances) <= 10
        angle = 2.0 * np.pi * t
        assert about.position(tip)[:2] == pytest.approx([np.sin(angle) / angle, (1 - np.cos(angle)) / angle], abs=1e-9)


def pendulum(angle, *, torque=0.0, gravity=9.81, mass=1.3):
    """A rod that hangs at the angle zero, its weight 0.5 m below the hinge."""
    scene = fm.System(gravity=(0.0, -gravity, 0.0))
    rod = scene.add(fm.RigidBody(mass, (0.01 * mass,) * 3, (0.0, -0.5, 0.0)), name="rod")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame(), name="hinge")
    hinge.position = angle
    scene.add_force(fm.force.JointTorque(hinge, torque))
    return scene, hinge


@pytest.mark.parametrize("angle", [0.2, 1.0, 1.44, 0.5 * np.pi, 1.5708, 2.0, 3.1, -2.6])
def test_a_pendulum_hangs_in_the_end(angle):
    """From wherever it starts; at the torque's sine, over the top where the torque leads there."""
    for torque in (0.0, 3.0):
        scene, hinge = pendulum(angle, torque=torque)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = scene.equilibrium()
        assert found.unstable == 0
        off = found.beta(hinge) - np.arcsin(torque / (1.3 * 9.81 * 0.5))
        assert np.exp(1j * off) == pytest.approx(1.0, abs=1e-9)
        assert abs(found.beta(hinge) - angle) < 1.2 * np.pi


def test_an_equilibrium_that_is_unstable_is_kept_or_told_or_left():
    scene, hinge = pendulum(np.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = scene.equilibrium()
    assert kept.unstable == 1
    assert kept.beta(hinge) == pytest.approx(np.pi, abs=1e-12)
    assert abs(np.sin(scene.equilibrium(stable=True).beta(hinge))) < 1e-9
    assert scene.equilibrium(stable=True).unstable == 0
    # an upright rod on a slide that its weight presses down
    lift = fm.System(gravity=(0.0, -9.81, 0.0))
    car = lift.add(fm.RigidBody(1.0, (0.1,) * 3), name="car")
    slide = lift.connect(fm.joint.Prismatic("y"), lift.ground.frame(), car.frame(), name="slide")
    lift.add_force(fm.force.JointSpring(slide, 500.0))
    rod = lift.add(fm.RigidBody(1.0, (0.01,) * 3, (0.0, 0.5, 0.0)), name="rod")
    lift.connect(fm.joint.Revolute("z"), car.frame(), rod.frame(), name="foot")
    with pytest.warns(fm.EquilibriumWarning, match=r"one motion grows, most of all in 'foot\.angle'; stable="):
        assert lift.equilibrium().unstable == 1
    assert lift.equilibrium(stable=True).unstable == 0


@pytest.mark.parametrize("torque", [6.5, 60.0])
def test_no_equilibrium_is_refused_after_a_bounded_search(balances, torque):
    """m g l is 6.38 N m."""
    scene, _ = pendulum(0.3, torque=torque)
    with pytest.raises(SceneError, match=r"no equilibrium found: .* path=fm\.Continuation"):
        scene.equilibrium()
    assert len(balances) < 500


@pytest.mark.parametrize("load", [12.0, 30.0])
def test_a_jump_is_told(load):
    """Von Mises' truss beyond its limit load, 9.95 N."""
    scene = fm.System()
    apex = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="apex")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), apex.frame(), name="slide")
    slide.position = 0.3
    for side in (-1.0, 1.0):
        foot = scene.ground.frame(p=(side, 0.0, 0.0))
        scene.add_force(fm.force.SpringDamper(foot, apex.frame(), 1000.0, np.hypot(1.0, 0.3)))
    scene.add_force(fm.force.FrameForce(apex.frame(), (0.0, lambda t: -t, 0.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert scene.equilibrium(t=8.0).beta(slide) > 0.17
    with pytest.warns(fm.EquilibriumWarning, match=r"the path of equilibria turns: .* path=fm\.Continuation"):
        found = scene.equilibrium(t=load)
    path = scene.equilibrium(path=fm.Continuation(to=load))
    assert found.beta(slide) == pytest.approx(path.beta(slide)[-1], abs=1e-9)
    assert found.unstable == 0


# --- what nothing resists


def lattice(columns, rows, *, unit=1.0, far=0.0, angle=0.0, load=0.025):
    """Masses in a plane on springs, whose rotations nothing resists; forces in 1 / ``unit`` N, ``far`` m from here."""
    scene, joints, frames = fm.System(), {}, {}
    for j in range(rows):
        frames[0, j] = scene.ground.frame((far, far + j, 0.0))
        for i in range(1, columns):
            mass = scene.add(fm.RigidBody(10.0 * unit, (unit, unit, unit)), name=f"m{i}_{j}")
            place = scene.ground.frame((far + i, far + j, 0.0))
            joints[i, j] = scene.connect(fm.joint.Planar("z"), place, mass.frame(), name=f"p{i}_{j}")
            joints[i, j].position = [0.0, 0.0, angle]
            frames[i, j] = mass.frame()
            scene.add_force(fm.force.FrameForce(mass.frame(), (0.0, -load * unit, 0.0)))
    for (i, j), frame in frames.items():
        for di, dj in ((1, 0), (0, 1), (1, 1)):
            if (i + di, j + dj) in joints:
                length = float(np.hypot(di, dj))
                ends = frame, frames[i + di, j + dj]
                scene.add_force(fm.force.SpringDamper(*ends, 4000.0 * unit, length, damping=10.0 * unit))
    return scene, joints


def test_rotations_that_nothing_resists_stay_and_are_named():
    scene, joints = lattice(10, 4, angle=0.4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = scene.equilibrium()
    assert found.unstable == 0
    places = np.array([found.beta(joint) for joint in joints.values()])
    # a tenth of what counts as Newton's last step, of which round-off of the others' motion is 5e-12
    assert places[:, 2] == pytest.approx(0.4, abs=1e-10)
    assert places[:, 1].min() < -1e-3
    assert sorted(found.neutral) == sorted(f"p{i}_{j}.angle" for i, j in joints)


@pytest.mark.parametrize(("unit", "far"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e4), (1e-3, -1e3)])
def test_balance_is_of_the_forces_at_play(unit, far):
    """In other units of force, and far from the origin, a lattice with free rotations sags alike."""
    places = []
    for given in ({}, {"unit": unit, "far": far}):
        scene, joints = lattice(5, 3, angle=0.2, load=2.0, **given)
        found = scene.equilibrium()
        assert len(found.neutral) == len(joints)
        places.append([found.beta(joint) for joint in joints.values()])
    assert np.array(places[1]) == pytest.approx(np.array(places[0]), abs=1e-9 + 1e-12 * abs(far))


def test_what_turns_about_a_line_that_moves_stays(balances):
    """A block on a ball joint at its middle and two springs at a corner: nothing resists its turn about their line."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    solid = fm.Solid.box((0.3, 0.1, 0.2), density=1000.0)
    block = fm.PseudoRigidBody(solid, fm.StVenantKirchhoff(E=2e4, nu=0.3), damping=0.05)
    scene.add(block, name="block")
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="arm")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), arm.frame(), name="pivot")
    scene.connect(fm.joint.Spherical(), arm.frame((0.0, 0.0, -0.4)), block.frame(solid.com), name="hook")
    for place, stiffness in (((0.2, 0.0, 0.0), 300.0), ((0.0, 0.2, 0.0), 200.0)):
        scene.add_force(fm.force.SpringDamper(arm.frame(place), block.frame((0.1, 0.0, 0.1)), stiffness, 0.1, 0.5))
    found = scene.equilibrium()
    assert found.unstable == 0
    assert len(found.neutral) == 1
    assert found.neutral[0].startswith("hook.")
    assert len(balances) < 60
    rate = scene.simulate(0.05, about=found, rtol=1e-6).velocity(block.frame((0.1, 0.0, 0.1)))
    assert np.abs(rate).max() < 1e-6


def test_a_load_that_nothing_carries_is_named_at_once(balances):
    scene, joints = lattice(3, 2)
    scene.add_force(fm.force.FrameForce(joints[2, 1].child, torque=(0.0, 0.0, 1e-3)))
    with pytest.raises(SceneError, match=r"at 'p2_1\.angle' a force of 0\.001 .* for nothing resists it; check"):
        scene.equilibrium()
    assert len(balances) < 20


# --- where a branch ends, and where a machine starts


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("to", [10.001, 10.1, 12.0, 25.0])
def test_a_branch_ends_where_it_first_passes_its_end(to, side):
    """A bar on a turning spring, P sin(a) = k a, in steps that would go far beyond."""
    scene = fm.System()
    rod = scene.add(fm.RigidBody(1.0, (0.1,) * 3, com=(0.0, 0.5, 0.0)), name="rod")
    foot = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame(), name="foot")
    scene.add_force(fm.force.JointSpring(foot, 10.0, 0.0, 0.0))
    scene.add_force(fm.force.FrameForce(rod.frame(p=(0.0, 1.0, 0.0)), (0.0, lambda t: -t, 0.0)))
    (critical,) = scene.equilibrium(path=fm.Continuation(to=20.0)).critical
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bent = scene.equilibrium(about=critical, path=fm.Continuation(to=to, side=side, longest_step=1.0))
    assert bent.factors[-1] == to
    assert bent.factors.max() == to
    angle = side * brentq(lambda a: 10.0 * a / np.sin(a) - to, 1e-6, 3.0)
    assert bent.beta(foot)[-1] == pytest.approx(angle, abs=1e-6)


def test_a_branch_that_is_steep_at_first_ends_there_too():
    """The right-angle frame of Argyris et al. 1979 leaves its plane at 1.088 N, by a quarter of its size at 1.36 N."""
    length, height, width = 0.24, 0.03, 6e-4
    same = {"E": 7.124e10, "nu": 0.31, "rho": 100.0, "A": height * width, "Iy": height * width**3 / 12, "ky": 1.0}
    same |= {"Iz": width * height**3 / 12, "J": height * width**3 / 3, "kz": 1.0}
    ends = {"a": (0.0, 0.0, 0.0), "c": (length, 0.0, 0.0), "e": (length, -length, 0.0)}
    sides = {"g": (0.0, 1.0, 0.0), "h": (1.0, 0.0, 0.0)}
    sections = {name: Parameters(**same, orientation=side) for name, side in sides.items()}
    scene = fm.System()
    frame = fm.ExactBeam(ends, {"g": [("a", "c")], "h": [("c", "e")]}, sections, {"g": 8, "h": 8})
    scene.add(frame, name="frame")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), frame.frame("a"))
    scene.add_force(fm.force.FrameForce(frame.frame("e"), (lambda t: t, 0.0, 0.0)))
    (critical,) = scene.equilibrium(path=fm.Continuation(to=1.2)).critical
    aside = scene.equilibrium(about=critical, path=fm.Continuation(to=1.2, most_points=20))
    assert aside.end is fm.PathEnd.REACHED
    assert aside.factors[-1] == aside.factors.max() == 1.2
    assert (aside.unstable[1:] == 0).all()


@pytest.mark.parametrize("stiffness", [5.0, 50.0, 5e4])
def test_a_machine_starts_where_it_rests_on_its_stop(stiffness):
    """However deep it is pressed; a position that is given beyond it is refused as before."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    arm = scene.add(fm.RigidBody(0.5, (1e-3,) * 3, (0.2, 0.0, 0.0)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame(), name="hinge")
    scene.add_force(fm.force.JointStop(hinge, lower=-0.2, upper=3.0, stiffness=stiffness, transition=1e-3))
    rests = scene.equilibrium()
    depth = -0.2 - float(rests.beta(hinge))
    pushed = depth - 5e-4 if depth > 1e-3 else 500.0 * depth**2
    assert stiffness * pushed == pytest.approx(0.5 * 9.81 * 0.2 * np.cos(rests.beta(hinge)), rel=1e-9)
    run = scene.simulate(0.2, about=rests, rtol=1e-6)
    assert np.ptp(run.beta(hinge)) < 1e-9
    hinge.position = -0.3
    with pytest.raises(SceneError, match="lies beyond the limits"):
        scene.simulate(0.1)


@pytest.mark.parametrize("start", [0.4, 0.6, 0.7, 0.8, 0.9])
def test_a_symmetric_body_on_a_ball_hangs_wherever_it_starts(start):
    """Held by constraints, its frame beside the ball: its own turn is a motion that nothing resists."""
    turned = Rotation.from_rotvec([0.3, 1.0, 0.2]).as_matrix()
    place = np.array([0.3, -0.2, 0.1])
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    inertia = turned.T @ np.diag([0.02, 0.02, 0.01]) @ turned
    body = fm.RigidBody(1.0, inertia, tuple(turned.T @ (np.array([0.0, 0.0, -0.5]) - place)))
    scene.add(body, name="bob")
    ball = scene.connect(
        fm.joint.Spherical(), scene.ground.frame(), body.frame(turned.T @ -place, R=turned.T), way=fm.Way.CONSTRAINTS
    )
    ball.position = [np.cos(0.5 * start), 0.0, np.sin(0.5 * start), 0.0]
    found = scene.equilibrium()
    centre = found.position(body.frame(body.com))
    assert centre == pytest.approx([0.0, 0.0, -0.5], abs=1e-8)
