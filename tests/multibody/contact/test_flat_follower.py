"""Half spaces on profiles: support functions by brute force, cams under flat followers by closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact import lowest_point as kinds
from flexmbd.multibody.kernels.contact import signed_distance
from flexmbd.multibody.kernels.contact.lowest_point import centre_arm, centre_arm_variation
from flexmbd.multibody.kernels.contact.normal_force import CENTRE, LOWEST
from flexmbd.multibody.kernels.contact.profile_support import profile_support

G = 9.81


@entry_kernel
def farthest(data, u, out):
    point, radius = profile_support(data, 0, (u[0], u[1], 0.0))
    out[0], out[1], out[2], out[3] = point[0], point[1], point[2], radius


@entry_kernel
def arms(data, R, turn, out):
    m = (R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2])
    arm = centre_arm(data, 0, m)
    change = centre_arm_variation(data, 0, m, arm, (turn[0], turn[1], turn[2]))
    for k in range(3):
        out[0, k], out[1, k] = arm[k], change[k]


def ground():
    return fm.System().ground.frame()


def blob(n=40, size=1.0):
    """Points on a closed curve with hollows."""
    a = 2.0 * np.pi * np.arange(n) / n
    r = size * (1.0 + 0.25 * np.cos(3.0 * a) + 0.1 * np.sin(5.0 * a))
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


KEY = ([(0, 0), (2, 0), (2, 1), (1.2, 1), (1.2, 0.4), (0.8, 0.4), (0.8, 1), (0, 1)], [0, 0.3, 0, 0, -1, 0, 0, 0.6])


def shapes(size=1.0):
    points, bulges = np.array(KEY[0]) * size, KEY[1]
    return {
        "arcs and lines": contact.Profile(ground(), points, bulges),
        "a disc": contact.Profile(ground(), size * np.array([(-0.3, 0.1), (0.5, 0.2)]), [1.0, 1.0]),
        "spline": contact.Profile(ground(), blob(size=size), spline=True),
        "few points": contact.Profile(ground(), blob(7, size=size), spline=True),
    }


@pytest.mark.parametrize("size", [1e-3, 1e3])
@pytest.mark.parametrize("name", ["arcs and lines", "a disc", "spline", "few points"])
def test_the_farthest_point_is_that_of_brute_force(name, size):
    profile = shapes(size)[name]
    edge = np.concatenate([piece.at(np.linspace(0.0, 1.0, 4001)) for piece in profile._pieces])
    for angle in np.linspace(0.1, 6.3, 37):
        u, out = np.array([np.cos(angle), np.sin(angle)]), np.zeros(4)
        farthest(profile.table.values, u, out)
        assert out[:2] @ u == pytest.approx((edge @ u).max(), abs=3e-7 * size)
        assert out[:2] @ u >= (edge @ u).max() - 1e-14 * size
        assert np.linalg.norm(edge - out[:2], axis=1).min() < 1e-3 * size  # it is on the curve


def lowest(kind, *given, table=(), centre=(0.1, -0.2, 0.3)):
    data = np.zeros(LOWEST + 3 + len(table))
    data[0], data[1:4] = signed_distance.HALF_SPACE, np.array([1.0, 2.0, -2.0]) / 3.0
    data[CENTRE : CENTRE + 3] = centre
    data[LOWEST : LOWEST + 3] = [kind, *given, *[0.0] * (2 - len(given))]
    data[LOWEST + 3 :] = table
    return data


LOWEST_POINTS = {
    "fixed": lowest(kinds.FIXED),
    "rim": lowest(kinds.RIM, 0.7, 7e-5),
    "crowned": lowest(kinds.RIM, 0.7, 0.2),
    "arcs": lowest(kinds.OUTLINE, LOWEST + 3, table=shapes()["a disc"].table.values),
    "spline": lowest(kinds.OUTLINE, LOWEST + 3, table=shapes()["spline"].table.values),
}


@pytest.mark.parametrize("name", LOWEST_POINTS)
def test_variations_of_lowest_points_are_those_of_differences(name):
    data = LOWEST_POINTS[name]
    rng = np.random.default_rng(4)
    for turn in Rotation.random(8, rng=rng):
        change, h = rng.normal(size=3), 1e-6
        found, ahead, back = (np.zeros((2, 3)) for _ in range(3))
        arms(data, turn.as_matrix(), change, found)
        arms(data, (Rotation.from_rotvec(h * change) * turn).as_matrix(), change, ahead)
        arms(data, (Rotation.from_rotvec(-h * change) * turn).as_matrix(), change, back)
        if np.abs(ahead[0] - back[0]).max() > 1e-3:  # from one hump to the next
            continue
        assert found[1] == pytest.approx((ahead[0] - back[0]) / (2.0 * h), abs=2e-4)


def test_a_rim_s_lowest_point_is_lower_than_all_others():
    data = LOWEST_POINTS["rim"]
    n, angle = data[1:4], np.linspace(0.0, 2.0 * np.pi, 4001)
    circle = data[CENTRE : CENTRE + 3] + 0.7 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    for turn in Rotation.random(20, rng=np.random.default_rng(6)):
        out = np.zeros((2, 3))
        arms(data, turn.as_matrix(), np.zeros(3), out)
        assert out[0] @ n == pytest.approx((turn.apply(circle) @ n).min(), abs=1e-6)
    out = np.zeros((2, 3))
    arms(data, Rotation.align_vectors([n], [[0.0, 0.0, -1.0]])[0].as_matrix(), np.zeros(3), out)  # it lies on a face
    assert out[0] @ n == pytest.approx(-(data[CENTRE + 2] + 7e-5), abs=1e-12)


def followed(profile_of, *, speed, height, rate, gravity=0.0, R=None, end=1.0, k=1e8, lift=2e4):
    """A follower with a flat face under a spring on a driven cam; at rest at ``height``, that follows at ``rate``."""
    scene = fm.System()
    cam = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cam")
    rod = scene.add(fm.RigidBody(0.3, (1.0, 1.0, 1.0)), name="rod")
    at = scene.ground.frame(R=np.eye(3) if R is None else R)
    turn = scene.connect(fm.joint.Revolute("z"), at, cam.frame())
    slide = scene.connect(fm.joint.Prismatic("y"), at, rod.frame())
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    scene.add_force(fm.force.JointSpring(slide, lift, rest=-0.05))
    law = contact.PowerLaw(k=k, restitution=0.3, speed=1e-2)
    pair = scene.touch(contact.HalfSpace(rod.frame(), (0.0, -1.0, 0.0)), profile_of(cam.frame()), law)
    slide.position, slide.velocity = height - lift * (height + 0.05) / k, rate
    run = scene.simulate(end * 2.0 * np.pi / speed, rtol=1e-7)
    return run, run.beta(slide), run.contacts(pair)[0]


@pytest.mark.parametrize("R", [None, Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()])
def test_a_flat_follower_on_an_eccentric_disc_moves_as_a_sine(R):
    e, disc, speed = 0.01, 0.03, 15.0
    run, y, met = followed(
        lambda frame: contact.Profile(frame, [(e - disc, 0.0), (e + disc, 0.0)], [1.0, 1.0]),
        speed=speed, height=disc, rate=e * speed, R=R,
    )  # fmt: skip
    exact = disc + e * np.sin(speed * run.t)
    assert y - met.gap == pytest.approx(exact, abs=1e-12)  # as deep as it is: geometry
    assert np.abs(y - exact).max() < 1.2 * 2e4 * 0.09 / 1e8
    assert (met.gap < 0.0).all()
    bears = 2e4 * (y + 0.05) - 0.3 * e * speed**2 * np.sin(speed * run.t)
    later = run.t > 0.05
    assert met.normal_force[later] == pytest.approx(bears[later], rel=2e-2)


def test_a_cam_of_a_support_function_lifts_its_follower_by_it():
    """h (phi) of the angle from the cam's x axis: the cam is h u + h' du/dphi, it touches at h' beside the axis."""
    speed = 10.0

    def h(phi):
        return 0.045 - 0.005 * np.cos(2.0 * phi), 0.01 * np.sin(2.0 * phi)

    a = 2.0 * np.pi * np.arange(180) / 180
    reach, slope = h(a)
    u, across = np.stack([np.cos(a), np.sin(a)], axis=1), np.stack([-np.sin(a), np.cos(a)], axis=1)
    points = reach[:, None] * u + slope[:, None] * across
    run, y, met = followed(
        lambda frame: contact.Profile(frame, points, spline=True), speed=speed, height=h(0.5 * np.pi)[0], rate=0.0
    )
    phi = 0.5 * np.pi - speed * run.t
    assert y - met.gap == pytest.approx(h(phi)[0], abs=1e-8)
    assert met.point[:, 0] == pytest.approx(-h(phi)[1], abs=1e-6)


def test_an_ellipse_that_rocks_on_a_floor_keeps_its_energy_and_its_rate():
    """Without friction: of small rockings I omega^2 = m g (R - h), R = a^2 / b the radius of curvature below."""
    long, high, mass, k, tilt = 0.2, 0.1, 1.0, 1e7, 2e-3
    a = 2.0 * np.pi * np.arange(240) / 240
    inertia = 0.25 * mass * (long**2 + high**2)
    scene = fm.System(gravity=(0.0, -G, 0.0))
    body = scene.add(fm.RigidBody(mass, (inertia, inertia, inertia)), name="ellipse")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, high - mass * G / k, 0.0, np.cos(0.5 * tilt), 0.0, 0.0, np.sin(0.5 * tilt))
    profile = contact.Profile(body.frame(), np.stack([long * np.cos(a), high * np.sin(a)], axis=1), spline=True)
    scene.touch(contact.HalfSpace(scene.ground.frame(), "y"), profile, contact.PowerLaw(k=k))
    omega = np.sqrt(mass * G * (long**2 / high - high) / inertia)
    end = 2.0 * np.pi / omega
    run = scene.simulate(end, rtol=1e-9)
    t = np.linspace(0.0, end, 401)
    found = np.arcsin(run.rotation(body.frame(), t=t)[:, 1, 0])
    assert found == pytest.approx(tilt * np.cos(omega * t), abs=0.02 * tilt)
    assert np.ptp(run.energy().total) < 1e-6 * mass * G * (long - high) * tilt


def test_what_a_flat_follower_is_not_is_refused():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cam")
    cam, floor = contact.Profile(body.frame(), blob(), spline=True), contact.HalfSpace(scene.ground.frame(), "y")
    with pytest.raises(SceneError, match="take PowerLaw"):
        scene.touch(floor, cam, contact.Hertz(E=2e11))
    with pytest.raises(SceneError, match="has no hard contact yet"):
        scene.touch(floor, cam, contact.Hard())
    rolls = contact.Friction(0.3, stiffness=1.0, damping=1.0, load=1.0, rolling=1e-3)
    with pytest.raises(SceneError, match="leave rolling and spinning out"):
        scene.touch(floor, cam, contact.PowerLaw(k=1.0), friction=rolls)
    with pytest.raises(SceneError, match="no such pair"):
        scene.touch(cam, contact.Profile(scene.ground.frame(), blob(), spline=True), contact.PowerLaw(k=1.0))
