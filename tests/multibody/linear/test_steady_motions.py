"""Steady motions in closed form, the same however the machine is carried; and what is none is refused."""

from __future__ import annotations

import itertools

from mpi4py import MPI

import numpy as np
import pytest
import scipy.optimize
from linear_machines import G
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import KelvinVoigtDamping, craig_bampton

C, K = fm.Way.COORDINATES, fm.Way.CONSTRAINTS


def quaternion(turn):
    return np.roll(turn.as_quat(), 1)


def vibrations(lin):
    """Eigenvalues beside those of what turns or drifts freely."""
    values = lin.eigenvalues()
    return values[np.abs(values) > 1e-4 * np.abs(values).max()]


def refusal(call):
    with pytest.raises(SceneError) as caught:
        call()
    return str(caught.value)


# a bead on an arm

STIFF, DAMPER, LENGTH, SPIN = 1000.0, 30.0, 0.5, 10.0
STRETCH = SPIN**2 * LENGTH / (STIFF - SPIN**2)


def beaded(ways, *, unit=1.0, tilt=(0.0, 0.0, 0.0), driven=False, gravity=(0.0, 0.0, 0.0)):
    """A bead of 1 kg on an arm whose frame and the bead's lie off the line; lengths in ``unit`` of a metre."""
    scene = fm.System(gravity=gravity)
    off = unit * np.array([0.02, 0.03, 0.01])
    arm = scene.add(fm.RigidBody(1.0, unit**2 * np.array([0.1, 0.1, 0.1])), name="arm")
    bead = scene.add(fm.RigidBody(1.0, unit**2 * np.array([1e-3, 2e-3, 3e-3]), off), name="bead")
    ground = scene.ground.frame(p=unit * np.array([1.0, 2.0, 3.0]), R=Rotation.from_rotvec(tilt).as_matrix())
    hinge_at = arm.frame(p=(-0.25 * unit, 0.0, 0.0))
    hinge = scene.connect(fm.joint.Revolute("z"), ground, hinge_at, name="hinge", way=ways[0])
    place = bead.frame(p=off)
    guide = arm.frame(p=((LENGTH - 0.25) * unit, 0.0, 0.0))
    scene.connect(fm.joint.Prismatic("x"), guide, place, name="slide", way=ways[1])
    scene.add_force(fm.force.SpringDamper(hinge_at, place, STIFF, LENGTH * unit, DAMPER))
    if driven:
        hinge.prescribe(lambda t: (SPIN * t + 0.3, SPIN, 0.0))
    else:
        hinge.velocity = SPIN
    return scene, hinge, hinge_at, place


def off_by(eq, hinge_at, place):
    return np.linalg.norm(eq.position(place) - eq.position(hinge_at)) - LENGTH


@pytest.mark.parametrize("ways", itertools.product((C, K), repeat=2))
@pytest.mark.parametrize("driven", [False, True])
def test_a_bead_on_an_arm(ways, driven):
    """m w^2 l / (k - m w^2); beside it m s^2 + c s + k - m w^2, and 3 m w^2 more times r^2 over all inertia if free."""
    scene, hinge, *ends = beaded(ways, driven=driven, tilt=(0.3, 0.7, 0.2))
    eq = scene.equilibrium()
    assert off_by(eq, *ends) == pytest.approx(STRETCH, rel=1e-12)
    pull = 0.25 * SPIN**2 + SPIN**2 * (LENGTH + STRETCH)
    np.testing.assert_allclose(eq.reaction(hinge)[:3], [-pull, 0.0, 0.0], atol=1e-10 * pull)
    away = LENGTH + STRETCH
    held = 0.0 if driven else 4.0 * SPIN**2 * away**2 / (away**2 + 0.1 + 0.0625 + 3e-3)
    expected = np.roots([1.0, DAMPER, STIFF - SPIN**2 + held])
    found = vibrations(scene.linearize(about=eq))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-9)
    run = scene.simulate(0.3, about=eq, rtol=1e-9)
    distance = np.linalg.norm(run.position(ends[1]) - run.position(ends[0]), axis=1)
    assert np.ptp(distance) < 1e-8
    np.testing.assert_allclose(run.a[0], eq.a, atol=1e-10 * SPIN**2)


def test_lengths_in_millimetres():
    scene, _, *ends = beaded((K, K), unit=1e3)
    eq = scene.equilibrium()
    assert np.linalg.norm(eq.position(ends[1]) - eq.position(ends[0])) == pytest.approx(1e3 * (LENGTH + STRETCH))


def test_a_mode_as_a_motion_of_what_flies_in_a_turn():
    """Seen between the bodies it is the same, whether coordinates carry them or constraints hold them."""
    seen = []
    for ways in ((C, C), (K, K)):
        scene, _, *ends = beaded(ways)
        lin = scene.linearize(about=scene.equilibrium())
        k = next(k for k, value in enumerate(lin.eigenvalues()) if value.imag > 1.0)
        run = lin.mode_motion(k, amplitude=0.01, instants=40)
        distance = np.linalg.norm(run.position(ends[1]) - run.position(ends[0]), axis=1)
        assert np.ptp(distance) > 1e-3
        rates = [np.linalg.norm(run.acceleration(frame), axis=1) for frame in ends]
        seen.append((distance - distance.mean()) / np.ptp(distance))
        assert rates[1].min() > 0.5 * SPIN**2 * LENGTH
    np.testing.assert_allclose(seen[1], seen[0], atol=2e-2)  # amplitudes are counted in other coordinates


# orbits


@pytest.mark.parametrize("way", ["free", "planar", "planar by constraints"])
def test_an_orbit_at_the_end_of_a_spring(way):
    """k l / (k - m w^2); s^2 + c s / m + k / m + 3 w^2 at constant angular momentum."""
    spin, stiffness, rest, mass, damper = 5.0, 200.0, 0.3, 0.5, 2.0
    scene = fm.System()
    ball = scene.add(fm.RigidBody(mass, (1e-3, 2e-3, 3e-3)), name="ball")
    if way == "free":
        joint = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
        joint.position, joint.velocity = [0.32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.32 * spin, 0.0, 0.0, 0.0, spin]
    else:
        how = C if way == "planar" else K
        joint = scene.connect(fm.joint.Planar("z"), scene.ground.frame(), ball.frame(), way=how)
        joint.position, joint.velocity = [0.32, 0.0, 0.0], [0.0, 0.32 * spin, spin]
    scene.add_force(fm.force.SpringDamper(scene.ground.frame(), ball.frame(), stiffness, rest, damper))
    eq = scene.equilibrium()
    radius = stiffness * rest / (stiffness - mass * spin**2)
    assert np.linalg.norm(eq.position(ball.frame())) == pytest.approx(radius, rel=1e-12)
    np.testing.assert_allclose(eq.acceleration(ball.frame()), -(spin**2) * eq.position(ball.frame()), atol=1e-11)
    found = scene.linearize(about=eq).eigenvalues()
    for root in np.roots([1.0, damper / mass, stiffness / mass + 3.0 * spin**2]):
        assert np.abs(found - root).min() < 1e-8 * abs(root)


# pendulums and tops on a ball

OFFSETS = (np.zeros(3), np.array([0.3, -0.2, 0.1]))


def on_a_ball(way, offset, *, inertia, arm, mass, tilt, velocity):
    """A body on a ball, its frame at ``offset`` from it and turned; ``velocity`` (3,) in the axes of the ball's."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    turn = Rotation.from_rotvec(offset)
    own = turn.as_matrix()
    place = offset + own @ [0.0, 0.0, arm]
    body = scene.add(fm.RigidBody(mass, own @ np.diag(inertia) @ own.T, place), name="bob")
    tip = scene.ground.frame(p=(0.1, 0.2, 0.3))
    ball = scene.connect(fm.joint.Spherical(), tip, body.frame(p=offset, R=own), name="tip", way=way)
    ball.position, ball.velocity = quaternion(tilt), velocity
    return scene, ball


@pytest.mark.parametrize("way", [C, K])
@pytest.mark.parametrize("offset", OFFSETS, ids=["on the ball", "off it"])
@pytest.mark.parametrize("inertia", [(0.015, 0.02, 0.008), (0.02, 0.02, 0.001), (1e-3, 1e-3, 1e-3)])
def test_a_conical_pendulum(way, offset, inertia):
    """(A + m l^2 - C) w^2 cos = m g l, A about what lies across in the vertical plane."""
    spin, mass, arm, start = 6.0, 2.0, 0.5, Rotation.from_euler("ZX", [0.4, 0.7])
    velocity = start.inv().apply([0.0, 0.0, spin])
    scene, ball = on_a_ball(way, offset, inertia=inertia, arm=-arm, mass=mass, tilt=start, velocity=velocity)
    eq = scene.equilibrium()
    cosine = mass * G * arm / ((inertia[1] + mass * arm**2 - inertia[2]) * spin**2)
    assert eq.rotation(ball.child)[2, 2] == pytest.approx(cosine, rel=1e-10)
    pull = mass * spin**2 * arm * np.sqrt(1.0 - cosine**2)
    found = eq.rotation(ball.child) @ eq.reaction(ball)[:3]
    assert found[2] == pytest.approx(mass * G, rel=1e-9)
    assert np.linalg.norm(found[:2]) == pytest.approx(pull, rel=1e-9)
    run = scene.simulate(1.0, about=eq, rtol=1e-9)
    assert np.ptp(run.rotation(ball.child)[:, 2, 2]) < 1e-7


@pytest.mark.parametrize("way", [C, K])
@pytest.mark.parametrize("offset", OFFSETS, ids=["on the ball", "off it"])
def test_a_top_that_precesses(way, offset):
    """C r w - A w^2 cos = m g l for its spin r; it nods at constant momenta about the ball's axes."""
    mass, arm, along, theta, turn = 1.5, 0.2, 0.01, 0.5, 4.0
    across = 0.03 + mass * arm**2
    spin = (mass * G * arm + across * turn**2 * np.cos(theta)) / (along * turn)
    start = Rotation.from_euler("ZX", [0.4, theta + 0.05])
    velocity = start.inv().apply([0.0, 0.0, turn])
    velocity[2] += spin - turn * np.cos(theta)
    scene, ball = on_a_ball(
        way, offset, inertia=(0.03, 0.03, along), arm=arm, mass=mass, tilt=start, velocity=velocity
    )
    eq = scene.equilibrium()
    assert np.arccos(eq.rotation(ball.child)[2, 2]) == pytest.approx(theta, rel=1e-9)
    momentum = along * spin  # about its axis
    upright = across * turn * np.sin(theta) ** 2 + momentum * np.cos(theta)

    def potential(angle):
        turning = (upright - momentum * np.cos(angle)) ** 2 / (2.0 * across * np.sin(angle) ** 2)
        return turning + mass * G * arm * np.cos(angle)

    step = 1e-3
    bend = (potential(theta + step) - 2.0 * potential(theta) + potential(theta - step)) / step**2
    nod = scene.linearize(about=eq).eigenvalues()
    assert np.abs(nod.imag).max() == pytest.approx(np.sqrt(bend / across), rel=1e-5)


def test_a_coin_that_rolls_in_a_circle():
    """Leaning inwards, its spin from the balance of moments about its centre."""
    radius, mass, lean, turn = 0.1, 1.0, 0.3, 6.0
    across, along = mass * radius**2 / 4.0, mass * radius**2 / 2.0
    axle = np.array([np.cos(lean), 0.0, np.sin(lean)])
    ahead, up = np.array([0.0, 1.0, 0.0]), np.array([-np.sin(lean), 0.0, np.cos(lean)])

    def motion(spin):
        w = turn * np.array([0.0, 0.0, 1.0]) + spin * axle
        away = np.cross(w, radius * up)[1] / turn
        force = mass * np.array([-(turn**2) * away, 0.0, G])
        momentum = across * w + (along - across) * (w @ axle) * axle
        return (np.cross([0.0, 0.0, turn], momentum) - np.cross(-radius * up, force))[1], away, w

    spin = scipy.optimize.brentq(lambda value: motion(value)[0], -200.0, 0.0, xtol=1e-14)
    _, away, w = motion(spin)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    coin = scene.add(fm.RigidBody(mass, (across, across, along)), name="coin")
    ride = scene.connect(fm.joint.Free(), scene.ground.frame(), coin.frame(), name="ride")
    axes = np.column_stack([ahead, np.cross(axle, ahead), axle])
    ride.position = [away, 0.0, radius * np.cos(lean), *quaternion(Rotation.from_matrix(axes))]
    ride.velocity = [0.0, turn * away, 0.0, *(axes.T @ w)]
    scene.connect(fm.joint.RollingDisc(radius), scene.ground.frame(), coin.frame(), name="rolls")
    eq = scene.equilibrium()
    np.testing.assert_allclose(eq.position(coin.frame()), [away, 0.0, radius * np.cos(lean)], atol=1e-9)
    grows = scene.linearize(about=eq).eigenvalues().real.max()
    ride.velocity = ride.velocity + 1e-7 * np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    run = scene.simulate(4.0, rtol=1e-10, max_step=0.01)
    height = np.abs(run.position(coin.frame())[:, 2] - radius * np.cos(lean))
    late = (run.t > 2.0) & (run.t < 3.5)
    assert np.polyfit(run.t[late], np.log(height[late]), 1)[0] == pytest.approx(grows, rel=1e-3)


# a rotor on a turning arm


def rotor_on_an_arm(ways, offset, *, spin=80.0, cross=0.006, gravity=(0.0, 0.0, -G)):
    scene = fm.System(gravity=gravity)
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.2, 0.0, 0.0)), name="arm")
    yoke = scene.add(fm.RigidBody(0.3, (1e-3, 1e-3, 1e-3)), name="yoke")
    rotor = scene.add(fm.RigidBody(2.0, (0.01, 0.006, cross), offset), name="rotor")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame(), name="hub", way=ways[0])
    tilt = scene.connect(fm.joint.Revolute("y"), arm.frame(p=(0.4, 0.0, 0.0)), yoke.frame(), name="tilt")
    axle = scene.connect(fm.joint.Revolute("x"), yoke.frame(), rotor.frame(p=offset), name="axle", way=ways[1])
    scene.add_force(fm.force.JointSpring(tilt, 200.0, 0.0, 1.0))
    hub.velocity, axle.velocity = 5.0, spin
    return scene, tilt, hub


@pytest.mark.parametrize("ways", itertools.product((C, K), repeat=2))
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.1, 0.2, -0.05)], ids=["about its frame", "aside of it"])
def test_a_rotor_on_a_turning_arm(ways, offset):
    """k b + W cos b (C w - (C - A) W sin b) = 0, and the same vibration however it is carried."""
    scene, tilt, _ = rotor_on_an_arm(ways, offset)
    eq = scene.equilibrium()

    def moment(b):
        return 200.0 * b + 5.0 * np.cos(b) * (0.01 * 80.0 - 0.004 * 5.0 * np.sin(b))

    assert eq.beta(tilt) == pytest.approx(scipy.optimize.brentq(moment, -1.0, 1.0, xtol=1e-15), rel=1e-10)
    found = vibrations(scene.linearize(about=eq))
    reference = rotor_on_an_arm((C, C), (0.0, 0.0, 0.0))[0]
    expected = vibrations(reference.linearize(about=reference.equilibrium()))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-7)
    run = scene.simulate(0.2, about=eq, rtol=1e-9)
    assert np.ptp(run.beta(tilt)) < 1e-8


# loops


LINK, SPRINGS, WEIGHTS, TURN = 0.5, (300.0, 200.0), (0.4, 0.7, 0.3), 9.0


def looped(held, order, tilt, *, driven):
    """Two sliders across each other on a hub, with a link between them; ``held``: joints by constraints."""
    scene = fm.System()
    hub = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.0, 0.0, 0.1)), name="hub")
    one, other = (scene.add(fm.RigidBody(m, (1e-3,) * 3), name=name) for m, name in zip(WEIGHTS, "pq", strict=False))
    link = scene.add(fm.RigidBody(WEIGHTS[2], (1e-3, 2e-3, 3e-3), (LINK / 2.0, 0.0, 0.0)), name="link")
    first = 0.35
    second = np.sqrt(LINK**2 - first**2)
    ground = scene.ground.frame(p=(0.3, 0.1, 0.0), R=Rotation.from_rotvec(tilt).as_matrix())
    joints = {
        "h": (fm.joint.Revolute("z"), ground, hub.frame(p=(0.0, 0.0, 0.2)), None),
        "a": (fm.joint.Prismatic("x"), hub.frame(), one.frame(), first),
        "b": (fm.joint.Prismatic("y"), hub.frame(), other.frame(), second),
        "c": (fm.joint.Revolute("z"), one.frame(), link.frame(), np.arctan2(second, -first)),
        "d": (fm.joint.Spherical(), link.frame(p=(LINK, 0.0, 0.0)), other.frame(), None),
    }
    made = {}
    for name in order:
        joint, inner, outer, position = joints[name]
        made[name] = scene.connect(joint, inner, outer, name=name, way=K if name in held else None)
        made[name].position = position
    if driven:
        made["h"].prescribe(lambda t: (TURN * t, TURN, 0.0))
    else:
        made["h"].velocity = TURN
    for stiffness, slider in zip(SPRINGS, (one, other), strict=True):
        scene.add_force(fm.force.SpringDamper(hub.frame(), slider.frame(), stiffness, 0.3, 0.1))
    return scene, hub, one


def slope(a):
    """Of the potential with the centrifugal one; the link's centre stays at half its length from the axis."""
    b = np.sqrt(LINK**2 - a**2)
    springs = SPRINGS[0] * (a - 0.3) - SPRINGS[1] * (b - 0.3) * a / b
    return springs - TURN**2 * (WEIGHTS[0] - WEIGHTS[1]) * a


@pytest.mark.parametrize(
    ("held", "order"),
    [("", "habcd"), ("h", "dcbah"), ("ab", "bdhac"), ("hcd", "abhdc"), ("abc", "hadcb"), ("hbd", "cbadh")],
)
def test_a_loop_is_cut_anywhere(held, order):
    exact = scipy.optimize.brentq(slope, 0.2, 0.45, xtol=1e-15)
    for driven in (False, True):
        scene, hub, one = looped(held, order, (0.2, -0.5, 0.4), driven=driven)
        eq = scene.equilibrium()
        assert np.linalg.norm(eq.position(one.frame()) - eq.position(hub.frame())) == pytest.approx(exact, rel=1e-10)
        reference = looped("", "habcd", (0.0, 0.0, 0.0), driven=driven)[0]
        expected = vibrations(reference.linearize(about=reference.equilibrium()))
        np.testing.assert_allclose(vibrations(scene.linearize(about=eq)), expected, rtol=1e-8)


# bodies that deform


SOFT = beam_timoshenko.Parameters.rectangle(2.1e9, 0.0, 7850.0, width=0.04, height=0.02, orientation=(0, 1, 0))


@pytest.mark.parametrize("frame", ["start", "end", None])
def test_a_spinning_rod_whatever_its_frame(frame):
    """rho w^2 L^2 / 3 E, and half of its mass times w^2 L, each but for the square of the strain."""
    spin = 40.0
    ends = [Interface("start"), Interface("end")]
    line = meshes.line(1.0, divisions=8, comm=MPI.COMM_SELF)
    model = ContinuumModel(line, beam_timoshenko, SOFT, degree=2, interfaces=ends)
    scene = fm.System()
    rod = scene.add(fm.FlexibleBody(craig_bampton(model, modes=12, frame=frame)), name="rod")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(1.0, 2.0, 0.0)), rod.frame("start"), name="hub")
    hub.prescribe(lambda t: (spin * t, spin, 0.0))
    eq = scene.equilibrium()
    stretch = np.linalg.norm(eq.position(rod.frame("end")) - eq.position(rod.frame("start"))) - 1.0
    strain = 7850.0 * spin**2 / 2.1e9
    assert stretch == pytest.approx(strain / 3.0, rel=strain)
    assert eq.reaction(hub)[0] == pytest.approx(-7850.0 * 0.04 * 0.02 * spin**2 / 2.0, rel=strain)
    np.testing.assert_allclose(scene.simulate(1e-6, about=eq, h=1e-6).reaction(hub)[0], eq.reaction(hub), atol=1e-3)


def test_an_exact_beam_held_at_either_end():
    """tan(k L) / k - L, k^2 = rho w^2 / E, as far as eight elements tell; the same from either end."""
    spin, found = 40.0, []
    points = {"hub": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    for at, far in (("hub", "tip"), ("tip", "hub")):
        scene = fm.System()
        beam = scene.add(fm.ExactBeam(points, {"arm": [("hub", "tip")]}, {"arm": SOFT}, 8), name="arm")
        hub = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="hub")
        turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=points[at]), hub.frame(), name="turn")
        turn.prescribe(lambda t: (spin * t, spin, 0.0))
        scene.connect(fm.joint.Fixed(), hub.frame(), beam.frame(at))
        eq = scene.equilibrium()
        found.append(np.linalg.norm(eq.position(beam.frame(far)) - eq.position(beam.frame(at))) - 1.0)
    k = np.sqrt(7850.0 * spin**2 / 2.1e9)
    np.testing.assert_allclose(found, np.tan(k) / k - 1.0, rtol=1e-3)
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.fixture(scope="module")
def shaft():
    tube = beam_timoshenko.Parameters.tube(2.1e11, 0.3, 7850.0, outer_radius=0.01, orientation=(0.0, 1.0, 0.0))
    line = meshes.line(1.0, divisions=16, comm=MPI.COMM_SELF)
    model = ContinuumModel(
        line, forms.beam_timoshenko, tube, degree=2, interfaces=[Interface("start"), Interface("end")]
    )
    return craig_bampton(model, modes=6, frame="start", damping=KelvinVoigtDamping(2e-4))


def test_a_shaft_on_a_line_of_the_ground_whirls_as_on_its_own(shaft):
    """Rotating damping makes it unstable above its critical speed, wherever the line of its bearing is fixed."""
    machines = {}
    for fixed_in in ("shaft", "ground"):
        scene = fm.System()
        body = scene.add(fm.FlexibleBody(shaft), name="shaft")
        turn = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), body.frame("start"), name="turn")
        ends = [body.frame("end"), scene.ground.frame(p=(1.0, 0.0, 0.0))]
        scene.connect(fm.joint.PointOnLine("x"), *(ends if fixed_in == "shaft" else ends[::-1]))
        machines[fixed_in] = scene, turn
    rest = machines["shaft"][0].linearize().frequencies()
    critical = 2.0 * np.pi * rest[rest > 1.0].min()
    slow = {}
    for fixed_in, (scene, turn) in machines.items():
        grows = []
        for share in (0.9, 1.1):
            turn.velocity = share * critical
            values = scene.linearize().eigenvalues()
            grows.append(values.real.max() > 1e-4 * critical)
            slow[fixed_in, share] = values[np.abs(values) < 3.0 * critical]
        assert grows == [False, True]
    for share in (0.9, 1.1):
        np.testing.assert_allclose(slow["ground", share], slow["shaft", share], rtol=1e-6, atol=1e-6 * critical)

    def at_speed(speed):
        scene, turn = machines["ground"]
        turn.velocity = speed
        return scene.linearize()

    diagram = fm.campbell(at_speed, critical * np.array([0.2, 0.4, 0.6]))
    assert diagram.frequencies.shape[0] == 3


# what is not steady


def test_a_turning_four_bar():
    scene = fm.System()
    places = {"crank": (0.0, 0.25, 0.0), "rod": (0.6, 0.0, 0.0), "rocker": (0.0, 0.5, 0.0)}
    crank, rod, rocker = (scene.add(fm.RigidBody(1.0, (0.1,) * 3, p), name=name) for name, p in places.items())
    turn = fm.joint.Revolute("z")
    drive = scene.connect(turn, scene.ground.frame(), crank.frame(), name="drive")
    scene.connect(turn, crank.frame(p=(0.0, 0.5, 0.0)), rod.frame(), name="pin")
    scene.connect(turn, scene.ground.frame(p=(1.2, 0.0, 0.0)), rocker.frame(), name="foot")
    scene.connect(turn, rocker.frame(p=(0.0, 1.0, 0.0)), rod.frame(p=(1.3, 0.0, 0.0)), name="top")
    drive.velocity = 5.0
    scene.add_force(fm.force.JointSpring(drive, 1.0))
    said = refusal(scene.equilibrium)
    assert "not steady" in said
    assert "would accelerate by" in said


@pytest.mark.parametrize("ways", [(C, C), (K, K)])
def test_gravity_across_the_line(ways):
    for driven in (False, True):
        assert "not steady" in refusal(beaded(ways, driven=driven, gravity=(0.0, -G, 0.0))[0].equilibrium)


@pytest.mark.parametrize("way", [C, K])
def test_gravity_across_what_a_drive_carries_evenly(way):
    """Nothing accelerates, but the moment of the drive changes."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    arm = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.2, 0.0, 0.0)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame(), name="hinge", way=way)
    hinge.prescribe(lambda t: (3.0 * t, 3.0, 0.0))
    said = refusal(scene.equilibrium)
    assert "what drives 'hinge" in said


@pytest.mark.parametrize("ways", [(C, C), (K, K)])
def test_a_spring_to_the_ground_beside_the_line(ways):
    for driven in (False, True):
        scene, *_, place = beaded(ways, driven=driven)
        scene.add_force(fm.force.SpringDamper(scene.ground.frame(p=(1.9, 2.1, 3.0)), place, 5.0, 0.2, 0.0))
        assert "not steady" in refusal(scene.equilibrium)


@pytest.mark.parametrize("ways", [(C, C), (K, K)])
def test_a_rotor_that_is_not_symmetric(ways):
    assert "not steady" in refusal(rotor_on_an_arm(ways, (0.0, 0.0, 0.0), cross=0.0062)[0].equilibrium)


@pytest.mark.parametrize("ways", [(C, C), (K, K)])
def test_a_force_that_stays_where_the_machine_turns_is_no_input(ways):
    scene, *_, place = beaded(ways)
    eq = scene.equilibrium()
    said = refusal(lambda: scene.linearize(about=eq, inputs=[fm.force.FrameForce(place, (1.0, 0.0, 0.0))]))
    assert "changes along the steady motion" in said
    along = fm.force.FrameForce(place, (1.0, 0.0, 0.0), axes=fm.force.Axes.FRAME)
    assert scene.linearize(about=eq, inputs=[along]).V.any()
