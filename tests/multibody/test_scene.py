"""Scenes: prescribed motion, forces of every kind, topology, explain, and bad input."""

from __future__ import annotations

import gc
from contextlib import nullcontext

import numpy as np
import pytest
from machines import CRANK, ROD, pendulum, slider_crank, slider_position
from particles import particle_body
from scipy.interpolate import CubicSpline, PPoly

import flexmbd as fm
from flexmbd.errors import AssemblyError, InterfaceError, SceneError
from flexmbd.run.stopped import SimulationError


@fm.compiled
def torque(t):
    return 0.7 - 2.0 * t


def wheel():
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (0.15, 0.15, 0.25)), name="disc")
    return scene, disc, scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame())


def test_a_monotone_table_does_not_swing_over():
    """A pulse and a distant zero: by the cubic pieces' closed forms, and nothing after it, as a spline would have."""
    points = [0.0, 0.1, 0.2, 2.0], [0.0, 5.0, 0.0, 0.0]
    found = {}
    for monotone in (False, True):
        scene, _, hinge = wheel()
        scene.add_force(fm.force.JointTorque(hinge, fm.Table(*points, monotone=monotone)))
        with nullcontext() if monotone else pytest.warns(fm.TableWarning, match="swings to"):
            run = scene.simulate(2.0, rtol=1e-8)
        found[monotone] = run.drive(hinge), run.beta_rate(hinge)
        after = run.t >= 0.2
    drive, rate = found[True]
    assert drive.min() >= 0.0
    assert drive.max() == pytest.approx(5.0, rel=1e-2)
    assert abs(drive[after]).max() == 0.0
    # slopes 100, 0, 0 at the first points: 0.1 (0 + 5) / 2 + 0.01 (100 - 0) / 12 + 0.1 (5 + 0) / 2
    assert rate[after] == pytest.approx(np.full(after.sum(), 7 / 12 / 0.25), rel=1e-7)
    assert (found[False][0] == drive).all()  # taken so, where the spline would swing to more than its points


def test_a_monotone_table_of_a_prescribed_motion():
    """Its rate is that of the pieces; a straight line stays one, also of two points."""
    for points in (([0.0, 2.0], [0.0, 4.0]), ([0.0, 0.5, 2.0], [0.0, 1.0, 4.0])):
        scene, _, hinge = wheel()
        hinge.prescribe(fm.Table(*points, monotone=True))
        run = scene.simulate(1.0, rtol=1e-6)
        assert run.beta(hinge) == pytest.approx(2.0 * run.t, abs=1e-12)
        assert run.beta_rate(hinge) == pytest.approx(np.full(len(run.t), 2.0), abs=1e-12)


@pytest.mark.parametrize(
    "value",
    [
        torque,
        lambda t: 0.7 - 2.0 * t,
        fm.Table([0.0, 0.5, 2.0], [0.7, -0.3, -3.3]),
        PPoly(np.array([[-2.0, -2.0], [0.7, 0.1]]), np.array([0.0, 0.3, 1.0])),
    ],
    ids=["compiled", "Python", "table", "piecewise"],
)
def test_a_torque_turns_a_wheel(value):
    """angle = (0.7 t^2/2 - t^3/3) / I, whatever way the torque is given."""
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, value))
    run = scene.simulate(1.0, rtol=1e-8)
    assert run.t[-1] == 1.0
    assert run.beta_rate(hinge)[-1] == pytest.approx((0.7 - 1.0) / 0.25, abs=1e-7)
    assert run.beta(hinge)[-1] == pytest.approx((0.35 - 1.0 / 3.0) / 0.25, abs=1e-7)
    np.testing.assert_allclose(run.drive(hinge), 0.7 - 2.0 * run.t, atol=1e-9)


def test_a_sine_force_slides_a_mass():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    sled = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name="sled")
    slide = scene.connect(
        fm.joint.Prismatic((0.0, 3.0, 4.0)), scene.ground.frame(), sled.frame()
    )
    scene.add_force(fm.force.JointForce(slide, fm.Sine(6.0, 5.0, 0.2, 9.81 * 2.0 * 0.8)))
    run = scene.simulate(1.5, rtol=1e-8)
    t = run.t
    exact = 3.0 / 25.0 * (np.sin(0.2) - np.sin(5.0 * t + 0.2)) + 3.0 / 5.0 * np.cos(0.2) * t
    np.testing.assert_allclose(run.beta(slide), exact, atol=2e-7)
    np.testing.assert_allclose(
        run.position(sled.frame()), np.outer(run.beta(slide), [0.0, 0.6, 0.8]), atol=1e-14
    )


def test_prescribed_motion_is_kept_and_its_torque_told():
    """A wheel on a prescribed angle asks the torque I times acceleration."""
    scene, _, hinge = wheel()
    hinge.prescribe(fm.Sine(0.5, 3.0, 0.1))
    run = scene.simulate(2.0, rtol=1e-5)
    np.testing.assert_allclose(run.beta(hinge), 0.5 * np.sin(3.0 * run.t + 0.1), atol=1e-15)
    expected = -0.25 * 4.5 * np.sin(3.0 * run.t + 0.1)
    np.testing.assert_allclose(run.drive(hinge), expected, atol=1e-12)


def test_motion_by_three_compiled_functions():
    scene, _, hinge = wheel()
    hinge.prescribe(
        fm.Motion(
            fm.compiled(lambda t: 2.0 * t**3), fm.compiled(lambda t: 6.0 * t**2), fm.compiled(lambda t: 12.0 * t)
        )
    )
    run = scene.simulate(1.0)
    np.testing.assert_allclose(run.beta(hinge), 2.0 * run.t**3, atol=1e-15)
    np.testing.assert_allclose(run.drive(hinge), 3.0 * run.t, atol=1e-12)


def test_crank_at_prescribed_speed_moves_the_slider_by_its_closed_form():
    scene, piston, j1 = slider_crank()
    j1.prescribe(PPoly(np.array([[100.0], [0.0]]), np.array([0.0, 1.0])))
    run = scene.simulate(0.1, rtol=1e-9, integrator=fm.GeneralizedAlpha())
    x = run.position(piston.frame())[:, 0]
    assert np.abs(x - slider_position(run.beta(j1))).max() < 1e-8 * 2 * CRANK
    rate = np.gradient(slider_position(run.beta(j1)), run.t, edge_order=2)
    np.testing.assert_allclose(run.velocity(piston.frame())[:, 0], rate, atol=2e-2)


def test_slider_crank_starts_from_the_velocity_that_was_set():
    """The set crank speed is held; the others follow the loop; the report says so."""
    scene, piston, j1 = slider_crank()
    j1.position = 0.4
    j1.velocity = 100.0
    start = scene.start()
    run = scene.simulate(1e-6)
    assert run.beta_rate(j1)[0] == 100.0
    assert run.beta(j1)[0] == 0.4
    step = 1e-6
    slope = (slider_position(0.4 + step) - slider_position(0.4 - step)) / (2 * step)
    assert run.velocity(piston.frame())[0, 0] == pytest.approx(100.0 * slope, rel=1e-8)
    moved = {name for name, _, _ in start.moved}
    assert any("crank-conrod" in name for name in moved)
    assert not any("ground-crank" in name for name in moved)
    assert "the start was made consistent" in scene.explain()


def test_initial_accelerations_and_reactions_follow_from_the_loop():
    """A horizontal bar on two vertical slides... a bar hung at both ends carries half at each."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bar = scene.add(fm.RigidBody(3.0, (0.01, 0.25, 0.25), (0.5, 0.0, 0.0)), name="bar")
    scene.connect(fm.joint.Revolute(), scene.ground.frame(), bar.frame())
    scene.connect(
        fm.joint.Spherical(), scene.ground.frame(p=(1, 0, 0)), bar.frame(p=(1, 0, 0)), name="end"
    )
    start = scene.start()
    np.testing.assert_allclose(start.a, 0.0, atol=1e-12)
    assert start.scene.row_names == ("end: translation y",)
    assert abs(start.multipliers[0]) == pytest.approx(0.5 * 3.0 * 9.81, rel=1e-12)


def test_a_reversed_revolute_keeps_its_coordinate():
    """The user's joint runs from the arm to the ground; the angle is the ground's in the arm."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (1.0, 0.0, 0.0)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), arm.frame(), scene.ground.frame())
    hinge.position = 0.3
    run = scene.simulate(0.01)
    R = run.rotation(arm.frame())[0]
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(-0.3)
    assert run.beta_rate(hinge)[-1] > 0.0  # the arm falls clockwise, the ground turns against it


def test_a_body_held_only_at_a_flexible_frame_flies_on_multipliers():
    """A pendulum hung at its flexible tip: the joint holds, the energy too."""
    cloud = particle_body(5, modes=3)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(cloud.record), name="body")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("tip"), name="hinge")
    assert "flies with 6 coordinates" in scene.explain()
    run = scene.simulate(0.5, rtol=1e-6)
    assert run.multipliers.shape[1] == 5
    assert np.abs(run.position(body.frame("tip"))).max() < 1e-9
    y_axis = run.rotation(body.frame("tip"))[:, :, 1]
    np.testing.assert_allclose(y_axis, np.tile([0.0, 1.0, 0.0], (len(y_axis), 1)), atol=1e-9)
    energy = run.energy().total
    scale = np.ptp(run.energy().gravitational)
    assert scale > 0.1
    np.testing.assert_allclose(energy, energy[0], atol=1e-5 * scale)


def test_explain_names_what_goes_where():
    scene, *_ = slider_crank()
    text = scene.explain()
    assert "3 bodies, 3 velocities (3 free, 0 prescribed), 2 multipliers" in text
    assert "guide: Prismatic, 2 of 5 rows" in text
    assert "redundant, left out" in text
    tree, *_ = pendulum()
    assert "loops: none" in tree.explain()
    assert len(tree.compile().scene.plan.rows) == 0
    assert tree.compile().scene.plan.modal.size == 1  # nothing modal but the terminator


def test_explain_of_a_large_machine_counts_what_is_alike():
    """Thirty links and a slide at their end; of twenty bodies each is told."""

    def chain(links: int) -> list[str]:
        scene = fm.System()
        last = scene.ground.frame()
        for k in range(1, links + 1):
            link = scene.add(fm.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1)), name=f"link {k}")
            hinge = scene.connect(fm.joint.Revolute(axis="y"), last, link.frame(), name=f"hinge {k}")
            scene.add_force(fm.force.JointSpring(hinge, stiffness=float(k)))
            last = link.frame((1.0, 0.0, 0.0))
        slide = scene.add(fm.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1)), name="slide")
        scene.connect(fm.joint.Prismatic(axis="x"), last, slide.frame(), name="rail")
        return scene.explain().splitlines()

    lines = chain(30)
    assert "  30 x hinge 1 ... hinge 30: Revolute -> link 1 ... link 30 (rigid), joint coordinates" in lines
    assert "  rail: Prismatic -> slide (rigid), joint coordinates" in lines
    assert "30 x JointSpring on joint 'hinge 1' ... JointSpring on joint 'hinge 30'" in lines
    assert len(lines) < 12
    few = chain(19)
    assert "  hinge 7: Revolute -> link 7 (rigid), joint coordinates" in few
    assert "JointSpring on joint 'hinge 7'" in few


def test_configuration_interpolates_between_steps():
    scene, _, hinge = pendulum()
    run = scene.simulate(1.0, rtol=1e-7, integrator=fm.GeneralizedAlpha())
    middle = 0.5 * (run.t[:-1] + run.t[1:])
    fine = scene.simulate(1.0, rtol=1e-9, integrator=fm.GeneralizedAlpha())
    exact = CubicSpline(fine.t, fine.beta(hinge))
    at_steps = np.abs(run.beta(hinge) - exact(run.t)).max()
    slots = run.scene.index.joints[hinge]
    between = np.abs(run.configuration(middle)[:, slots.x][:, 0] - exact(middle)).max()
    assert between < 1.1 * at_steps < 1e-5
    with pytest.raises(SceneError, match="outside the trajectory"):
        run.configuration(1.5)


# --- bad input -----------------------------------------------------------------------------


def test_a_joint_from_a_body_to_itself():
    scene, disc, _ = wheel()
    with pytest.raises(SceneError, match="'disc' to itself"):
        scene.connect(fm.joint.Revolute(), disc.frame(), disc.frame(p=(1, 0, 0)))


def test_a_body_that_nothing_connects():
    scene, _, _ = wheel()
    scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="stray")
    with pytest.raises(SceneError, match=r"nothing connects 'stray' to the ground.*joint\.Free"):
        scene.simulate(1.0)


def test_two_bodies_that_hold_only_each_other():
    scene, _, _ = wheel()
    a = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="a")
    b = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="b")
    scene.connect(fm.joint.Revolute(), a.frame(), b.frame())
    with pytest.raises(SceneError, match="nothing connects 'a', 'b' to the ground"):
        scene.compile()


def test_a_mechanism_that_cannot_be_assembled():
    """A slider-crank whose guide lies out of reach: the open residual is said."""
    scene = fm.System()
    bars = [
        scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=name) for name in ("crank", "rod")
    ]
    turn = fm.joint.Revolute()
    scene.connect(turn, scene.ground.frame(), bars[0].frame())
    scene.connect(turn, bars[0].frame(p=(CRANK, 0, 0)), bars[1].frame())
    scene.connect(
        turn, scene.ground.frame(p=(2.0, 0.0, 0.0)), bars[1].frame(p=(ROD, 0, 0)), name="pin"
    )
    with pytest.raises(AssemblyError, match=r"cannot be assembled: pin: .* stays open by 1\.6"):
        scene.simulate(1.0)


def test_velocities_that_contradict_a_loop():
    scene, _, j1 = slider_crank()
    j1.prescribe(PPoly(np.array([[100.0], [0.0]]), np.array([0.0, 1.0])))
    scene._connections[1].prescribe(PPoly(np.array([[5.0], [0.0]]), np.array([0.0, 1.0])))
    with pytest.raises(AssemblyError, match="contradict the loops"):
        scene.simulate(0.1)


def test_a_step_at_its_floor_keeps_what_was_computed():
    """A torque that grows without bound at 0.5 s."""
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, lambda t: 1.0 / (0.5 - t) ** 2 if t < 0.5 else 1e40))
    with pytest.raises(SimulationError, match=r"stopped at t = 0\.[45].*a step as short as .* still") as caught:
        scene.simulate(1.0, rtol=1e-5)
    past = caught.value.trajectory
    assert 0.4 < past.t[-1] <= 0.5
    exact = (1.0 / (0.5 - past.t) - 2.0) / 0.25
    early = past.t < 0.4
    np.testing.assert_allclose(past.beta_rate(hinge)[early], exact[early], atol=1e-3)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda t: np.nan if t > 0.2 else 1.0, r"JointTorque on joint 'revolute ground-disc'.*not finite"),
        (lambda t: [1.0, 2.0] if t > 0.2 else 1.0, r"shape \(2,\), not one number"),
        (lambda t: 1.0 / 0.0 if t > 0.2 else 1.0, "division by zero"),
    ],
)
def test_a_python_function_that_fails_says_when(function, message):
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, function))
    with pytest.raises(SimulationError, match=message) as caught:
        scene.simulate(1.0)
    assert "at t = 0." in str(caught.value)
    assert 0.1 < caught.value.trajectory.t[-1] <= 0.2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, (1, 1, 1)), "mass must be positive"),
        ((np.nan, (1, 1, 1)), "mass must be positive"),
        ((1.0, (1, 1, 3)), "belong to no body"),
        ((1.0, np.ones((3, 2))), r"inertia must be \(3,\)"),
        ((1.0, [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
        ((1.0, (1, 1, 1), (0, np.inf, 0)), "com must be three finite"),
    ],
)
def test_impossible_rigid_bodies(arguments, message):
    with pytest.raises(SceneError, match=message):
        fm.RigidBody(*arguments)


MEASURED = (0.066, 0.086, 0.0125)  # link 3 of a Puma 560, Armstrong et al. 1986: 9 % beyond the sum of the others


def test_a_measured_inertia_that_no_body_has_turns_as_given():
    """About each of its axes by a torque: w = T t / I; bound to another body, by the sum of both."""
    with pytest.raises(SceneError, match="as_measured=True takes them"):
        fm.RigidBody(4.8, MEASURED)
    for axis, inertia in zip("xyz", MEASURED, strict=True):
        scene = fm.System()
        link = scene.add(fm.RigidBody(4.8, MEASURED, as_measured=True), name="link")
        load = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="load")
        hinge = scene.connect(fm.joint.Revolute(axis), scene.ground.frame(), link.frame())
        scene.connect(fm.joint.Fixed(), link.frame(), load.frame())
        scene.add_force(fm.force.JointTorque(hinge, 2.0))
        run = scene.simulate(0.5, rtol=1e-8)
        assert run.beta_rate(hinge)[-1] == pytest.approx(2.0 * 0.5 / (inertia + 0.01), rel=1e-8)


@pytest.mark.parametrize("inertia", [(1.0, 1.0, 0.0), (1.0, 1.0, -0.1)])
def test_a_measured_inertia_must_be_positive(inertia):
    with pytest.raises(SceneError, match="belong to no body: none may be negative"):
        fm.RigidBody(1.0, inertia, as_measured=True)


def test_names_that_nobody_gave_are_free_ones():
    """Two joints of a kind between the same bodies; bodies, states and controllers beside ones named by hand."""
    scene = fm.System()
    named = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="body 2")
    bodies = [scene.add(fm.RigidBody(1.0, (1, 1, 1))) for _ in range(3)]
    assert [body.name for body in (named, *bodies)] == ["body 2", "body 3", "body 4", "body 5"]
    ends = [(scene.ground.frame((float(k), 0, 0)), named.frame((float(k), 0, 0))) for k in range(3)]
    joints = [scene.connect(fm.joint.Fixed(), *pair) for pair in ends]
    assert [joint.name for joint in joints] == [f"fixed ground-body 2{more}" for more in ("", " 2", " 3")]
    torque = fm.Signal("torque")
    scene.add_controller(lambda t, u: 0.0, period=0.1, measurements=[], inputs=[torque], name="controller 2")
    other = scene.add_controller(lambda t, u: 0.0, period=0.1, measurements=[], inputs=[fm.Signal("other")])
    assert other.name == "controller 3"
    scene.add_states(lambda t, z, u: -z, scale=1.0, initial=[1.0], name="states 2")
    assert scene.add_states(lambda t, z, u: -z, scale=1.0, initial=[1.0]).name == "states 3"


def test_names_axes_frames_and_arguments():
    scene, disc, hinge = wheel()
    with pytest.raises(SceneError, match="'disc' is taken"):
        scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="disc")
    with pytest.raises(SceneError, match="already in this scene"):
        scene.add(disc)
    with pytest.raises(SceneError, match="no direction"):
        fm.joint.Revolute((0.0, 0.0, 0.0))
    with pytest.raises(SceneError, match="axis 'w' is not known"):
        fm.joint.Prismatic("w")
    other = fm.System()
    stranger = other.add(fm.RigidBody(1.0, (1, 1, 1)), name="stranger")
    with pytest.raises(SceneError, match="not in this scene"):
        scene.connect(fm.joint.Fixed(), disc.frame(), stranger.frame())
    with pytest.raises(SceneError, match="not a rotation"):
        disc.frame(R=2.0 * np.eye(3))
    with pytest.raises(SceneError, match="takes 1 finite number"):
        hinge.velocity = (1.0, 2.0)
    with pytest.raises(SceneError, match=r"t_end = 0.0 s must lie after"):
        scene.simulate(0.0)
    with pytest.raises(SceneError, match="rtol"):
        scene.simulate(1.0, rtol=0.0)
    with pytest.raises(SceneError, match="step h"):
        scene.simulate(1.0, h=-1e-3)
    with pytest.raises(SceneError, match="three finite numbers"):
        fm.System(gravity=(0.0, 9.81))
    with pytest.raises(SceneError, match="acts on a joint whose only coordinate is a translation"):
        scene.add_force(fm.force.JointForce(hinge, 1.0))
    ball = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="ball")
    socket = scene.connect(fm.joint.Spherical(), disc.frame(), ball.frame())
    with pytest.raises(SceneError, match="only a joint with one can be prescribed"):
        socket.prescribe(1.0)
    with pytest.raises(SceneError, match="quaternion of length 2"):
        socket.position = (2.0, 0.0, 0.0, 0.0)
    with pytest.raises(SceneError, match="needs rate and acceleration"):
        hinge.prescribe(torque)
    flexible = fm.FlexibleBody(particle_body(1, modes=2).record)
    with pytest.raises(InterfaceError, match="no interface 'middle'; it has: 'root', 'tip'"):
        flexible.frame("middle")


def test_a_motion_on_the_joint_that_closes_a_loop():
    """The guide moves the piston as prescribed; the crank follows by the closed form."""
    scene, piston, j1 = slider_crank()
    j1.position = 1.0
    guide = scene._connections[-1]
    guide.way = fm.Way.CONSTRAINTS
    middle = slider_position(1.0)
    guide.prescribe(fm.Sine(0.03, 20.0, offset=middle))
    run = scene.simulate(0.5, h=1e-3, rtol=1e-10)
    expected = middle + 0.03 * np.sin(20.0 * run.t)
    np.testing.assert_allclose(run.position(piston.frame())[:, 0], expected, atol=1e-10)
    np.testing.assert_allclose(slider_position(run.beta(j1)), expected, atol=1e-10)


def test_a_reversed_spherical_joint_keeps_its_meaning():
    """From the arm to the ground: its quaternion turns the ground in the arm; the motion is the
    same as that of a joint the right way round."""
    half = np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])
    runs = []
    for backwards in (True, False):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (1.0, 0.0, 0.2)), name="arm")
        frames = [scene.ground.frame(), arm.frame()]
        ball = scene.connect(fm.joint.Spherical(), *(frames[::-1] if backwards else frames))
        ball.position = half * [1.0, 1.0, 1.0, -1.0] if backwards else half
        run = scene.simulate(0.3, rtol=1e-7)
        runs.append((run.rotation(arm.frame())[0], run.position(arm.frame(p=(1, 0, 0)))[-1]))
    expected = [[np.cos(0.6), -np.sin(0.6), 0.0], [np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]]
    for start, end in runs:
        np.testing.assert_allclose(start, expected, atol=1e-12)
        np.testing.assert_allclose(end, runs[1][1], atol=1e-6)


@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_a_machine_that_starts_from_rest(gravity):
    """A prescribed motion that leaves rest as t^4: nothing moves at first, and nothing is stuck."""
    scene, piston, j1 = slider_crank()
    scene.gravity = (0.0, gravity, 0.0)
    j1.prescribe(PPoly(np.array([[4e4], [0.0], [0.0], [0.0], [0.0]]), np.array([0.0, 1.0])))
    run = scene.simulate(0.08, rtol=1e-7)
    x = run.position(piston.frame())[:, 0]
    assert np.abs(x - slider_position(4e4 * run.t**4)).max() < 1e-9
    assert run.beta(j1)[-1] == pytest.approx(4e4 * 0.08**4, rel=1e-12)


def test_an_overconstrained_loop_that_misses_by_a_nanometre():
    """Frames from a mesh lie off the plane by round-off of its geometry; the loop still closes."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    turn = fm.joint.Revolute("z")
    crank = scene.add(fm.RigidBody(0.4, (2e-4, 3e-4, 4e-4)), name="crank")
    rod = scene.add(fm.RigidBody(0.8, (3e-4, 7e-3, 7.2e-3), (0.14, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, (1e-4, 1e-4, 1e-4)), name="piston")
    j1 = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(CRANK, 0, 0)), rod.frame())
    scene.connect(turn, rod.frame(p=(ROD, 0, 2e-9)), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide")
    j1.velocity = 30.0
    run = scene.simulate(0.1, rtol=1e-8)
    assert run.stats.start_residual == pytest.approx(2e-9, rel=1e-6)
    x = run.position(piston.frame())[:, 0]
    assert np.abs(x - slider_position(run.beta(j1))).max() < 1e-9


def test_a_compiled_function_that_is_not_finite_at_the_start():
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, fm.compiled(lambda t: 1.0 / t)))
    with pytest.raises(SceneError, match=r"JointTorque on joint .* at t = 0 s it gives .*not finite"):
        scene.simulate(1.0)


def test_a_spectral_radius_that_there_is_none_of():
    with pytest.raises(SceneError, match=r"rho must lie between 0 and 1, got 1\.5"):
        fm.GeneralizedAlpha(1.5)


@pytest.mark.parametrize("way", [None, fm.Way.CONSTRAINTS])
def test_a_motion_that_moves_no_mass_is_named(way):
    """A point mass on the axis that it turns about."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    point = scene.add(fm.RigidBody(1.0, (0.0, 0.0, 0.0)), name="point")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), point.frame(), name="pin", way=way)
    with pytest.raises(AssemblyError, match=r"moving '(pin.angle|point .*w.)' moves no mass"):
        scene.simulate(1.0)


@pytest.mark.parametrize("on", [True, False])
def test_compiling_leaves_the_collection_of_garbage_as_it_was(on):
    """Which is off meanwhile; where the scene is refused, too."""
    before = gc.isenabled()
    (gc.enable if on else gc.disable)()
    try:
        pendulum()[0].compile()
        assert gc.isenabled() == on
        loose = fm.System()
        loose.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)))
        with pytest.raises(SceneError, match="nothing connects"):
            loose.compile()
        assert gc.isenabled() == on
    finally:
        (gc.enable if before else gc.disable)()
