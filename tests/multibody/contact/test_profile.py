"""Planar profiles: distances by brute force and closed forms, cams, a Geneva drive, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.signed_distance import distance, gradient_variation


@entry_kernel
def ask(data, p, dp, out):
    far, n = distance(data, 0, (p[0], p[1], p[2]))
    dn = gradient_variation(data, 0, (p[0], p[1], p[2]), (dp[0], dp[1], dp[2]))
    out[0] = far
    for k in range(3):
        out[1 + k], out[4 + k] = n[k], dn[k]


def asked(shape, p, dp=(0.0, 0.0, 0.0)):
    """Distance, gradient, and its change."""
    numbers = shape.numbers()
    numbers[1] = 4.0
    out = np.zeros(7)
    ask(np.concatenate([numbers, shape.table.values]), np.array([*p, 0.0][:3]), np.array(dp), out)
    return out[0], out[1:4], out[4:]


def ground():
    return fm.System().ground.frame()


def blob(n=40, size=1.0):
    """Points on a closed curve with hollows."""
    a = 2.0 * np.pi * np.arange(n) / n
    r = size * (1.0 + 0.25 * np.cos(3.0 * a) + 0.1 * np.sin(5.0 * a))
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


KEY = ([(0, 0), (2, 0), (2, 1), (1.2, 1), (1.2, 0.4), (0.8, 0.4), (0.8, 1), (0, 1)], [0, 0.3, 0, 0, -1, 0, 0, 0.6])


def brute(profile, p, n=1000):
    """Distance from chords along the pieces, signed by the winding number."""
    x = np.concatenate([piece.at(np.linspace(0.0, 1.0, n)[:-1]) for piece in profile._pieces])
    y = np.roll(x, -1, axis=0)
    t = np.clip(np.einsum("ij,ij->i", p - x, y - x) / np.einsum("ij,ij->i", y - x, y - x), 0.0, 1.0)
    far = np.linalg.norm(x + t[:, None] * (y - x) - p, axis=1).min()
    a = np.arctan2(*(x - p).T[::-1])
    turns = np.angle(np.exp(1j * (np.roll(a, -1) - a))).sum() / (2.0 * np.pi)
    return far if abs(turns) < 0.5 else -far


def shapes(size=1.0):
    points, bulges = np.array(KEY[0]) * size, KEY[1]
    return {
        "arcs and lines": contact.Profile(ground(), points, bulges),
        "the other way round": contact.Profile(ground(), points[::-1], -np.roll(bulges[::-1], -1)),
        "spline": contact.Profile(ground(), blob(size=size), spline=True),
    }


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", ["arcs and lines", "the other way round", "spline"])
def test_distances_are_those_of_brute_force(name, size):
    profile = shapes(size)[name]
    rng = np.random.default_rng(5)
    p = rng.uniform(-1.7, 2.5, (30, 2)) * size
    p[::2] *= 0.4
    found = profile.signed_distance(np.column_stack([p, rng.normal(size=30)]))
    expected = np.array([brute(profile, one) for one in p])
    assert found == pytest.approx(expected, rel=2e-6, abs=2e-6 * size)
    assert (expected < 0.0).sum() > 3


@pytest.mark.parametrize("name", ["arcs and lines", "spline"])
def test_gradients_and_their_variations_are_those_of_differences(name):
    profile = shapes()[name]
    rng = np.random.default_rng(2)
    h = 1e-6
    for _ in range(40):
        p, dp = np.array([*rng.uniform(-1.5, 2.3, 2), 0.3]), rng.normal(size=3)
        far, n, dn = asked(profile, p, dp)
        ahead, back = asked(profile, p + h * dp), asked(profile, p - h * dp)
        if np.abs(ahead[1] - back[1]).max() > 1e-2:  # between two nearest points
            continue
        assert n @ dp == pytest.approx((ahead[0] - back[0]) / (2.0 * h), abs=1e-8)
        assert dn == pytest.approx((ahead[1] - back[1]) / (2.0 * h), abs=1e-5 / min(1.0, abs(far)) ** 2)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-14)


def test_an_ellipse_through_points_has_its_own_distance_to_the_fourth_order():
    def fault(n):
        a = 2.0 * np.pi * np.arange(n) / n
        profile = contact.Profile(ground(), np.stack([2.0 * np.cos(a), np.sin(a)], axis=1), spline=True)
        faults = []
        for turn in np.linspace(0.3, 6.0, 9):
            on = np.array([2.0 * np.cos(turn), np.sin(turn)])
            normal = np.array([np.cos(turn), 2.0 * np.sin(turn)])
            faults.append(asked(profile, on + 0.3 * normal / np.linalg.norm(normal))[0] - 0.3)
        return np.abs(faults).max()

    assert fault(64) < 1e-4
    assert fault(128) < fault(64) / 12.0


def test_a_disc_of_two_half_circles_is_the_cylinder():
    disc = contact.Profile(ground(), [(-0.5, 0.0), (0.5, 0.0)], [1.0, 1.0])
    assert disc.signed_distance([(0.3, 0.4, 1.0), (0.1, 0.0, 0.0), (3.0, 4.0, 0.0)]) == pytest.approx([0.0, -0.4, 4.5])


def test_thickness_is_that_of_the_thinnest_part():
    bar = contact.Profile(ground(), [(0, 0), (3, 0), (3, 0.2), (0, 0.2)])
    assert bar.numbers()[2] == pytest.approx(0.1, rel=1e-2)


def follower(speed, *, size=1.0, R=None):
    """A roller under a spring on a driven eccentric disc; lift over time, and its closed form."""
    e, r, disc = 0.01 * size, 0.01 * size, 0.03 * size
    turned = np.eye(3) if R is None else R
    scene = fm.System()
    cam = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="cam")
    rod = scene.add(fm.RigidBody(0.3, (1.0, 1.0, 1.0)), name="rod")
    at = scene.ground.frame(R=turned)
    turn = scene.connect(fm.joint.Revolute("z"), at, cam.frame())
    slide = scene.connect(fm.joint.Prismatic("y"), at, rod.frame())
    turn.prescribe(lambda t: (speed * t, speed, 0.0))
    scene.add_force(fm.force.JointSpring(slide, 2e3 / size, rest=-0.05 * size))
    a = 2.0 * np.pi * np.arange(120) / 120
    outline = np.stack([e + disc * np.cos(a), disc * np.sin(a)], axis=1)
    law = contact.PowerLaw(k=3e7 / size, restitution=0.3, speed=1e-2 * size)
    pair = scene.touch(
        contact.Profile(cam.frame(), outline, spline=True), contact.Sphere(rod.frame(), r), law
    )
    start = np.sqrt((disc + r) ** 2 - e**2)
    slide.position = start
    slide.velocity = e * speed
    run = scene.simulate(1.5 * np.pi / speed, rtol=1e-7)
    s = np.sin(speed * run.t)
    exact = e * s + np.sqrt((disc + r) ** 2 - e**2 * (1.0 - s**2))
    return run, run.beta(slide), exact, run.contacts(pair)[0]


def test_a_roller_follows_an_eccentric_disc():
    run, y, exact, met = follower(20.0)
    later = run.t > 0.02
    assert np.abs(y - exact)[later].max() < 2e-5
    assert (met.gap < 0.0)[later].all()
    depth = met.normal_force / 3e7
    assert y[later] == pytest.approx(exact[later], abs=2.0 * depth.max())


def test_a_geneva_wheel_dwells_and_is_indexed():
    """Four slots: a quarter of a turn for each of the driver's, while its pin is in a slot; Norton 2009, section 2.12.

    Driven angle while engaged: atan(sin a / (sqrt(2) - cos a)) from the line of centres, a the driver's.
    """
    centre, pin = 0.1, 0.004  # m between the axes, the pin's radius
    crank = centre * np.sin(np.pi / 4.0)
    reach, depth = centre * np.cos(np.pi / 4.0), centre - crank - pin - 0.003
    half = pin + 2e-5  # of a slot
    quarter = [(reach, -half), (depth, -half), (depth, half), (reach, half)]
    points, bulges = [], []
    for k in range(4):
        a = 0.5 * np.pi * k + np.pi / 4.0
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        points += [turn @ one for one in quarter]
        bulges += [0.0, -1.0, 0.0, 0.0]
    scene = fm.System()
    driver = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="driver")
    wheel = scene.add(fm.RigidBody(0.3, (2e-4, 2e-4, 2e-4)), name="wheel")
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), driver.frame())
    turns = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(centre, 0.0, 0.0)), wheel.frame())
    speed = 2.0
    drive.prescribe(lambda t: (speed * t - np.pi / 3.0, speed, 0.0))
    scene.add_force(fm.force.JointFriction(turns, 0.02, 1e-3))
    law = contact.PowerLaw(k=1e7, restitution=0.1, speed=0.05)
    profile = contact.Profile(wheel.frame(), points, bulges)
    scene.touch(profile, contact.Sphere(driver.frame(p=(crank, 0.0, 0.0)), pin), law)
    run = scene.simulate((2.0 * np.pi / 3.0) / speed, rtol=1e-6)
    a, driven = speed * run.t - np.pi / 3.0, run.beta(turns)
    engaged = np.abs(a) < np.pi / 4.0
    exact = -np.arctan2(np.sin(a), np.sqrt(2.0) - np.cos(a)) - np.pi / 4.0
    play = (half - pin) / (centre - crank)  # rad, where the pin is next to the wheel's axis
    assert np.abs(driven - exact)[engaged].max() < 1.1 * play
    # driven by one side throughout, for friction holds it back: the slot's middle lags by the play
    within = np.abs(a) < 0.6
    lag = np.arcsin((half - pin) / np.sqrt(centre**2 + crank**2 - 2.0 * centre * crank * np.cos(a)))
    assert driven[within] == pytest.approx((exact + lag)[within], abs=0.02 * play)
    assert np.abs(driven[a < -np.pi / 4.0]).max() < play
    assert np.abs(driven + 0.5 * np.pi)[a > np.pi / 4.0].max() < play
    assert np.count_nonzero(a < -np.pi / 4.0) > 2 < np.count_nonzero(a > np.pi / 4.0)


def refused(said, *given, **named):
    with pytest.raises(SceneError, match=said):
        contact.Profile(ground(), *given, **named)


def test_curves_that_enclose_nothing_are_refused():
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    refused("2 points enclose nothing", square[:2])
    refused("2 points enclose nothing", square[:2], spline=True)
    refused("at one place", [*square[:2], square[1], *square[2:]])
    refused("crosses or touches itself", [square[k] for k in (0, 2, 1, 3)])
    refused("crosses or touches itself", [(0, 0), (1, 0), (1, 1), (0.5, 0), (0, 1)])
    refused("crosses or touches itself", square, [-1.1, 0.0, -1.1, 0.0])
    refused("turns back on itself", [(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (1, 1), (0, 1)][:6])
    refused("turns back", [(0, 0), (1, 0), (2, 0)])
    refused("finite numbers of shape", [(0.0, 0.0, 0.0)])
    refused("points must be finite", [(0.0, np.nan), (1.0, 0.0), (1.0, 1.0)])
    refused("bulges must be 4", square, [0.0, 1.0])
    refused("a spline has none", square, [0.0] * 4, spline=True)
    refused("spline must be", square, spline="yes")
    for collinear in (square, [(0, 0), (3, 0), (3, 1), (2, 1), (2, 0.5), (1, 0.5), (1, 1), (0, 1)]):
        assert contact.Profile(ground(), [*collinear, collinear[0]]).table


def test_hertz_is_refused_by_name():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    profile = contact.Profile(scene.ground.frame(), blob(), spline=True)
    with pytest.raises(SceneError, match="take PowerLaw"):
        scene.touch(profile, contact.Sphere(body.frame(), 0.1), contact.Hertz(E=2e11))


def in_a_slot(width, *, radius=0.01, k=1e5, mass=0.2, gravity=(0.0, 0.0, 0.0), start=0.0):
    """A roller that moves across a slot (along y) of a profile on the ground."""
    half, wall = 0.5 * width, 0.03
    points = [
        (-0.1, -wall), (0.1, -wall), (0.1, -half), (-0.05, -half),
        (-0.05, half), (0.1, half), (0.1, wall), (-0.1, wall),
    ]  # fmt: skip
    scene = fm.System(gravity=gravity)
    body = scene.add(fm.RigidBody(mass, (1.0, 1.0, 1.0)), name="roller")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), body.frame())
    slide.position = start
    profile = contact.Profile(scene.ground.frame(), points)
    pairs = scene.touch(profile, contact.Sphere(body.frame(), radius), contact.PowerLaw(k=k))
    return scene, slide, pairs


def test_a_roller_that_is_pressed_into_a_slot_is_held_by_both_sides():
    """Twice as stiff as by one: it swings about the middle at sqrt(2 k / m)."""
    pressed, start = 2e-5, 1e-5  # m: half of what the roller is too large by, and aside
    scene, slide, pairs = in_a_slot(2.0 * (0.01 - pressed), start=start)
    assert len(pairs) == 2
    assert pairs[1].what.endswith("second point")
    omega = np.sqrt(2.0 * 1e5 / 0.2)
    run = scene.simulate(4.0 * np.pi / omega, rtol=1e-8)
    assert run.beta(slide) == pytest.approx(start * np.cos(omega * run.t), abs=1e-5 * start)
    forces = np.array([one.normal_force for one in run.contacts(pairs)])
    assert forces.sum(axis=0) == pytest.approx(2.0 * 1e5 * pressed, rel=1e-6)


def test_a_roller_with_play_goes_to_and_fro_between_the_sides():
    play, speed, mass, k = 1e-4, 0.05, 0.2, 1e7
    scene, slide, pairs = in_a_slot(2.0 * (0.01 + play), k=k, mass=mass)
    slide.velocity = speed
    period = 4.0 * play / speed + 2.0 * np.pi * np.sqrt(mass / k)
    run = scene.simulate(3.0 * period, rtol=1e-8)
    assert run.beta(slide)[-1] == pytest.approx(0.0, abs=1e-4 * play)
    assert run.velocity(pairs[0].frame_G)[-1, 1] == pytest.approx(speed, rel=1e-5)


def test_a_roller_in_a_groove_lies_on_both_flanks():
    radius, k, mass = 0.01, 1e6, 0.5
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = scene.add(fm.RigidBody(mass, (1e-4,) * 3), name="roller")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    depth = mass * 9.81 / np.sqrt(2.0) / k
    free.position = (0.0, np.sqrt(2.0) * (radius - depth), 0.0, 1.0, 0.0, 0.0, 0.0)
    groove = contact.Profile(scene.ground.frame(), [(-0.2, -0.1), (0.2, -0.1), (0.1, 0.1), (0.0, 0.0), (-0.1, 0.1)])
    pairs = scene.touch(groove, contact.Sphere(body.frame(), radius), contact.PowerLaw(k=k, restitution=0.5, speed=0.1))
    run = scene.simulate(0.5)
    forces = [one.normal_force[-1] for one in run.contacts(pairs)]
    assert forces == pytest.approx([mass * 9.81 / np.sqrt(2.0)] * 2, rel=1e-9)
    assert np.abs(run.position(body.frame()) - run.position(body.frame())[0]).max() < 1e-10


@pytest.mark.parametrize("name", ["arcs and lines", "spline", "star"])
def test_a_second_point_is_never_nearer_than_the_first_and_never_behind_the_curve(name):
    angle = np.arange(10) * 2.0 * np.pi / 10
    reach = np.where(np.arange(10) % 2, 0.25, 1.5)
    star = contact.Profile(ground(), reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    profile = star if name == "star" else shapes()[name]
    numbers = profile.numbers()
    numbers[1], numbers[3] = 4.0, 1.0
    data, rng, found = np.concatenate([numbers, profile.table.values]), np.random.default_rng(11), 0
    for _ in range(400):
        p, out = np.array([*rng.uniform(-1.5, 2.3, 2), 0.0]), np.zeros(7)
        ask(data, p, np.zeros(3), out)
        first, n, _ = asked(profile, p)
        if first > 0.0:
            assert out[0] >= first
            foot = p - out[0] * out[1:4]
            if np.abs(profile.signed_distance([foot])[0]) < 1e-9:
                found += 1
                assert n @ out[1:4] <= np.cos(0.5) + 1e-9
    assert found > 20


def test_second_points_are_looked_for_where_a_roller_may_meet_them():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    frame, soft = scene.ground.frame(), contact.PowerLaw(k=1.0)
    egg = contact.Profile(frame, blob(), spline=True)
    assert 0.05 < egg.hollow < 1.0
    for shape, radius, count in (
        (egg, 0.01, 1), (egg, 1.0, 2), (contact.Profile(frame, [(0, 0), (1, 0), (1, 1), (0, 1)]), 5.0, 1),
        (contact.Profile(frame, [(0, 0), (2, 0), (2, 2), (1, 1), (0, 2)]), 0.01, 2),
    ):  # fmt: skip
        assert len(scene.touch(shape, contact.Sphere(body.frame(), radius), soft)) == count
    assert len(scene.touch(egg, contact.Vertex(body.frame()), soft)) == 1
