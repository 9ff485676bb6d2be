"""Contact of rigid bodies against closed forms: impacts, rolling, sticking, sliding, and what must not happen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

STEEL = {"E": 2.1e11, "nu": 0.3}
RADIUS, MASS = 0.05, 4.0 / 3.0 * np.pi * 0.05**3 * 7850.0
EXPLICIT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)


def ball(scene, name, place, velocity=(0.0, 0.0, 0.0), *, radius=RADIUS, mass=MASS):
    inertia = 0.4 * mass * radius**2
    body = scene.add(fm.RigidBody(mass, (inertia, inertia, inertia)), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (*place, 1.0, 0.0, 0.0, 0.0)
    free.velocity = (*velocity, 0.0, 0.0, 0.0)
    return body


def two_spheres(law, speed=1.0, gap=0.1, aside=0.0):
    scene = fm.System()
    a = ball(scene, "a", (0.0, 0.0, 0.0), (speed, 0.0, 0.0))
    b = ball(scene, "b", (2.0 * RADIUS + gap, aside, 0.0))
    pair = scene.touch(contact.Sphere(a.frame(), RADIUS), contact.Sphere(b.frame(), RADIUS), law)
    return scene, a, b, pair


def test_two_steel_spheres_meet_as_hertz_says():
    """Johnson 1985, section 11.4: approach, force and duration of an elastic impact at 1 m/s."""
    scene, a, b, pair = two_spheres(contact.Hertz(**STEEL), gap=1e-6)
    run = scene.simulate(4e-4, rtol=1e-9, integrator=EXPLICIT)
    t = np.linspace(0.0, 4e-4, 40001)
    met = run.contacts(pair, t=t)[0]
    star = STEEL["E"] / (2.0 * (1.0 - 0.3**2))
    k = 4.0 / 3.0 * star * np.sqrt(RADIUS / 2.0)
    depth = (1.25 * (MASS / 2.0) / k) ** 0.4
    assert -met.gap.min() == pytest.approx(depth, rel=1e-6)
    assert met.normal_force.max() == pytest.approx(k * depth**1.5, rel=1e-6)
    assert np.ptp(t[met.gap < 0.0]) == pytest.approx(2.94327 * depth, rel=2e-4)
    assert depth == pytest.approx(1.0221e-4, rel=1e-4)  # published figures, derived anew above
    assert run.velocity(a.frame())[-1, 0] == pytest.approx(0.0, abs=1e-7)
    assert run.velocity(b.frame())[-1, 0] == pytest.approx(1.0, abs=1e-7)
    energy = run.energy().total
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-7


@pytest.mark.parametrize("speed", [1e-2, 10.0])
@pytest.mark.parametrize("restitution", [0.02, 0.5, 0.97])
@pytest.mark.parametrize("law", [contact.Hertz(**STEEL), contact.PowerLaw(k=1e7), contact.PowerLaw(k=1e12, p=2.2)])
def test_an_impact_leaves_the_stated_share_of_its_speed(law, restitution, speed):
    """Whatever the stiffness, the exponent, the masses and the speed."""
    law = replace(law, restitution=restitution, speed=speed)
    scene, a, b, _ = two_spheres(law, speed=speed)
    run = scene.simulate(0.4 / speed, rtol=1e-8, integrator=EXPLICIT)
    apart = run.velocity(b.frame())[-1, 0] - run.velocity(a.frame())[-1, 0]
    assert apart / speed == pytest.approx(restitution, rel=1e-5)
    assert run.velocity(b.frame())[-1, 0] + run.velocity(a.frame())[-1, 0] == pytest.approx(speed, rel=1e-13)


@pytest.mark.parametrize(
    ("method", "order"),
    [
        (fm.RadauIIA(), 1e-2),
        (fm.GeneralizedAlpha(), 1e-2),
        (fm.EnergyMomentum(), 1e-2),
        (fm.ExplicitRungeKutta(), 1e-2),
        (EXPLICIT, 2e-2),
    ],
)
def test_the_error_falls_with_the_tolerance_across_an_impact(method, order):
    errors = []
    for rtol in (1e-3, 1e-5, 1e-7):
        scene, a, b, _ = two_spheres(contact.Hertz(**STEEL, restitution=0.5))
        run = scene.simulate(0.2, rtol=rtol, integrator=method)
        errors.append(abs(run.velocity(b.frame())[-1, 0] - run.velocity(a.frame())[-1, 0] - 0.5))
    assert errors[0] < 1e-2
    assert errors[2] < order * errors[0]


@pytest.mark.parametrize("aside", [0.0, 0.05, 0.099])
@pytest.mark.parametrize("rtol", [1e-2, 1e-9])
def test_nothing_fast_passes_through(aside, rtol):
    """However much beside each other two spheres meet; against scipy's integration of their distance."""
    scene, a, b, _ = two_spheres(contact.Hertz(**STEEL), speed=100.0, gap=5.0, aside=aside)
    run = scene.simulate(0.1, rtol=rtol, integrator=EXPLICIT)
    k = contact.Hertz(**STEEL).stiffness(contact.Sphere(a.frame(), RADIUS), RADIUS, "")

    def equation(_, y):
        r = np.hypot(y[0], y[1])
        return [*y[2:], *(2.0 / MASS * k * max(2.0 * RADIUS - r, 0.0) ** 1.5 / r * y[:2])]

    start = [-0.12, -aside, 100.0, 0.0]  # of a against b
    end = solve_ivp(equation, (0.0, 3e-3), start, rtol=1e-10, atol=1e-12, max_step=1e-5).y[2:, -1]
    exact = 0.5 * (np.array([100.0, 0.0]) - end)  # of b
    assert np.linalg.norm(exact) > 5.0
    assert run.velocity(b.frame())[-1, :2] == pytest.approx(exact, abs=1.0 if rtol > 1e-3 else 1e-4)


def test_a_blow_at_a_stage_without_weight_is_seen():
    """Of the long step the third stage alone meets the contact, which throws the later ones out of it again."""
    scene, a, b, _ = two_spheres(contact.Hertz(**STEEL, restitution=0.5, speed=1e-3), speed=1e-3)
    run = scene.simulate(200.0, rtol=1e-9, integrator=EXPLICIT)
    apart = run.velocity(b.frame())[-1, 0] - run.velocity(a.frame())[-1, 0]
    assert apart == pytest.approx(0.5e-3, rel=1e-5)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_billiard_ball_slides_until_it_rolls(size):
    """It rolls with 5/7 of its speed after 2 v / (7 mu g), at sizes a thousand apart alike (times as they are)."""
    mu, g, v, r = 0.2, 9.81 * size, 2.0 * size, 0.0286 * size
    mass = 0.17 * size**3
    depth = 1e-6 * size
    scene = fm.System(gravity=(0.0, 0.0, -g))
    body = ball(scene, "ball", (0.0, 0.0, r - depth), (v, 0.0, 0.0), radius=r, mass=mass)
    law = contact.PowerLaw.bearing(mass * g, depth=depth, restitution=0.5, speed=1e-3 * size)
    k = mass * g / depth
    rough = contact.Friction(mu, stiffness=k, damping=0.1 * np.sqrt(k * mass), load=mass * g)
    pair = scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), r), law, friction=rough)
    rolls = 2.0 * v / (7.0 * mu * g)
    run = scene.simulate(1.2 * rolls, rtol=1e-6)
    t = np.linspace(0.0, 1.2 * rolls, 2401)
    met = run.contacts(pair, t=t)[0]
    assert run.velocity(body.frame())[-1, 0] == pytest.approx(5.0 / 7.0 * v, rel=1e-9)
    assert t[np.abs(met.slip[:, 0]) > 1e-3 * v].max() == pytest.approx(rolls, rel=2e-3)
    slides = t < 0.95 * rolls
    assert np.allclose(met.friction[slides][1:, 0], -mu * met.normal_force[slides][1:], rtol=1e-6)
    assert np.abs(met.normal_force[t > 0.3 * rolls] / (mass * g) - 1.0).max() < 1e-4


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_block_on_an_incline_sticks_below_the_angle_of_friction_and_slides_above_it(size):
    angle, g, side = 0.3, 9.81 * size, 0.2 * size
    mass = 8.0 * size**3
    load, depth = mass * g * np.cos(angle) / 4.0, 1e-7 * size
    k = load / depth
    went = {}
    for mu in (0.2, 0.5):
        scene = fm.System(gravity=(g * np.sin(angle), 0.0, -g * np.cos(angle)))
        inertia = mass * side**2 / 6.0
        body = scene.add(fm.RigidBody(mass, (inertia, inertia, inertia)), name="block")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (0.0, 0.0, 0.5 * side - depth, 1.0, 0.0, 0.0, 0.0)
        law = contact.PowerLaw.bearing(load, depth=depth, restitution=0.3, speed=1e-3 * size)
        rough = contact.Friction(mu, stiffness=k, damping=0.2 * np.sqrt(k * mass / 4.0), load=load)
        floor = contact.HalfSpace(scene.ground.frame())
        pair = scene.touch(floor, contact.Box(body.frame(), (side, side, side)), law, friction=rough)
        assert len(pair) == 8
        run = scene.simulate(10.0 if mu == 0.5 else 1.0, rtol=1e-6)
        went[mu] = run.position(body.frame(), t=run.t[-1] * np.array([0.5, 1.0]))[:, 0] / size
    assert went[0.2][-1] == pytest.approx(0.5 * 9.81 * (np.sin(angle) - 0.2 * np.cos(angle)), rel=1e-3)
    assert went[0.5][-1] == pytest.approx(went[0.5][0], abs=1e-11)  # it sticks, and does not creep
    assert 0.0 < went[0.5][-1] < 1e-6


def test_a_load_that_comes_and_goes_does_not_make_it_creep():
    """Pushed to and fro by up to 0.7 of what it takes to slide, a thousand times."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    pressed = scene.ground.frame(p=(0.0, 0.0, 1e-6))
    rough = contact.Friction(0.5, stiffness=1e7, damping=2e3, load=10.0)
    point = contact.Vertex(body.frame())
    scene.touch(contact.HalfSpace(pressed), point, contact.PowerLaw(k=1e7), friction=rough)
    push = fm.compiled(lambda t: 0.5 * 5.0 * np.sin(2.0 * np.pi * 50.0 * t) + 1.0)
    scene.add_force(fm.force.JointForce(slide, push))
    run = scene.simulate(20.0, rtol=1e-6)
    t = np.array([0.5, 1.0, 10.0, 20.0])
    x = run.beta(slide, t=t)
    assert np.ptp(x) < 1e-3 * 1.0 / 1e7


def test_a_cradle_keeps_momentum_and_energy_and_the_last_ball_leaves():
    scene = fm.System()
    balls = [ball(scene, f"ball {i}", (i * (2.0 * RADIUS + 1e-3), 0.0, 0.0)) for i in range(4)]
    first = ball(scene, "first", (-0.2, 0.0, 0.0), (1.0, 0.0, 0.0))
    shapes = [contact.Sphere(one.frame(), RADIUS) for one in (first, *balls)]
    assert len(scene.touch(shapes, shapes, contact.Hertz(**STEEL))) == 10
    run = scene.simulate(0.3, rtol=1e-8)
    speeds = np.array([run.velocity(one.frame())[-1, 0] for one in (first, *balls)])
    assert speeds.sum() == pytest.approx(1.0, abs=1e-12)
    assert speeds == pytest.approx([0.0, 0.0, 0.0, 0.0, 1.0], abs=1e-5)
    energy = run.energy().total
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-6


def test_the_order_of_a_pair_and_the_axes_of_frames_change_nothing():
    """A sphere that spins falls askew onto a box; the same in another frame, and named the other way round."""
    ends = []
    for swapped, R in ((False, np.eye(3)), (True, rotation())):
        scene = fm.System(gravity=tuple(R @ (0.0, 0.0, -9.81)))
        body = scene.add(fm.RigidBody(1.0, (4e-3, 4e-3, 4e-3)), name="ball")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(R=R), body.frame())
        free.position = (0.15, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0)
        free.velocity = (0.3, 0.1, 0.0, 1.0, 5.0, 2.0)
        rough = contact.Friction(0.3, stiffness=1e5, damping=50.0, load=10.0)
        shapes = contact.Box(scene.ground.frame(R=R), (0.4, 0.4, 0.4)), contact.Sphere(body.frame(), 0.1)
        scene.touch(*(shapes[::-1] if swapped else shapes), contact.PowerLaw(k=1e5, restitution=0.6), friction=rough)
        run = scene.simulate(0.5, rtol=1e-8)
        ends.append(run.position(body.frame())[-1] @ R)
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)
    assert ends[0][0] > 0.2  # over the edge


def rotation():
    return Rotation.from_rotvec((0.3, -0.8, 0.5)).as_matrix()


def lowered(b, x, y):
    """E* / (p0 a) times the deflection at (x, y) a under p0 sqrt(1 - x^2 - (y / b)^2), over an ellipse of axes a, b a.

    Boussinesq's integral of p / r in polar coordinates about (x, y): over r it is that of a half ellipse.
    """

    def along(angle):
        c, s = np.cos(angle), np.sin(angle)
        A, B, C = c * c + (s / b) ** 2, x * c + y * s / b**2, x * x + (y / b) ** 2 - 1.0
        return 0.25 * np.pi * (B * B - A * C) / A**1.5

    return quad(along, 0.0, 2.0 * np.pi, epsabs=1e-12, epsrel=1e-12)[0] / np.pi


def bent(b):
    """Curvatures along x and y of what that pressure makes of a plane."""
    middle = lowered(b, 0.0, 0.0)
    along_x, along_y = middle - lowered(b, 0.5, 0.0), middle - lowered(b, 0.0, 0.5 * b)
    return 2.0 * along_x / 0.25, 2.0 * along_y / (0.5 * b) ** 2


@pytest.mark.parametrize(("hollow", "radius"), [(False, 0.3), (True, 0.05)])
def test_a_sphere_in_a_bore_and_on_a_cylinder_dent_as_boussinesq_s_integral_has_it(hollow, radius):
    frame = fm.System().ground.frame()
    shape = contact.HollowCylinder(frame, 0.06) if hollow else contact.Cylinder(frame, 0.02)
    k = contact.Hertz(**STEEL).stiffness(shape, radius, "")
    low, high = sorted(1.0 / radius + one for one in shape.curvatures())
    b = brentq(lambda b: bent(b)[1] / bent(b)[0] - high / low, 1e-3, 1.0)
    depth, star = 1e-5, STEEL["E"] / (2.0 * (1.0 - 0.3**2))
    a = np.sqrt(depth * bent(b)[0] / (low * lowered(b, 0.0, 0.0)))
    p0 = depth * star / (a * lowered(b, 0.0, 0.0))
    assert k * depth**1.5 == pytest.approx(2.0 / 3.0 * np.pi * p0 * a * a * b, rel=1e-6)


def test_bodies_that_a_joint_joins_and_shapes_of_one_body_do_not_touch_in_groups():
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name=name) for name in "abc"]
    scene.connect(fm.joint.Revolute("z"), bodies[0].frame(), bodies[1].frame())
    shapes = [contact.Sphere(body.frame(), 0.1) for body in bodies]
    shapes.append(contact.Sphere(bodies[2].frame(p=(1.0, 0.0, 0.0)), 0.1))
    pairs = scene.touch(shapes, shapes, contact.PowerLaw(k=1.0))
    assert len(pairs) == 4  # a-c and b-c, twice each
    assert len(scene.touch(shapes[0], shapes[1], contact.PowerLaw(k=1.0))) == 1  # asked for


def test_what_touches_is_told():
    scene, *_ = two_spheres(contact.Hertz(**STEEL))
    assert "contact of sphere b with Sphere a" in scene.explain()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda s, f: contact.Sphere(f, 0.0), "radius of a Sphere"),
        (lambda s, f: contact.Box(f, (1.0, 2.0)), "three sides"),
        (lambda s, f: contact.Capsule(f, 0.1, -1.0), "length of a Capsule"),
        (lambda s, f: contact.Sphere("a", 0.1), "frame of a Sphere"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), 3.0, contact.PowerLaw(k=1.0)), "what touches"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), floor(s), 3.0), "the law of a contact"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), floor(s), contact.PowerLaw()), "k = 0"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), floor(s), contact.Hertz(E=-1.0)), "E = -1"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), floor(s), contact.PowerLaw(k=1.0, restitution=1.5)), "n = 1.5"),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), floor(s), contact.PowerLaw(k=1.0, restitution=0.0)), "n = 0"),
        (lambda s, f: s.touch(contact.Vertex(f), floor(s), contact.Hertz(**STEEL)), "a point has none"),
        (lambda s, f: s.touch([], floor(s), contact.PowerLaw(k=1.0)), "is empty"),
        (lambda s, f: s.touch(*[[contact.Sphere(f, 0.1)]] * 2, contact.PowerLaw(k=1.0)), "none of these shapes"),
        (
            lambda s, f: s.touch(contact.Vertex(f), contact.Vertex(s.ground.frame()), contact.PowerLaw(k=1.0)),
            "no such pair",
        ),
        (lambda s, f: s.touch(contact.Sphere(f, 0.1), contact.Sphere(f, 0.1), contact.PowerLaw(k=1.0)), "on one body"),
        (
            lambda s, f: s.touch(
                contact.Sphere(f, 0.1), contact.HollowSphere(s.ground.frame(), 0.05), contact.Hertz(**STEEL)
            ),
            "does not fit",
        ),
        (
            lambda s, f: s.touch(
                contact.Sphere(f, 0.1), floor(s), contact.PowerLaw(k=1.0),
                friction=contact.Friction(-0.1, 1.0, 1.0, 1.0),
            ),
            "mu = -0.1",
        ),
        (
            lambda s, f: s.touch(
                contact.Sphere(f, 0.1), floor(s), contact.PowerLaw(k=1.0),
                friction=contact.Friction(0.3, 1.0, 1.0, 1.0, static=0.2, stribeck=1.0),
            ),
            "less than mu",
        ),
    ],
)  # fmt: skip
def test_what_cannot_touch_is_refused(make, said):
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    with pytest.raises(SceneError, match=said.replace(".", r"\.")):
        make(scene, body.frame())


def floor(scene):
    return contact.HalfSpace(scene.ground.frame())


def test_central_differences_refuse_contacts():
    scene, *_ = two_spheres(contact.Hertz(**STEEL))
    with pytest.raises(SceneError, match="bodies of this scene touch"):
        scene.simulate(1e-3, integrator=fm.CentralDifference())


def test_a_ball_at_rest_lies_as_deep_as_its_weight_presses_it():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = ball(scene, "ball", (0.0, 0.0, RADIUS - 1e-7))
    law = contact.Hertz(**STEEL)
    shape = contact.HalfSpace(scene.ground.frame())
    scene.touch(shape, contact.Sphere(body.frame(), RADIUS), law)
    depth = (MASS * 9.81 / law.stiffness(shape, RADIUS, "")) ** (2.0 / 3.0)
    assert RADIUS - scene.equilibrium().position(body.frame())[2] == pytest.approx(depth, rel=1e-7)


def test_what_friction_would_have_to_bear_is_no_equilibrium_by_itself():
    """A bristle without rate leaves any stretch at rest: how much it bears hangs on the way there."""
    scene = fm.System(gravity=(2.0, 0.0, -9.81))
    body = ball(scene, "ball", (0.0, 0.0, RADIUS - 1e-7))
    rough = contact.Friction(0.5, stiffness=1e7, damping=1e3, load=40.0)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch(floor, contact.Sphere(body.frame(), RADIUS), contact.Hertz(**STEEL), friction=rough)
    with pytest.raises(SceneError, match="stays unbalanced, for neither a place nor a state resists it"):
        scene.equilibrium()


def test_bodies_that_a_joint_holds_on_the_ground_touch_it():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bodies = [scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name=f"ball {i}") for i in range(2)]
    for i, body in enumerate(bodies):
        scene.connect(fm.joint.Planar("y"), scene.ground.frame(p=(0.2 * i, 0.0, 0.06)), body.frame())
    shapes = [contact.Sphere(body.frame(), 0.05) for body in bodies]
    law = contact.PowerLaw(k=1e5, p=1.5, restitution=0.6)
    assert len(scene.touch(floor(scene), shapes, law)) == 2
    run = scene.simulate(0.3)
    assert min(run.position(body.frame())[:, 2].min() for body in bodies) > 0.04


def test_a_pair_touches_once_in_whatever_lists_it_stands():
    ways = (lambda s: (s, s), lambda s: (s, list(s)), lambda s: (s, s[::-1]), lambda s: (tuple(s), iter(s)))
    for sides in ways:
        scene = fm.System()
        shapes = [contact.Sphere(ball(scene, name, (x, 0.0, 0.0)).frame(), RADIUS) for name, x in (("a", 0), ("b", 1))]
        assert len(scene.touch(*sides(shapes), contact.PowerLaw(k=1.0))) == 1


@pytest.mark.parametrize("left", [1e-3, 1e-4, 9e-5, 1e-7, 1e-12, 0.0])
def test_restitutions_next_to_one_lose_as_much_as_they_say(left):
    """Of the speed's square an impact takes 2 (1 - e), to first order the work of the damper: D v = 1.5 (1 - e)."""
    found = contact.PowerLaw(k=1.0, restitution=1.0 - left, speed=2.0).dissipation()
    assert found == pytest.approx(0.75 * left, rel=2e-3, abs=1e-17)


def test_a_box_goes_with_its_frame_from_run_to_run():
    def build(z):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="box")
        frame = body.frame(p=(0.0, 0.0, z))
        slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame())
        slide.position = 0.2
        law = contact.PowerLaw(k=1e5, p=1.5, restitution=0.6)
        pair = scene.touch(floor(scene), contact.Box(frame, (0.1, 0.1, 0.1)), law)
        return scene, body, frame, pair

    scene, body, frame, _ = build(0.0)
    varied = scene.compile(parameters={"place": fm.parameter.FrameOrigin(frame)}).simulate(t_end=0.5, place=(0, 0, 0.1))
    other, same, _, _ = build(0.1)
    assert varied.position(body.frame())[-1] == pytest.approx(other.simulate(0.5).position(same.frame())[-1], abs=1e-12)


def test_the_friction_of_the_first_contact_can_vary():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = ball(scene, "ball", (0.0, 0.0, RADIUS - 1e-6), (1.0, 0.0, 0.0))
    rough = contact.Friction(0.2, stiffness=1e6, damping=100.0, load=40.0)
    (pair,) = scene.touch(
        floor(scene), contact.Sphere(body.frame(), RADIUS), contact.PowerLaw(k=3e7), friction=rough
    )
    machine = scene.compile(parameters={"law": fm.parameter.OfForce(pair, "law")})
    runs = [machine.simulate(t_end=0.05, law=contact.PowerLaw(k=k)) for k in (3e7, 3e6)]
    deep = [run.position(body.frame())[:, 2].min() for run in runs]
    assert deep[1] < deep[0] < RADIUS


def test_a_pin_in_the_middle_of_its_bore_falls_onto_the_wall():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = ball(scene, "pin", (0.0, 0.0, 0.0))
    scene.touch(
        contact.HollowCylinder(scene.ground.frame(), RADIUS + 0.01), contact.Sphere(body.frame(), RADIUS),
        contact.PowerLaw(k=1e7, restitution=0.3),
    )  # fmt: skip
    y = scene.simulate(0.5).position(body.frame())[:, 1]
    assert -0.0104 < y.min() < -0.01
