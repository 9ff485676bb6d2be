"""Coordinates and velocities given to joints held by constraints: kept where they can be, else named."""

from __future__ import annotations

import numpy as np
import pytest
from machines import CRANK, ROD, slider_position
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kane.equations import Kinematics

joint = fm.joint
TURN = Rotation.from_rotvec([0.4, -0.3, 0.6])
QUATERNION = TURN.as_quat()[[3, 0, 1, 2]]
CASES = {
    "revolute": (joint.Revolute((1.0, 2.0, -1.0)), [0.7], [1.5]),
    "prismatic": (joint.Prismatic((0.0, 1.0, 1.0)), [0.4], [-0.8]),
    "screw": (joint.Screw(0.1, "y"), [0.9], [2.0]),
    "cylindrical": (joint.Cylindrical("x"), [0.3, -0.8], [0.5, 1.1]),
    "planar": (joint.Planar("y"), [0.3, -0.2, 0.6], [0.5, 1.1, -0.7]),
    "universal": (joint.Universal("x", "y"), [0.5, -0.8], [1.2, 0.7]),
    "spherical": (joint.Spherical(), QUATERNION, [0.3, -1.0, 0.6]),
    "free": (joint.Free(), [0.1, 0.2, -0.3, *QUATERNION], [0.5, 0.1, 0.2, 0.3, -1.0, 0.6]),
}


def slider_crank(*, way=fm.Way.CONSTRAINTS):
    """All joints but the crank's and the rod's held by constraints."""
    scene = fm.System()
    crank = scene.add(fm.RigidBody(0.4, (2e-4, 3e-4, 4e-4), (0.03, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(0.8, (3e-4, 7e-3, 7.2e-3), (0.14, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, (1e-4, 1e-4, 1e-4)), name="piston")
    turn = joint.Revolute("z")
    main = scene.connect(turn, scene.ground.frame(), crank.frame(), name="main", way=fm.Way.COORDINATES)
    scene.connect(turn, crank.frame(p=(CRANK, 0.0, 0.0)), rod.frame(), name="big", way=fm.Way.COORDINATES)
    scene.connect(turn, rod.frame(p=(ROD, 0.0, 0.0)), piston.frame(), name="small", way=way)
    guide = scene.connect(joint.Prismatic("x"), scene.ground.frame(), piston.frame(), name="guide", way=way)
    return scene, piston, main, guide


def motion(start):
    return Kinematics(start.unreduced).move(0.0, start.x, start.v)


@pytest.mark.parametrize("name", sorted(CASES))
def test_what_is_given_is_where_coordinates_put_it(name):
    """A body that flies, and is held besides: it moves as if the joint carried it by coordinates."""
    kind, position, velocity = CASES[name]
    seen = []
    for way in (fm.Way.COORDINATES, fm.Way.CONSTRAINTS):
        scene = fm.System()
        base = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.25)), name="base")
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="body")
        lift = scene.connect(joint.Prismatic("x"), scene.ground.frame(), base.frame(), way=fm.Way.COORDINATES)
        lift.position, lift.velocity = 0.2, 0.3
        frame = body.frame(p=(0.1, 0.0, 0.2), R=TURN.as_matrix())
        held = scene.connect(kind, base.frame(p=(0.0, 0.4, 0.0)), frame, name="held", way=way)
        held.position, held.velocity = position, velocity
        if way is fm.Way.CONSTRAINTS:  # not placed by the joint, but flying from elsewhere
            scene.connect(joint.Free(), scene.ground.frame(), body.frame(), name="fly", way=fm.Way.COORDINATES)
        state = motion(scene.start())
        places = [state.position(frame), state.rotation(frame), state.velocity(frame), state.angular_velocity(frame)]
        seen.append(np.concatenate([np.ravel(part) for part in places]))
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-9)


def test_a_slider_crank_starts_where_the_guide_says():
    """Closed form: the crank's angle by the law of cosines, its rate by the slider's transmission."""
    scene, piston, main, guide = slider_crank()
    angle = 0.8
    guide.position = slider_position(angle)
    guide.velocity = 0.5
    start = scene.start()
    found = float(start.x[start.scene.index.joints[main].x][0])
    assert abs(found) == pytest.approx(angle, abs=1e-9)
    step = 1e-6
    slope = (slider_position(found + step) - slider_position(found - step)) / (2.0 * step)
    assert start.v[start.scene.index.joints[main].v][0] == pytest.approx(0.5 / slope, rel=1e-8)
    state = motion(start)
    np.testing.assert_allclose(state.position(piston.frame()), [slider_position(angle), 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(state.velocity(piston.frame()), [0.5, 0.0, 0.0], atol=1e-12)


def test_all_that_is_given_stays_where_it_agrees():
    scene, _, main, guide = slider_crank()
    main.position, main.velocity = 0.8, 2.0
    guide.position = slider_position(0.8)
    step = 1e-6
    guide.velocity = (slider_position(0.8 + step) - slider_position(0.8 - step)) / step
    start = scene.start()
    slots = start.scene.index.joints[main]
    assert start.x[slots.x] == 0.8
    assert start.v[slots.v] == 2.0


@pytest.mark.parametrize("what", ["position", "velocity"])
def test_contradictions_are_named(what):
    """The crank at 0.8 rad with the piston where 0.9 rad has it; or at a rate that is not the crank's."""
    scene, _, main, guide = slider_crank()
    main.position, main.velocity = 0.8, 2.0
    if what == "position":
        guide.position = slider_position(0.9)
        gap = slider_position(0.9) - slider_position(0.8)
    else:
        guide.velocity = gap = 3.0
    with pytest.raises(SceneError, match=rf"{what[:-1]}.* set on joints contradict.*'guide.displacement'") as caught:
        scene.start()
    if what == "position":
        assert f"{abs(gap):.3e}" in str(caught.value)


def test_a_velocity_at_the_dead_centre_is_named():
    """Stretched out in a line the piston has none, whatever the crank's."""
    scene, _, _, guide = slider_crank()
    guide.velocity = 0.5
    with pytest.raises(SceneError, match=r"velocities set .*'guide.displacement' .* 5.000e-01"):
        scene.start()


def test_places_out_of_reach_are_named():
    scene, _, _, guide = slider_crank()
    guide.position = 0.5
    with pytest.raises(SceneError, match=r"'guide.displacement'"):
        scene.start()


def test_two_joints_held_by_constraints_may_both_be_given():
    """A body on two rods' worth of joints: only one place has both the height and the turn."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="body")
    carriage = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="carriage")
    slide = scene.connect(
        joint.Prismatic("y"), scene.ground.frame(), carriage.frame(), name="slide", way=fm.Way.CONSTRAINTS
    )
    hinge = scene.connect(joint.Revolute("z"), carriage.frame(), body.frame(), name="hinge", way=fm.Way.CONSTRAINTS)
    slide.position, hinge.position = 0.4, -0.9
    slide.velocity, hinge.velocity = 1.5, 2.5
    state = motion(scene.start())
    np.testing.assert_allclose(state.position(body.frame()), [0.0, 0.4, 0.0], atol=1e-12)
    turned = Rotation.from_rotvec([0.0, 0.0, -0.9]).as_matrix()
    np.testing.assert_allclose(state.rotation(body.frame()), turned, atol=1e-12)
    np.testing.assert_allclose(state.velocity(body.frame()), [0.0, 1.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(state.angular_velocity(body.frame()), [0.0, 0.0, 2.5], atol=1e-12)


def test_a_free_joint_to_a_frame_that_deforms_starts_where_it_is_given():
    """No tree carries such a joint and it has no rows; the pose that it is given holds all the same."""
    record = particle_body(31, modes=3).record
    scene = fm.System()
    beam = scene.add(fm.FlexibleBody(record), name="beam")
    free = scene.connect(joint.Free(), scene.ground.frame(p=(0.2, 0.1, -0.3)), beam.frame("tip"))
    free.position, free.velocity = CASES["free"][1:]
    state = motion(scene.start())
    tip = beam.frame("tip")
    np.testing.assert_allclose(state.position(tip), [0.3, 0.3, -0.6], atol=1e-14)
    np.testing.assert_allclose(state.rotation(tip), TURN.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(state.velocity(tip), CASES["free"][2][:3], atol=1e-13)
    np.testing.assert_array_equal(scene.simulate(1e-3).reaction(free), 0.0)


@pytest.mark.parametrize("outwards", [True, False])
def test_a_chain_of_flying_bodies_starts_where_its_joints_say_in_any_order(outwards):
    """Each by more than a quarter turn, so that none is found from where the axes lie opposed."""
    scene = fm.System()
    places = range(3) if outwards else reversed(range(3))
    links = {k: scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name=f"link {k}") for k in places}
    ends = [scene.ground.frame(), *(links[k].frame(p=(0.5, 0.0, 0.0)) for k in range(3))]
    for k in range(3):
        hinge = scene.connect(joint.Revolute("xyz"[k]), ends[k], links[k].frame(), way=fm.Way.CONSTRAINTS)
        hinge.position = 2.0
    start = scene.start()
    turns = [Rotation.from_rotvec(2.0 * axis) for axis in np.eye(3)]
    R = (turns[0] * turns[1] * turns[2]).as_matrix()
    np.testing.assert_allclose(motion(start).rotation(links[2].frame()), R, atol=1e-12)
    assert start.moved == ()


@pytest.mark.parametrize("angle", [0.3, 2.9, -40.0])
def test_a_flying_body_starts_where_a_prescribed_motion_has_it(angle):
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="wheel")
    hinge = scene.connect(joint.Revolute("x"), scene.ground.frame(), wheel.frame(), way=fm.Way.CONSTRAINTS)
    hinge.prescribe(fm.Sine(2.0, 3.0, offset=angle))
    start = scene.start()
    state = motion(start)
    turned = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    np.testing.assert_allclose(state.rotation(wheel.frame()), turned, atol=1e-12)
    np.testing.assert_allclose(state.angular_velocity(wheel.frame()), [6.0, 0.0, 0.0], atol=1e-12)
    assert start.moved == ()
