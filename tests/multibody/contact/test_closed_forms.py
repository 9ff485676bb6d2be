"""Contact of rigid bodies against closed forms of longer motions: bounces, a jamming rod, a tippe top, a golf ball."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact

G = 9.81
EXPLICIT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def free_body(scene, mass, inertia, place, velocity, *, com=(0.0, 0.0, 0.0), R=None):
    """A rigid body and its free joint; ``velocity`` (6,) as that joint takes it."""
    body = scene.add(fm.RigidBody(mass, inertia, com))
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    x, y, z, w = (Rotation.identity() if R is None else R).as_quat()
    free.position, free.velocity = (*place, w, x, y, z), velocity
    return body


def balance(v, e, d):
    """Hunt & Crossley 1975: none where an impact at v leaves e v, with D = d."""
    return d * v * (1.0 + e) - np.log1p(d * v) + np.log1p(-e * d * v)


def damping_of(law):
    """D (s/m)."""
    v, e = law.speed, law.restitution
    return brentq(lambda d: balance(v, e, d), 1e-6 / v, (1.0 - 1e-9) / (e * v), xtol=1e-15)


def left(speed, law):
    """Speed after an impact."""
    d = damping_of(law)
    most = min(1.0, 1.0 / (d * speed)) * (1.0 - 1e-13)
    return speed * brentq(lambda e: balance(speed, e, d), 1e-6, most, xtol=1e-15)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_ball_bounces_at_all_instants_of_its_law(size):
    """Twelve impacts: each leaves what the law of the first one says, and flights take 2 v / g."""
    height, radius = size, 0.1 * size
    first = np.sqrt(2.0 * G * height)
    law = contact.PowerLaw(k=1e12 / size, restitution=0.5, speed=first)  # N/m; 1 kg
    instants, speeds = [np.sqrt(2.0 * height / G)], [first]
    for _ in range(11):
        speeds.append(left(speeds[-1], law))
        instants.append(instants[-1] + 2.0 * speeds[-1] / G)
    assert speeds[1] == pytest.approx(0.5 * first, rel=1e-9)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    inertia = 0.4 * radius**2
    start = (0.0, 0.0, radius + height)
    body = free_body(scene, 1.0, (inertia,) * 3, start, (0.0,) * 6)
    pair = scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), radius), law)
    run = scene.simulate(instants[-1] + 0.5 * speeds[-1] / G, rtol=1e-9, integrator=EXPLICIT)
    pressed = run.contacts(pair)[0].gap < 0.0
    begins = run.t[1:][pressed[1:] & ~pressed[:-1]]
    assert len(begins) == 12
    # the contacts of some 4e-6 of the first fall, and the weight's impulse in them, are not in the closed form
    assert begins == pytest.approx(instants, rel=2e-5)
    tops = 0.5 * (np.array(instants)[:-1] + np.array(instants)[1:])
    heights = run.position(body.frame(), t=tops)[:, 2] - radius
    assert heights == pytest.approx(0.5 * np.array(speeds)[1:] ** 2 / G, rel=1e-4)


def test_a_ball_that_has_bounced_lies_as_its_weight_presses_it():
    """Beyond the last bounce it swings about its depth at rest, and less by exp(-D g t / 2)."""
    k = 1e5
    law = contact.PowerLaw(k=k, restitution=0.5, speed=4.0)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    body = free_body(scene, 1.0, (4e-3,) * 3, (0.0, 0.0, 0.6), (0.0,) * 6)
    pair = scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), 0.1), law)
    run = scene.simulate(10.0, rtol=1e-7)
    swings = []
    for late in (6.0, 8.0):
        met = run.contacts(pair, t=np.linspace(late, late + 0.1, 1001))[0]
        assert met.gap.max() < 0.0
        swings.append(np.ptp(met.gap))
    assert np.log(swings[0] / swings[1]) == pytest.approx(damping_of(law) * G, rel=1e-2)
    last = run.contacts(pair)[0]
    assert last.gap[-1] == pytest.approx(-G / k, rel=1e-4)
    assert last.normal_force[-1] == pytest.approx(G, rel=1e-4)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("mu", [1.0, 1.6])
def test_painleves_rod_slides_or_jams(mu, size):
    """A rod at arctan 2 drags its tip along: m delta'' = m g - p k delta with p = 1 + 3 c^2 - 3 mu s c.

    Below mu = 4/3 the floor bears m g / p.  Above it p is negative: however stiff the floor, its force grows without
    bound, by cosh(t sqrt(-p k / m)), until it has stopped the tip, after the impulse m v / q with
    q = mu + 3 s (mu s - c) (Painleve 1895; Genot & Brogliato 1999, European Journal of Mechanics A/Solids 18).
    """
    angle, half, mass, v = np.arctan(2.0), 0.5 * size, 2.0, 5.0 * size
    g, k = G * size, 1e9
    s, c = np.sin(angle), np.cos(angle)
    p, q = 1.0 + 3.0 * c**2 - 3.0 * mu * s * c, mu + 3.0 * s * (mu * s - c)
    scene = fm.System(gravity=(0.0, 0.0, -g))
    across, thin = mass * half**2 / 3.0, 1e-3 * mass * half**2
    up = Rotation.from_euler("y", -angle)
    centre = half * np.array([c, 0.0, s])
    resting = mass * g / (p * k) if p > 0.0 else 0.0
    body = free_body(
        scene, mass, (thin, across, across), centre - (0.0, 0.0, resting), (-v, 0.0, 0.0, 0.0, 0.0, 0.0), R=up
    )
    tip = contact.Vertex(body.frame(p=(-half, 0.0, 0.0)))
    rough = contact.Friction(mu, stiffness=10.0 * k, damping=1e-3 * np.sqrt(k * mass), load=mass * g)
    pair = scene.touch(contact.HalfSpace(scene.ground.frame()), tip, contact.PowerLaw(k=k), friction=rough)
    rate = np.sqrt(abs(p) * k / mass)
    run = scene.simulate(40.0 / rate, rtol=1e-9, integrator=EXPLICIT)
    t = np.linspace(0.0, 40.0 / rate, 40001)
    met = run.contacts(pair, t=t)[0]
    if p > 0.0:
        assert met.normal_force[1:] == pytest.approx(mass * g / p, rel=2e-2)  # it begins without any friction
        return
    grows = t < 6.0 / rate
    exact = mass * g / abs(p) * (np.cosh(rate * t) - 1.0)
    assert met.normal_force[grows] == pytest.approx(exact[grows], rel=1e-3, abs=1e-3 * mass * g)
    stops = np.argmax(met.slip[:, 0] > -1e-3 * v)
    impulse = np.trapezoid(met.normal_force[: stops + 1], t[: stops + 1])
    assert impulse == pytest.approx(mass * v / q, rel=2e-2)
    assert run.velocity(body.frame())[-1, 2] > 0.0  # and it is thrown up, though nothing had come down


def test_a_tippe_top_turns_over_and_keeps_jelletts_constant():
    """A ball whose centre of mass is off its own by e radii: L . r is kept, r from there to the floor.

    It is so whatever the friction.  With A / C between 1 - e and 1 + e it turns over altogether (Cohen 1977, American
    Journal of Physics 45; Ciocci & Langerock 2007, Regular and Chaotic Dynamics 12); on its head its spin is
    (cos(lean) - e) / (1 + e) of what it was.
    """
    mass, radius, share, spin, leant = 0.02, 0.02, 0.3, 160.0, 0.4
    off, about = share * radius, 0.4 * mass * radius**2
    scene = fm.System(gravity=(0.0, 0.0, -G))
    load, depth = mass * G, 1e-6
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.3, speed=1e-3)
    rough = contact.Friction(0.05, stiffness=load / depth, damping=0.3 * np.sqrt(load / depth * mass), load=load)
    lean = Rotation.from_euler("x", leant)
    axis = lean.apply([0.0, 0.0, 1.0])
    body = free_body(
        scene, mass, (about,) * 3, np.array([0.0, 0.0, radius - depth]) - off * axis,
        (0.0, 0.0, 0.0, 0.0, 0.0, spin), R=lean,
    )  # fmt: skip
    sphere = contact.Sphere(body.frame(p=(0.0, 0.0, off)), radius)
    scene.touch(contact.HalfSpace(scene.ground.frame()), sphere, law, friction=rough)
    run = scene.simulate(14.0, rtol=1e-6)
    R, w = run.rotation(body.frame()), run.angular_velocity(body.frame())
    r = off * R[:, :, 2] - radius * np.array([0.0, 0.0, 1.0])
    jellett = np.sum(about * w * r, axis=1)
    assert np.abs(jellett / jellett[0] - 1.0).max() < 1e-4  # of the depth over the radius
    assert R[-1, 2, 2] < -0.98
    assert w[-1, 2] == pytest.approx(spin * (np.cos(leant) - share) / (1.0 + share), rel=0.02)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_golf_ball_in_the_cup_rises_again(size):
    """A ball that rolls round in an upright pipe swings up and down by sqrt(2/7) of its rate (times as they are).

    Its centre falls by 5 g / (2 W^2) (1 - cos(sqrt(2/7) W t)) (Gualtieri, Tokieda & others 2006, American Journal of
    Physics 74).
    """
    pipe, radius, mass, rate = 0.06 * size, 0.0213 * size, 0.046, 15.0
    arm = pipe - radius
    load, depth = mass * arm * rate**2, 1e-7 * size
    k = load / depth
    scene = fm.System(gravity=(0.0, 0.0, -G * size))
    inertia = 0.4 * mass * radius**2
    start = (arm + depth, 0.0, 0.0)
    body = free_body(scene, mass, (inertia,) * 3, start, (0.0, arm * rate, 0.0, 0.0, 0.0, -arm * rate / radius))
    law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.3, speed=1e-3 * size)
    rough = contact.Friction(2.0, stiffness=k, damping=0.3 * np.sqrt(k * mass), load=load)
    wall = contact.HollowCylinder(scene.ground.frame(), pipe)
    scene.touch(wall, contact.Sphere(body.frame(), radius), law, friction=rough)
    swings = np.sqrt(2.0 / 7.0) * rate
    t = np.linspace(0.0, 4.0 * np.pi / swings, 401)
    run = scene.simulate(t[-1], rtol=1e-6)
    falls = 2.5 * G * size / rate**2
    found = run.position(body.frame(), t=t)[:, 2]
    assert np.abs(found + falls * (1.0 - np.cos(swings * t))).max() < 1e-3 * falls
