"""Discs, wheels, coins and bars with ends: distances by brute force, rest, rolling and spinning by closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.contact.signed_distance import distances

G = 9.81
EXPLICIT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
STEEL = {"E": 2.1e11, "nu": 0.3}


def ground():
    return fm.System().ground.frame()


def quaternion(turn):
    return np.roll(turn.as_quat(), 1)


def wheel(
    law, *, radius=0.1, thickness=0.0, rounding=0.0, mass=1.0, turn=None, place=(0.0, 0.0, 0.1), velocity=(0.0,) * 6,
    friction=None, gravity=(0.0, 0.0, -G), world=None, inertia=None, crown=None,
):  # fmt: skip
    """A disc before a floor; ``velocity``: of its centre, and its spin, in the floor's axes; ``world`` turns it all."""
    world = Rotation.identity() if world is None else world
    turn = Rotation.identity() if turn is None else turn
    axial = 0.5 * mass * radius**2
    across = 0.25 * mass * radius**2 + mass * thickness**2 / 12.0
    scene = fm.System(gravity=tuple(world.apply(gravity)))
    body = scene.add(fm.RigidBody(mass, (across, across, axial) if inertia is None else inertia), name="wheel")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    velocity = np.array(velocity, float)
    free.position = (*world.apply(place), *quaternion(world * turn))
    free.velocity = (*world.apply(velocity[:3]), *turn.inv().apply(velocity[3:]))
    disc = contact.Disc(body.frame(), radius, thickness, rounding, crown)
    floor = contact.HalfSpace(scene.ground.frame(R=world.as_matrix()))
    return scene, body, scene.touch(floor, disc, law, friction=friction)


def outline(radius, thickness, rounding, n=20001):
    """Points (r, z) of a quarter of the cross section."""
    a, h, s = radius - rounding, 0.5 * thickness - rounding, np.linspace(0.0, 1.0, n)
    arc = np.stack([a + rounding * np.sin(0.5 * np.pi * s), h + rounding * np.cos(0.5 * np.pi * s)], axis=1)
    face = np.stack([a * s, np.full(n, 0.5 * thickness)], axis=1)
    side = np.stack([np.full(n, radius), h * s], axis=1)
    return np.vstack([face, arc, side])


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("sizes", [(1.0, 0.6, 0.0), (1.0, 0.6, 0.2), (0.4, 2.0, 0.1), (1.0, 0.5, 0.25)])
def test_distances_are_those_of_brute_force(sizes, size):
    radius, thickness, rounding = size * np.array(sizes)
    rng = np.random.default_rng(3)
    p = rng.uniform(-1.6, 1.6, (40, 3)) * size
    p[::3] *= 0.25
    out = np.zeros((len(p), 4))
    distances(contact.Disc(ground(), radius, thickness, rounding).numbers(), p, out)
    edge = outline(radius, thickness, rounding)
    where = np.stack([np.hypot(p[:, 0], p[:, 1]), np.abs(p[:, 2])], axis=1)
    far = np.array([np.linalg.norm(edge - one, axis=1).min() for one in where])
    beyond = np.maximum(where - [radius - rounding, 0.5 * thickness - rounding], 0.0)
    inside = np.linalg.norm(beyond, axis=1) < rounding if rounding > 0.0 else (beyond == 0.0).all(axis=1)
    assert out[:, 0] == pytest.approx(np.where(inside, -far, far), rel=1e-6, abs=1e-6 * size)
    assert inside.sum() > 4
    assert np.linalg.norm(out[:, 1:], axis=1) == pytest.approx(1.0, abs=1e-14)
    moved = np.zeros((len(p), 4))
    distances(contact.Disc(ground(), radius, thickness, rounding).numbers(), p + 1e-7 * size * out[:, 1:], moved)
    assert moved[:, 0] - out[:, 0] == pytest.approx(1e-7 * size, rel=1e-5)


@pytest.mark.parametrize(
    ("turn", "points", "sizes"),
    [
        (Rotation.identity(), 1, (0.1, 0.3, 0.0)),  # on a face
        (Rotation.from_euler("x", 180, degrees=True), 1, (0.1, 0.3, 0.02)),  # on the other one
        (Rotation.from_euler("yz", [90, 20], degrees=True), 2, (0.1, 0.3, 0.0)),  # on its side
        (Rotation.from_euler("y", 90, degrees=True), 1, (0.1, 0.0, 0.0)),  # a thin one on its rim
        (Rotation.from_euler("x", 90, degrees=True), 1, (0.1, 0.04, 0.02)),  # a round rim
    ],
)
def test_it_rests_on_as_many_points_as_its_position_has(turn, points, sizes):
    k, mass = 1e5, 2.0
    radius, thickness, rounding = sizes
    flat = abs(turn.as_matrix()[2, 2]) > 0.5
    low = 0.5 * thickness if flat else radius
    place = (0.3, -0.2, low - mass * G / (points * k))
    scene, body, pairs = wheel(
        contact.PowerLaw(k=k, restitution=0.3, speed=0.1), radius=radius, thickness=thickness, rounding=rounding,
        mass=mass, turn=turn, place=place,
    )  # fmt: skip
    assert len(pairs) == (1 if thickness == 2.0 * rounding else 2)
    run = scene.simulate(0.3 if flat or points > 1 else 0.02)
    forces = np.array([one.normal_force[0] for one in run.contacts(pairs)])
    assert np.sort(forces)[-points:] == pytest.approx(mass * G / points, rel=1e-9)
    assert np.count_nonzero(forces) == points
    assert np.abs(run.position(body.frame()) - place).max() < 1e-9


def test_a_can_rocks_on_its_face_as_the_crown_says_and_comes_to_rest_by_rolling_resistance():
    """I omega^2 = m g (R^2 / crown - h) of small tilts; then a moment holds it, and its bristle is damped."""
    radius, height, crown, k, tilt = 0.1, 0.08, 2e-3, 1e7, 2e-4
    turn = Rotation.from_euler("xy", [tilt, 0.0])
    inertia = 0.25 * radius**2 + height**2 / 12.0
    for rolling in (0.0, 1e-3):
        rough = contact.Friction(0.5, stiffness=k, damping=0.3 * np.sqrt(k), load=G, rolling=rolling)
        scene, body, pairs = wheel(
            contact.PowerLaw(k=k, restitution=0.3, speed=1e-2), radius=radius, thickness=height, crown=crown, turn=turn,
            place=(0.0, 0.0, 0.5 * height - G / k), friction=rough,
        )  # fmt: skip
        omega = np.sqrt(G * (radius**2 / crown - 0.5 * height) / (inertia + (0.5 * height) ** 2))
        run = scene.simulate(2.0 * np.pi / omega, rtol=1e-7)
        leans = run.rotation(body.frame())[:, 2, 1]
        if rolling == 0.0:
            assert leans == pytest.approx(tilt * np.cos(omega * run.t), abs=0.02 * tilt)
        else:
            assert np.abs(run.v[-1, :6]).max() < 1e-6
            assert run.contacts(pairs)[0].normal_force[-1] == pytest.approx(G, rel=1e-6)


def test_a_linear_machine_has_a_can_s_rocking_and_bouncing_on_ice():
    """I omega^2 = m g (R^2 / crown - h) about its centre, twice, and k / m; the other motions are free."""
    radius, height, crown, k = 0.1, 0.3, 2e-3, 1e6
    scene, body, _ = wheel(
        contact.PowerLaw(k=k), radius=radius, thickness=height, crown=crown, place=(0.0, 0.0, 0.5 * height - 1e-7)
    )
    about = scene.equilibrium()
    assert about.position(body.frame())[2] == pytest.approx(0.5 * height - G / k, abs=1e-12)
    found = np.sort(np.abs(scene.linearize(about=about).eigenvalues().imag))
    rocking = np.sqrt(G * (radius**2 / crown - 0.5 * height) / (0.25 * radius**2 + height**2 / 12.0))
    assert found == pytest.approx([0.0] * 6 + [rocking] * 4 + [np.sqrt(k)] * 2, rel=1e-9, abs=1e-6)


def test_a_can_that_is_dropped_askew_ends_on_a_face():
    rough = contact.Friction(0.3, stiffness=1e5, damping=30.0, load=G, rolling=2e-3, spinning=2.0 / 3.0 * 0.3 * 0.1)
    law = contact.PowerLaw(k=1e5, restitution=0.3, speed=0.1)
    turn = Rotation.from_euler("xy", [10, 5], degrees=True)
    scene, body, pairs = wheel(
        law, radius=0.1, thickness=0.08, rounding=5e-3, turn=turn, place=(0.0, 0.0, 0.08), friction=rough,
        velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 0.5),
    )  # fmt: skip
    run = scene.simulate(3.0, rtol=1e-5)
    assert run.rotation(body.frame())[-1, 2, 2] == pytest.approx(1.0, abs=1e-5)
    assert np.abs(run.v[-1, :6]).max() < 1e-4
    assert sum(one.normal_force[-1] for one in run.contacts(pairs)) == pytest.approx(G, rel=1e-3)
    assert np.diff(run.energy().total).max() < 1e-6


@pytest.mark.parametrize("share", [0.98, 1.02])
@pytest.mark.parametrize("way", [0.4, 2.5])
def test_a_can_on_an_incline_topples_where_its_weight_leaves_its_face(share, way):
    """tan(slope) = radius / half the height, towards whatever side."""
    radius, thickness = 0.1, 0.3
    slope = share * np.arctan(radius / (0.5 * thickness))
    gravity = G * np.array([np.sin(slope) * np.cos(way), np.sin(slope) * np.sin(way), -np.cos(slope)])
    k = 1e7
    rough = contact.Friction(5.0, stiffness=k, damping=0.3 * np.sqrt(k), load=G)
    scene, body, _ = wheel(
        contact.PowerLaw(k=k, restitution=0.2, speed=1e-3), radius=radius, thickness=thickness,
        place=(0.0, 0.0, 0.5 * thickness), gravity=gravity, friction=rough,
    )  # fmt: skip
    run = scene.simulate(1.2, rtol=1e-5)
    upright = run.rotation(body.frame())[:, 2, 2]
    if share < 1.0:
        assert upright.min() > 1.0 - 1e-4
    else:
        assert upright.min() < 0.9
        down = run.rotation(body.frame())[np.argmin(upright), :2, 2]
        assert np.arctan2(down[1], down[0]) == pytest.approx(way, abs=1e-3)


def wobble(radius=0.3, tilt=1.2):
    """Turn, centre, and a rolling motion (6,) of a disc, in the floor's axes."""
    turn = Rotation.from_euler("x", tilt)
    rate = turn.apply([0.2, 0.5, 6.0])
    speed = np.cross(rate, radius * turn.apply([0.0, 1.0, 0.0]))
    return turn, np.array([0.0, 0.0, radius * np.sin(tilt)]), np.array([*speed, *rate])


def rolls_by_constraints(end):
    turn, place, velocity = wobble()
    scene = fm.System(gravity=(0.0, 0.0, -G))
    disc = scene.add(fm.RigidBody(2.0, (0.045, 0.045, 0.09)), name="disc")
    fly = scene.connect(fm.joint.Free(), scene.ground.frame(), disc.frame())
    fly.position, fly.velocity = (*place, *quaternion(turn)), (*velocity[:3], *turn.inv().apply(velocity[3:]))
    scene.connect(fm.joint.RollingDisc(0.3), scene.ground.frame(), disc.frame())
    run = scene.simulate(end, rtol=1e-9)
    return run.position(disc.frame())[-1], run.rotation(disc.frame())[-1]


@pytest.mark.parametrize("world", [Rotation.identity(), Rotation.from_rotvec([1.0, -2.0, 0.7])])
def test_a_wobbling_disc_rolls_as_by_the_rolling_constraint_the_stiffer_the_nearer(world):
    end, errors = 0.8, []
    place, axes = rolls_by_constraints(end)
    for k in (1e6, 1e7):
        turn, start, velocity = wobble()
        rough = contact.Friction(2.0, stiffness=k, damping=0.2 * np.sqrt(2.0 * k), load=2.0 * G)
        scene, body, _ = wheel(
            contact.PowerLaw(k=k, restitution=0.3, speed=1e-2), radius=0.3, mass=2.0, turn=turn, friction=rough,
            place=start - [0.0, 0.0, 2.0 * G / k], velocity=velocity, world=world,
        )  # fmt: skip
        run = scene.simulate(end, rtol=1e-7)
        found = world.inv().apply(run.position(body.frame())[-1])
        errors.append(np.abs(found - place).max())
        assert world.inv().as_matrix() @ run.rotation(body.frame())[-1] == pytest.approx(axes, abs=200.0 * errors[-1])
    assert errors[0] < 1e-3
    assert errors[1] < 0.25 * errors[0]


def test_a_leaning_disc_rolls_round_the_circle_of_its_steady_motion():
    """Its spin is that at which the moment of momentum about the point of contact changes as the weight has it."""
    radius, mass, lean, turning, k = 0.5, 3.0, 0.3, 2.0, 1e8
    across, along = 0.25 * mass * radius**2, 0.5 * mass * radius**2
    s, c, up = np.sin(lean), np.cos(lean), np.array([0.0, 0.0, 1.0])
    ahead, slope, axle = np.array([1.0, 0.0, 0.0]), np.array([0.0, s, c]), np.array([0.0, -c, s])

    def imbalance(spin):
        momentum = along * spin * axle + across * turning * c * slope
        acceleration = turning * np.cross(up, np.cross(spin * axle, radius * slope))
        return (turning * np.cross(up, momentum) + np.cross(radius * slope, mass * (acceleration + G * up)))[0]

    spin = -imbalance(0.0) / (imbalance(1.0) - imbalance(0.0))
    velocity = np.cross(spin * axle, radius * slope)
    rough = contact.Friction(2.0, stiffness=k, damping=0.2 * np.sqrt(mass * k), load=mass * G)
    scene, body, pairs = wheel(
        contact.PowerLaw(k=k, restitution=0.3, speed=1e-3), radius=radius, mass=mass, friction=rough,
        turn=Rotation.from_matrix(np.column_stack([ahead, slope, axle])),
        place=(0.0, 0.0, radius * c - mass * G / k), velocity=(*velocity, *(spin * axle + turning * c * slope)),
    )  # fmt: skip
    run = scene.simulate(2.0, rtol=1e-7)
    reach = velocity[0] / turning
    circle = [np.sin(turning * run.t), 1.0 - np.cos(turning * run.t), 0.0 * run.t]
    exact = np.column_stack(circle) * reach + [0.0, 0.0, radius * c]
    assert run.position(body.frame()) == pytest.approx(exact, abs=1e-4 * abs(reach))
    met = run.contacts(pairs)[0]
    assert met.normal_force[run.t > 0.2] == pytest.approx(mass * G, rel=1e-3)
    inwards = mass * turning**2 * abs(reach)
    assert np.linalg.norm(met.friction, axis=1)[run.t > 0.2] == pytest.approx(inwards, rel=1e-3)


@pytest.mark.parametrize("thick", [False, True])
def test_eulers_disc_precesses_as_fast_as_its_inclination_says(thick):
    """Rolling about its resting centre: Omega^2 sin(a) = 4 g / R, E = 3/2 m g R sin(a) (Moffatt 2000, Nature 404).

    With a round edge about a circle of radius R the centre and the points of that circle move alike.
    """
    radius, inclination, k = 0.04, 0.2, 1e8
    rate = np.sqrt(4.0 * G / (radius * np.sin(inclination)))
    rounding = 1e-4 * radius if thick else 0.0
    turn = Rotation.from_euler("y", inclination)  # the lowest point at +x
    up_slope = turn.apply([-1.0, 0.0, 0.0])
    spin = rate * np.sin(inclination) * up_slope
    height = radius * np.sin(inclination) - G / k
    rough = contact.Friction(5.0, stiffness=k, damping=0.1 * np.sqrt(k), load=G)
    scene, body, _ = wheel(
        contact.PowerLaw(k=k, restitution=0.3, speed=1e-3), radius=radius + rounding, thickness=2.0 * rounding,
        rounding=rounding, turn=turn, place=(0.0, 0.0, height + rounding), velocity=(0.0, 0.0, 0.0, *spin),
        friction=rough, inertia=(0.25 * radius**2, 0.25 * radius**2, 0.5 * radius**2),
    )  # fmt: skip
    end = 2.0 * np.pi / rate
    run = scene.simulate(end, rtol=1e-8)
    axis = run.rotation(body.frame())[:, :, 2]
    angle = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    limit = 2e-3 if not thick else 5e-3
    assert angle == pytest.approx(rate * run.t, abs=limit * 2.0 * np.pi)
    assert np.arccos(axis[:, 2]) == pytest.approx(inclination, rel=limit)
    energy = run.energy().total
    assert energy[0] == pytest.approx(1.5 * G * radius * np.sin(inclination), rel=1e-3)
    assert energy[-1] == pytest.approx(energy[0], rel=2e-3)


def test_a_coin_that_spins_upright_on_ice_rocks_as_its_spin_says():
    """About a diameter: omega^2 = Omega^2 - 4 g / R of small tilts, for I = m R^2 / 4 across."""
    radius, tilt, rate = 0.02, 1e-3, 80.0
    turn = Rotation.from_euler("x", 0.5 * np.pi - tilt)
    k, axle = 1e7, turn.apply([0.0, 0.0, 1.0])
    spin = rate * (np.array([0.0, 0.0, 1.0]) - axle[2] * axle)  # none about its own axle
    scene, body, _ = wheel(
        contact.PowerLaw(k=k), radius=radius, turn=turn, place=(0.0, 0.0, radius * np.cos(tilt) - G / k),
        velocity=(0.0, 0.0, 0.0, *spin),
    )  # fmt: skip
    run = scene.simulate(0.3, rtol=1e-8, integrator=EXPLICIT)
    t = np.linspace(0.0, 0.3, 3001)
    leans = np.arcsin(run.rotation(body.frame(), t=t)[:, 2, 2])
    expected = tilt * np.cos(np.sqrt(rate**2 - 4.0 * G / radius) * t)
    assert leans == pytest.approx(expected, abs=0.02 * tilt)
    energy = run.energy().total
    assert np.ptp(energy) < 1e-7 * energy[0]


@pytest.mark.parametrize("rounding", [0.0, 0.01])
def test_rolling_resistance_slows_a_wheel_by_two_thirds_of_the_arm_over_the_radius(rounding):
    radius, arm, speed, k = 0.1, 2e-3, 0.3, 1e6
    turn = Rotation.from_euler("x", -90, degrees=True)
    rough = contact.Friction(0.5, stiffness=k, damping=0.3 * np.sqrt(k), load=G, rolling=arm)
    scene, body, _ = wheel(
        contact.PowerLaw(k=k, restitution=0.5, speed=1e-3), radius=radius, thickness=2.0 * rounding, rounding=rounding,
        turn=turn, place=(0.0, 0.0, radius - G / k), friction=rough, inertia=(0.0025, 0.0025, 0.005),
        velocity=(speed, 0.0, 0.0, 0.0, speed / radius, 0.0),
    )  # fmt: skip
    slowed = arm * G / (radius * 1.5)
    run = scene.simulate(0.4, rtol=1e-6)
    t = np.array([0.2, 0.4])
    assert run.velocity(body.frame(), t=t)[:, 0] == pytest.approx(speed - slowed * t, rel=5e-4)


@pytest.mark.parametrize(
    ("mu", "acceleration"), [(0.5, 2.0 / 3.0 * np.sin(0.3)), (0.05, np.sin(0.3) - 0.05 * np.cos(0.3))]
)
def test_a_bar_rolls_down_an_incline_on_both_rims_or_slides(mu, acceleration):
    """2/3 g sin(slope) while mu >= tan(slope) / 3."""
    radius, length, k, end = 0.05, 0.4, 1e6, 0.5
    turn = Rotation.from_euler("x", 90, degrees=True)
    rough = contact.Friction(mu, stiffness=k, damping=0.3 * np.sqrt(k), load=0.5 * G)
    scene, body, pairs = wheel(
        contact.PowerLaw(k=k, restitution=0.3, speed=1e-2), radius=radius, thickness=length, rounding=0.01, turn=turn,
        place=(0.0, 0.0, radius - 0.5 * G * np.cos(0.3) / k), friction=rough,
        gravity=(G * np.sin(0.3), 0.0, -G * np.cos(0.3)),
    )  # fmt: skip
    run = scene.simulate(end, rtol=1e-7)
    assert run.position(body.frame())[-1, 0] == pytest.approx(0.5 * acceleration * G * end**2, rel=1e-4)
    forces = [one.normal_force[-1] for one in run.contacts(pairs)]
    assert forces == pytest.approx([0.5 * G * np.cos(0.3)] * 2, rel=1e-6)


def test_a_ball_slides_off_a_round_table_and_keeps_its_energy():
    """Across the face, the round edge and down the side; what it falls becomes speed."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(0.2, (1e-4,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.35, 0.1, 0.05 + 0.03 - 0.2 * G / 1e6, 1.0, 0.0, 0.0, 0.0)
    free.velocity = (0.3, 0.1, 0.0, 0.0, 0.0, 0.0)
    table = contact.Disc(scene.ground.frame(), 0.5, 0.1, 0.04)
    pair = scene.touch(table, contact.Sphere(ball.frame(), 0.03), contact.PowerLaw(k=1e6))
    run = scene.simulate(0.75, rtol=1e-8)
    met = run.contacts(pair)[0]
    assert met.gap[0] < 0.0 < met.gap[-1]
    assert run.position(ball.frame())[-1, 2] < 0.0
    energy = run.energy().total
    assert np.ptp(energy) < 1e-6 * np.ptp(run.energy().kinetic)


@pytest.mark.parametrize("rtol", [1e-2, 1e-8])
@pytest.mark.parametrize("sizes", [(1.0, 0.01, 0.0), (1.0, 0.01, 0.004), (1.0, 0.0, 0.0)])
def test_nothing_fast_passes_through_a_thin_disc(sizes, rtol):
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (0.13, 0.07, 3.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -100.0, 0.0, 0.0, 0.0)
    law = contact.PowerLaw(k=8e9, p=1.5, restitution=0.5, speed=100.0)
    scene.touch(contact.Disc(scene.ground.frame(), *sizes), contact.Sphere(body.frame(), 0.01), law)
    run = scene.simulate(0.05, rtol=rtol, integrator=fm.ExplicitRungeKutta())
    assert run.velocity(body.frame())[-1] == pytest.approx([0.0, 0.0, 50.0], abs=1.0 if rtol > 1e-3 else 1e-2)


def test_a_plate_lies_on_a_wheel_as_a_wheel_on_a_plate():
    """The half space is on the body that moves, turned over."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="plate")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame())
    slide.position = 0.2
    lying = Rotation.from_euler("yz", [90, 25], degrees=True).as_matrix()
    law = contact.PowerLaw(k=1e5, restitution=0.2, speed=0.1)
    over = contact.HalfSpace(body.frame(), (0.0, 0.0, -1.0))
    pairs = scene.touch(over, contact.Disc(scene.ground.frame(R=lying), 0.2, 0.1), law)
    assert scene.equilibrium().position(body.frame())[2] == pytest.approx(0.2 - 0.5 * G / 1e5, abs=1e-12)
    run = scene.simulate(1.0)
    assert [one.normal_force[-1] for one in run.contacts(pairs)] == pytest.approx([0.5 * G] * 2, rel=1e-6)


def test_a_hard_ball_lies_on_a_disc():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(1.0, (4e-4,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.05, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)
    table = contact.Disc(scene.ground.frame(), 0.2, 0.1, 0.02)
    pair = scene.touch(table, contact.Sphere(ball.frame(), 0.03), contact.Hard(restitution=0.3, mu=0.3))
    run = scene.simulate(0.5, h=2e-3)
    assert run.position(ball.frame())[-1] == pytest.approx([0.05, 0.0, 0.08], abs=1e-9)
    assert run.contacts(pair)[0].normal_force[-1] == pytest.approx(G, rel=1e-6)


def refused(said, make):
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    with pytest.raises(SceneError, match=said):
        make(scene, body.frame(), contact.HalfSpace(scene.ground.frame()))


def test_what_no_disc_is_or_touches_is_refused():
    soft = contact.PowerLaw(k=1.0)
    refused("radius of a Disc", lambda s, f, floor: contact.Disc(f, 0.0))
    refused("thickness of a Disc", lambda s, f, floor: contact.Disc(f, 1.0, -0.1))
    refused("rounding of a Disc", lambda s, f, floor: contact.Disc(f, 1.0, 0.1, np.nan))
    refused("at most half its thickness", lambda s, f, floor: contact.Disc(f, 1.0, 0.1, 0.06))
    refused("crown of a Disc", lambda s, f, floor: contact.Disc(f, 1.0, 0.1, crown=0.06))
    refused("take a Capsule", lambda s, f, floor: contact.Disc(f, 0.1, 0.4, 0.1))
    refused("take PowerLaw", lambda s, f, floor: s.touch(
        floor, contact.Disc(f, 1.0, 0.1, 0.05), contact.Hertz(**STEEL)))  # fmt: skip
    refused("take PowerLaw", lambda s, f, floor: s.touch(
        contact.Disc(f, 1.0, 0.1), contact.Sphere(s.ground.frame(), 0.1), contact.Hertz(**STEEL)))  # fmt: skip
    refused("has no hard contact yet", lambda s, f, floor: s.touch(floor, contact.Disc(f, 1.0), contact.Hard()))
    refused("no such pair", lambda s, f, floor: s.touch(
        contact.Box(s.ground.frame(), (1.0, 1.0, 1.0)), contact.Disc(f, 1.0), soft))  # fmt: skip
    refused("has no thickness", lambda s, f, floor: s.touch(
        contact.Vertex(s.ground.frame()), contact.Disc(f, 1.0), soft))  # fmt: skip
    refused("one by one", lambda s, f, floor: s.touch([floor], [contact.Disc(f, 1.0)] * 2, contact.Hard()))


def test_it_is_named_in_messages():
    _, _, pairs = wheel(contact.PowerLaw(k=1.0), thickness=0.02)
    assert pairs[0].what == "contact of rim (0, 0, -0.00999) of wheel with HalfSpace ground"
