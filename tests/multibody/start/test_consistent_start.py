"""The consistent start: rigid motions first, joints that were set before modes, modes by the least elastic energy."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from particles import particle_body
from scipy.optimize import fsolve, minimize
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError, StartWarning
from flexmbd.record.reduced_body import InterfaceFrame

CRANK, COUPLER, ROCKER, BASE = 0.1, 0.4, 0.3, 0.4
ANGLE = 1.0


def loop(angles):
    """What stays open (2,) between coupler and rocker, of the angles of crank, coupler against it, and rocker."""
    a1, a2, a4 = angles

    def along(length, angle):
        return length * np.array([np.cos(angle), np.sin(angle)])

    return along(CRANK, a1) + along(COUPLER, a1 + a2) - [BASE, 0.0] - along(ROCKER, a4)


def assembled(a1):
    a2, a4 = fsolve(lambda y: loop([a1, *y]), [0.5 - a1, 1.2], xtol=1e-13)
    return np.array([a1, a2, a4])


def four_bar(*, coupler, tip=None, out_of_plane=0.0, closing_rate=None, gravity=0.0):
    """Crank, coupler and rocker; the coupler ends at ``tip``, or as a rigid bar."""
    scene = fm.System(gravity=(0.0, -gravity, 0.0))
    turn = fm.joint.Revolute("z")
    crank = scene.add(fm.RigidBody(0.2, (1e-4, 2e-4, 2e-4), com=(0.05, 0, 0)), name="crank")
    bar = scene.add(coupler, name="coupler")
    rocker = scene.add(fm.RigidBody(0.4, (1e-4, 3e-3, 3e-3), com=(0.15, 0, 0)), name="rocker")
    j1 = scene.connect(turn, scene.ground.frame(), crank.frame(), name="j1")
    j2 = scene.connect(turn, crank.frame((CRANK, 0, 0)), bar.frame(), name="j2")
    j4 = scene.connect(turn, scene.ground.frame((BASE, 0, 0)), rocker.frame(), name="j4")
    end = bar.frame((COUPLER, 0, 0)) if tip is None else bar.frame(tip)
    j3 = scene.connect(turn, end, rocker.frame((ROCKER, 0, out_of_plane)), name="j3")
    if closing_rate is not None:
        j3.velocity = closing_rate
    return scene, (j1, j2, j4)


def flexible_coupler(modes=8, *, planar=False):
    """A body of particles whose tip lies where the bar's end is, and moves with its modes in every direction."""
    record = particle_body(3, modes=modes).record
    shapes = record.interface("tip").modes.copy()
    if planar:
        shapes[2:5] = 0.0
    moved = InterfaceFrame("tip", np.array([COUPLER, 0.0, 0.0]), np.eye(3), shapes)
    return fm.FlexibleBody(replace(record, interfaces=(record.interface("root"), moved)))


def angles_of(start, joints):
    return np.array([start.x[start.scene.index.joints[j].x][0] for j in joints])


@pytest.mark.parametrize("flexible", [False, True])
@pytest.mark.parametrize("digits", [2, 4])
def test_rounded_angles_move_as_little_as_need_be_and_bend_nothing(flexible, digits):
    body = flexible_coupler() if flexible else fm.RigidBody(0.5, (1e-4, 7e-3, 7e-3), com=(0.2, 0, 0))
    scene, joints = four_bar(coupler=body, tip="tip" if flexible else None)
    given = np.round(assembled(ANGLE), digits)
    for joint, angle in zip(joints, given, strict=True):
        joint.position = angle
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        start = scene.start()
    found = angles_of(start, joints)
    assert np.abs(loop(found)).max() < 1e-14
    nearest = minimize(
        lambda y: 1e4 * np.sum((y - given) ** 2),
        assembled(ANGLE),
        constraints={"type": "eq", "fun": loop},
        method="SLSQP",
        options={"ftol": 1e-14},
    ).x
    shift = np.abs(given - assembled(ANGLE)).max()
    np.testing.assert_allclose(found, nearest, atol=1e-3 * shift)
    assert start.strain.energy < 1e-20
    told = {name: (old, new) for name, old, new in start.moved}
    for joint, old, new in zip(joints, given, found, strict=True):
        assert told[f"{joint.name}.angle"] == (old, new)


def test_unset_joints_move_before_set_ones():
    scene, joints = four_bar(coupler=flexible_coupler(), tip="tip")
    joints[0].position = ANGLE
    given = np.array([ANGLE, assembled(ANGLE)[1] + 0.02])
    joints[1].position = given[1]
    start = scene.start()
    found = angles_of(start, joints)
    assert np.abs(loop(found)).max() < 1e-14
    nearest = minimize(
        lambda y: 1e4 * np.sum((y[:2] - given) ** 2),
        assembled(ANGLE),
        constraints={"type": "eq", "fun": loop},
        method="SLSQP",
        options={"ftol": 1e-14},
    ).x
    np.testing.assert_allclose(found, nearest, atol=2e-5)
    scene, joints = four_bar(coupler=flexible_coupler(), tip="tip")
    joints[0].position = ANGLE
    start = scene.start()
    np.testing.assert_allclose(angles_of(start, joints)[0], ANGLE, rtol=0.0, atol=0.0)
    assert start.strain.energy < 1e-20


@pytest.mark.parametrize("share", [5e-8, 1e-3])
def test_modes_close_what_joints_cannot_at_the_least_energy(share):
    """The rocker's pin lies out of the plane: of all modal coordinates that lift the tip, those of least energy."""
    lift = share * COUPLER
    body = flexible_coupler()
    scene, joints = four_bar(coupler=body, tip="tip", out_of_plane=lift)
    joints[0].position = ANGLE
    if share > 1e-7:
        with pytest.warns(StartWarning, match=r"bent \(coupler\).* J of elastic energy"):
            start = scene.start()
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            start = scene.start()
    # joints take up what the tip moves in the plane and how it turns about z
    modes, stiffness = body.record.interface("tip").modes, body.record.stiffness
    rows, wanted = modes[[2, 3, 4]], np.array([lift, 0.0, 0.0])
    flexibility = rows / stiffness @ rows.T
    energy = 0.5 * wanted @ np.linalg.solve(flexibility, wanted)
    assert start.strain.energy == pytest.approx(energy, rel=20.0 * share + 1e-5, abs=0.0)
    q = start.x[start.scene.index.modes[body].x]
    assert 0.5 * np.sum(stiffness * q**2) == pytest.approx(start.strain.energy, rel=1e-9, abs=0.0)
    assert start.residual < 1e-13
    assert angles_of(start, joints)[0] == ANGLE


def test_what_closing_bent_stands_in_the_stats():
    scene, joints = four_bar(coupler=flexible_coupler(), tip="tip", out_of_plane=1e-3)
    joints[0].position = ANGLE
    with pytest.warns(StartWarning) as told:
        run = scene.simulate(1e-6, h=1e-6)
    assert told[0].filename == __file__
    assert run.stats.start_elastic == pytest.approx(run.energy().elastic[0], rel=1e-9)


def test_modal_rates_stay_where_joints_alone_can_move():
    """At a rate of the crank that is given the other rates are those of the rigid four-bar, by finite differences."""
    body = flexible_coupler()
    scene, joints = four_bar(coupler=body, tip="tip", out_of_plane=2e-8)
    joints[0].position, joints[0].velocity = ANGLE, 3.0
    start = scene.start()
    step = 1e-6
    slope = (assembled(ANGLE + step) - assembled(ANGLE - step)) / (2 * step)
    rates = [start.v[start.scene.index.joints[j].v][0] for j in joints]
    np.testing.assert_allclose(rates, 3.0 * slope, rtol=1e-6)
    assert np.abs(start.v[start.scene.index.modes[body].v]).max() < 1e-5


def test_modal_coordinates_and_rates_can_be_given():
    """A cantilever let go: each mode of the undamped, clamped body swings by its own cosine while all is small."""
    body = fm.FlexibleBody(particle_body(5, modes=3).record)
    scene = fm.System()
    scene.add(body, name="body")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    body.q, body.q_rate = [1e-6, -2e-6, 3e-6], [1e-5, 0.0, -1e-5]
    run = scene.simulate(0.5, rtol=1e-9)
    omega = np.sqrt(body.record.stiffness)
    exact = body.q * np.cos(np.outer(run.t, omega)) + body.q_rate / omega * np.sin(np.outer(run.t, omega))
    np.testing.assert_allclose(run.q(body), exact, atol=1e-11)
    assert run.energy().elastic[0] == pytest.approx(0.5 * np.sum(body.record.stiffness * body.q**2), rel=1e-12)
    assert run.stats.start_moved == ()


def test_modal_coordinates_that_are_given_stay_and_joints_follow():
    body = flexible_coupler(modes=3, planar=True)
    scene, joints = four_bar(coupler=body, tip="tip")
    joints[0].position = ANGLE
    body.q = [1e-3, 0.0, 0.0]
    start = scene.start()
    assert tuple(start.x[start.scene.index.modes[body].x]) == (1e-3, 0.0, 0.0)
    assert start.residual < 1e-13
    assert not any("coupler.q" in name for name, _, _ in start.moved)


@pytest.mark.parametrize("values", [[1.0, 2.0], 1.0, "abc", [1.0, 2.0, np.nan], [[1.0, 2.0, 3.0]]])
@pytest.mark.parametrize("what", ["q", "q_rate"])
def test_modal_coordinates_of_another_shape_are_refused(what, values):
    body = fm.FlexibleBody(particle_body(5, modes=3).record)
    with pytest.raises(SceneError, match=rf"{what} takes 3 finite number\(s\), one a mode"):
        setattr(body, what, values)


def test_rotations_are_told_as_rotation_vectors():
    """A body on a ball, turned by a hinge that closes the loop: from the vector that was given to the hinge's."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="body")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame(), name="ball")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame(), name="hinge")
    half = np.array([0.3, 0.0, 0.4]) / 2
    turn = np.linalg.norm(half)
    ball.position = [np.cos(turn), *(np.sin(turn) * half / turn)]
    start = scene.start()
    told = {name: (old, new) for name, old, new in start.moved}
    names = [name for name in start.scene.velocity_names if name.startswith("ball")]
    assert [told[name][0] for name in names if name in told] == pytest.approx([0.3, 0.4])
    assert told[names[0]][1] == pytest.approx(0.0, abs=1e-12)


def slider_crank(angle, *, beside=0.0, eye=(0.3, 0.0, 0.0)):
    """Crank 0.08 m, rod with an eye at ``eye`` (m), guide along x through the crank's axle, or ``beside`` it (m)."""
    scene, turn = fm.System(), fm.joint.Revolute("z")
    crank, rod, piston = (scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3))) for _ in range(3))
    joints = [
        scene.connect(turn, scene.ground.frame(), crank.frame()),
        scene.connect(turn, crank.frame((0.08, 0.0, 0.0)), rod.frame()),
        scene.connect(turn, rod.frame(eye), piston.frame()),
    ]
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame((0.0, beside, 0.0)), piston.frame())
    joints[0].position = angle
    return scene, joints


@pytest.mark.parametrize("angle", [0.5, 1.6, -2.0, 3.0, np.pi, -np.pi, 3.3, 2.0 * np.pi, 41.0])
def test_a_crank_turned_anywhere_has_its_slider_on_the_side_that_was_drawn(angle):
    scene, joints = slider_crank(angle)
    crank, rod, piston = angles_of(scene.start(), joints)
    lean = -np.arcsin(0.08 * np.sin(angle) / 0.3)  # of the rod, against the guide
    assert crank == angle
    np.testing.assert_allclose([np.sin(angle + rod), np.cos(angle + rod)], [np.sin(lean), np.cos(lean)], atol=1e-13)
    np.testing.assert_allclose(np.exp(1j * (angle + rod + piston)), 1.0, atol=1e-13)


@pytest.mark.parametrize("angle", [2.0, np.pi, -2.5, 41.0])
@pytest.mark.parametrize("eye", [(0.3, 3e-6, 0.0), (0.3 + 4e-7, -4e-7, 2e-8), (0.3, 0.02, 0.0)])
def test_a_drawing_that_is_nearly_closed_says_the_side_too(angle, eye):
    """As the centre of a meshed bore, or figures of two digits, leave it; README's rod is such a one."""
    scene, joints = slider_crank(angle, eye=eye)
    crank, rod, _ = angles_of(scene.start(), joints)
    end = 0.08 * np.exp(1j * crank) + complex(*eye[:2]) * np.exp(1j * (crank + rod))
    assert crank == angle
    assert end.imag == pytest.approx(0.0, abs=1e-9)
    assert end.real > 0.2


@pytest.mark.parametrize("angle", [0.3, 1.6, 2.5, np.pi, -2.0, 41.0])
@pytest.mark.parametrize(("off", "beside"), [(0.165, 0.0), (1.0, 0.0), (0.0, 0.05), (0.5, 0.2)])
def test_a_drawing_that_is_open_says_the_side_too(angle, off, beside):
    """Its nearest closing has the slider on the side where it is drawn, and so it has at every angle of the crank."""
    scene, joints = slider_crank(angle, beside=beside, eye=(0.3 * np.cos(off), 0.3 * np.sin(off), 0.0))
    crank, rod, piston = angles_of(scene.start(), joints)
    assert crank == angle
    lean = np.arcsin((beside - 0.08 * np.sin(angle)) / 0.3)  # of the line between the rod's eyes
    np.testing.assert_allclose(np.exp(1j * (angle + rod + off)), np.exp(1j * lean), atol=1e-13)
    np.testing.assert_allclose(np.exp(1j * (angle + rod + piston)), 1.0, atol=1e-13)


def linked_cranks(angle, *, crank=0.1, coupler=0.3):
    """Two cranks of one length (m) on axles 0.3 m apart, drawn upright, linked by a coupler (m)."""
    scene, turn = fm.System(), fm.joint.Revolute("z")
    first, bar, second = (scene.add(fm.RigidBody(0.5, (1e-3, 1e-3, 1e-3))) for _ in range(3))
    joints = [
        scene.connect(turn, scene.ground.frame(), first.frame()),
        scene.connect(turn, first.frame((0.0, crank, 0.0)), bar.frame()),
        scene.connect(turn, scene.ground.frame((0.3, 0.0, 0.0)), second.frame()),
    ]
    scene.connect(turn, bar.frame((coupler, 0.0, 0.0)), second.frame((0.0, crank, 0.0)))
    joints[0].position = angle
    return scene, joints


@pytest.mark.parametrize("angle", [0.5, np.pi / 2, 2.0, np.pi, -3.0])
def test_a_parallelogram_stays_one_through_its_flat_positions(angle):
    """Where it is flat it may go on as parallelogram or turn inside out: it goes on as its rates lead."""
    scene, joints = linked_cranks(angle)
    found = angles_of(scene.start(), joints)
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angle * np.array([1.0, -1.0, 1.0])), atol=1e-6)


def test_where_a_dead_centre_bars_the_way_the_nearest_assembly_is_taken():
    """At 3 rad the first crank is past angles at which the coupler does not reach."""
    scene, joints = linked_cranks(3.0, crank=0.2, coupler=0.25)
    start = scene.start()
    first, bar, second = angles_of(start, joints)
    pin = 0.2j * np.exp(1j * first) + 0.25 * np.exp(1j * (first + bar))
    assert pin == pytest.approx(0.3 + 0.2j * np.exp(1j * second), abs=1e-13)
    assert first == 3.0


@pytest.mark.parametrize("angle", [2.0, 3.0, np.pi])
def test_axes_are_aligned_and_not_opposed(angle):
    scene = fm.System()
    first, second = (scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.3)), name=name) for name in ("first", "second"))
    tilt = scene.connect(fm.joint.Revolute("x"), scene.ground.frame((0.1, 0.0, 0.0)), first.frame((0.1, 0.0, 0.0)))
    ball = scene.connect(fm.joint.Spherical(), first.frame(), second.frame(), way=fm.Way.COORDINATES)
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), second.frame())
    tilt.position = angle
    start = scene.start()
    slots = start.scene.index.joints
    assert start.x[slots[tilt].x] == [angle]
    turned = Rotation.from_rotvec([angle, 0.0, 0.0]) * Rotation.from_quat(np.roll(start.x[slots[ball].x], -1))
    np.testing.assert_allclose(turned.apply([0.0, 0.0, 1.0]), [0.0, 0.0, 1.0], atol=1e-13)


@pytest.mark.parametrize("gravity", [9.81, 1e-3])
def test_rates_of_a_machine_at_rest_are_round_off(gravity):
    """That two rates of a four-bar contradict each other by 1e-16 says nothing; by 1e-6 it does."""
    for rate, agrees in ((1e-17, True), (1e-6, False)):
        bar = fm.RigidBody(0.5, (1e-4, 7e-3, 7e-3), com=(0.2, 0, 0))
        scene, joints = four_bar(coupler=bar, closing_rate=-2.0 * rate, gravity=gravity)
        for joint, angle in zip(joints, assembled(ANGLE), strict=True):
            joint.position = angle
        joints[0].velocity, joints[1].velocity = rate, 3.0 * rate
        if agrees:
            assert np.abs(scene.start().v).max() <= 1e-16
        else:
            with pytest.raises(SceneError, match="contradict"):
                scene.start()


@pytest.mark.parametrize(("rate", "told"), [(1e-3, True), (1e-30, False)])
def test_rates_at_rest_are_round_off_beside_those_that_gravity_gives(rate, told):
    scene, (crank, coupler, rocker) = four_bar(
        coupler=fm.RigidBody(0.3, (1e-4, 4e-3, 4e-3), com=(0.2, 0, 0)), gravity=10.0
    )
    for joint, angle in zip((crank, coupler, rocker), assembled(ANGLE), strict=True):
        joint.position = angle
    crank.velocity = rate
    moved = {name for name, _, _ in scene.start().moved if name.startswith("rate of")}
    assert moved == ({"rate of j2.angle", "rate of j4.angle"} if told else set())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("rate", "leads_out"), [(0.0, False), (0.5, True)])
def test_a_rod_across_its_slide_starts_from_rest(rate, leads_out, seed):
    """The rod's row has no hold on the slide: at rest nothing opens it but the rounding of gravity."""
    random = np.random.default_rng(seed)
    turn, skew = Rotation.from_rotvec(random.uniform(-2.0, 2.0, (2, 3))).as_matrix()
    p = random.uniform(-1.0, 1.0, 3)
    foot = np.array([-0.4375, -0.4375, 0.25])
    scene = fm.System(gravity=(-8.75, 10.0, 7.5))
    carriage = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="carriage")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(p=foot, R=turn), carriage.frame(p=p, R=skew))
    rod = scene.ground.frame(p=foot + turn @ [0.3, 0.225, 1.0])
    scene.connect(fm.joint.Distance(0.375), carriage.frame(p=p), rod)
    slide.position, slide.velocity = 1.0, rate
    if leads_out:
        with pytest.raises(SceneError, match="lead out of the loops at once"):
            scene.start()
    else:
        assert scene.start().v == pytest.approx(0.0, abs=1e-15)
