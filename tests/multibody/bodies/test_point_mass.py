"""Point masses: closed forms, the same as rigid bodies, what is refused by name."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.special import ellipk

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.scene_file.reading import read_scene
from flexmbd.scene_file.scene_builder import build

METHODS = [
    fm.ExplicitRungeKutta(),
    fm.RadauIIA(),
    fm.GeneralizedAlpha(),
    fm.EnergyMomentum(),
]


def flying(scene, name, place, velocity, *, mass=1.0):
    point = scene.add(fm.PointMass(mass), name=name)
    joint = scene.connect(fm.joint.Translation(), scene.ground.frame(), point.frame())
    joint.position, joint.velocity = place, velocity
    return point


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
def test_flies_on_a_parabola(method):
    scene = fm.System(gravity=(0.3, -9.81, 0.0))
    point = flying(scene, "ball", (1.0, 2.0, 3.0), (0.4, 5.0, -0.6), mass=0.7)
    run = scene.simulate(1.5, rtol=1e-8, integrator=method)
    t = run.t[:, None]
    expected = [1.0, 2.0, 3.0] + t * [0.4, 5.0, -0.6] + 0.5 * t**2 * [0.3, -9.81, 0.0]
    assert np.abs(run.position(point.frame()) - expected).max() < 1e-7
    assert scene.compile().scene.nv == 3


def test_on_a_string_it_swings_with_the_period_of_the_elliptic_integral():
    length, angle = 0.8, 1.1
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    place = (length * np.sin(angle), -length * np.cos(angle), 0.0)
    bob = flying(scene, "bob", place, (0.0, 0.0, 0.0), mass=3.0)
    scene.connect(fm.joint.Distance(length), scene.ground.frame(), bob.frame())
    quarter = np.sqrt(length / 9.81) * ellipk(np.sin(angle / 2) ** 2)
    run = scene.simulate(float(quarter), rtol=1e-9)
    assert np.abs(run.position(bob.frame())[-1] - [0.0, -length, 0.0]).max() < 1e-6


def test_on_a_body_it_is_what_a_rigid_body_with_the_mass_at_that_place_is():
    rod = {"mass": 2.0, "inertia": (0.02, 0.1, 0.1), "com": (0.3, 0.0, 0.0)}
    tip, m = np.array((0.7, 0.1, 0.2)), 1.5

    def swung(*, whole):
        scene = fm.System(gravity=(0.0, -9.81, 1.0))
        one = fm.RigidBody(**rod)
        if whole:
            first, second = one.moments()
            mass, first, second = 2.0 + m, first + m * tip, second + m * np.outer(tip, tip)
            com = first / mass
            about = second - mass * np.outer(com, com)
            one = fm.RigidBody(mass, np.trace(about) * np.eye(3) - about, tuple(com))
        body = scene.add(one, name="rod")
        scene.connect(fm.joint.Universal("z", "y"), scene.ground.frame(), body.frame()).velocity = (2.0, -1.0)
        if not whole:
            point = scene.add(fm.PointMass(m), name="tip")
            scene.connect(fm.joint.Fixed(), body.frame(p=tip), point.frame())
        run = scene.simulate(1.0, rtol=1e-10)
        return run.position(body.frame(p=tip))[-1], run.energy().total[-1]

    for own, same in zip(swung(whole=False), swung(whole=True), strict=True):
        np.testing.assert_allclose(own, same, rtol=1e-7)


@pytest.mark.parametrize("joint", ["Prismatic", "PointOnLine"])
def test_a_piston_that_is_a_point_closes_a_slider_crank(joint):
    r, length, angle = 0.1, 0.35, 0.6
    scene = fm.System()
    crank = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="crank")
    rod = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name="rod")
    piston = scene.add(fm.PointMass(0.5), name="piston")
    axle = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
    scene.connect(fm.joint.Revolute("z"), crank.frame(p=(r, 0.0, 0.0)), rod.frame())
    scene.connect(fm.joint.Spherical(), rod.frame(p=(length, 0.0, 0.0)), piston.frame())
    scene.connect(getattr(fm.joint, joint)("x"), scene.ground.frame(), piston.frame())
    axle.position, axle.velocity = angle, 4.0
    run = scene.simulate(0.3, rtol=1e-9)
    turned = run.beta(axle)
    expected = r * np.cos(turned) + np.sqrt(length**2 - (r * np.sin(turned)) ** 2)
    np.testing.assert_allclose(run.position(piston.frame())[:, 0], expected, rtol=1e-9)
    total = run.energy().total
    assert np.ptp(total) < 1e-6 * total[0]


def test_a_chain_of_points_on_springs_has_the_frequencies_of_the_closed_form():
    n, k, m, gap = 5, 40.0, 0.25, 0.1
    scene = fm.System()
    ends = [scene.ground.frame()]
    for i in range(n):
        point = scene.add(fm.PointMass(m))
        rail = scene.connect(fm.joint.PlanarPoint("z"), scene.ground.frame(), point.frame())
        rail.position = ((i + 1) * gap, 0.0)
        ends.append(point.frame())
    ends.append(scene.ground.frame(p=((n + 1) * gap, 0.0, 0.0)))
    for one, other in itertools.pairwise(ends):
        scene.add_force(fm.force.SpringDamper(one, other, stiffness=k, length=0.5 * gap))
    found = np.sort(np.abs(scene.linearize().eigenvalues().imag))[::2]
    modes = 2.0 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    along, across = modes * np.sqrt(k / m), modes * np.sqrt(0.5 * k / m)  # across: tension over length
    np.testing.assert_allclose(found, np.sort(np.concatenate([along, across])), rtol=1e-7)


def test_a_rod_hangs_on_a_point_by_a_ball():
    """The point and the rod's centre: momentum straight on, the angular momentum about the centre of mass kept."""
    scene = fm.System()
    point = flying(scene, "point", (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), mass=2.0)
    rod = scene.add(fm.RigidBody(1.0, (0.01, 0.1, 0.1), (0.4, 0.0, 0.0)), name="rod")
    ball = scene.connect(fm.joint.Spherical(), point.frame(), rod.frame())
    ball.velocity = (0.3, 2.0, -1.0)
    run = scene.simulate(2.0, rtol=1e-10)
    kept = run.momentum()
    for name in ("linear", "angular"):
        values = getattr(kept, name)
        assert np.abs(values - values[0]).max() < 1e-7 * np.abs(values).max()


@pytest.mark.parametrize(
    ("joint", "point_is"),
    [
        (fm.joint.Revolute("z"), "child"),
        (fm.joint.Cylindrical("z"), "child"),
        (fm.joint.Planar("z"), "child"),
        (fm.joint.Universal("x", "z"), "child"),
        (fm.joint.Screw(0.1), "child"),
        (fm.joint.ConstantVelocity("z"), "child"),
        (fm.joint.RollingDisc(0.2), "child"),
        (fm.joint.Free(), "child"),
        (fm.joint.Revolute("z"), "parent"),
        (fm.joint.Prismatic("z"), "parent"),
        (fm.joint.Fixed(), "parent"),
        (fm.joint.PointOnPlane("z"), "parent"),
    ],
)
def test_a_joint_that_asks_for_an_orientation_is_refused_by_name(joint, point_is):
    scene = fm.System()
    point, body = scene.add(fm.PointMass(1.0), name="speck"), scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="block")
    ends = (body, point) if point_is == "child" else (point, body)
    with pytest.raises(SceneError, match="speck"):
        scene.connect(joint, *(one.frame() for one in ends))


def compiled_with(scene, force):
    try:
        scene.add_force(force)
        return scene.compile()
    finally:
        scene._forces.clear()


def test_what_else_asks_for_an_orientation_is_refused_by_name():
    scene = fm.System()
    point, body = flying(scene, "speck", (0, 0, 0), (0, 0, 0)), scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="block")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    here, there = point.frame(), body.frame()
    for wrong in (
        fm.force.FrameForce(here, torque=(0.0, 0.0, 1.0)),
        fm.force.FrameForce(here, torque=(0.0, 0.0, fm.Sine(1.0, 2.0))),
        fm.force.Bushing(there, here, (1.0,) * 6),
        fm.force.Bushing(here, there, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)),
        fm.force.BeamElement(there, here, (1.0,) * 6, (1.0, 0, 0, 0, 0, 0)),
    ):
        with pytest.raises(SceneError, match="speck"):
            compiled_with(scene, wrong)
    run = scene.simulate(0.1)
    for ask in (run.rotation, run.angular_velocity, run.at(0.05).rotation, run.at(0.05).angular_acceleration):
        with pytest.raises(SceneError, match="speck"):
            ask(here)
    with pytest.raises(SceneError, match="no place but its own"):
        point.frame(p=(0.1, 0.0, 0.0))
    with pytest.raises(SceneError, match="has a mass alone"):
        point.com = (0.1, 0.0, 0.0)
    with pytest.raises(SceneError, match="mass must be positive"):
        fm.PointMass(0.0)
    with pytest.raises(SceneError, match="mass alone"):
        scene.compile(parameters={"J": fm.parameter.Inertia(point)})


def test_its_mass_is_a_parameter_and_may_be_changed():
    def last(scene, point, **values):
        return scene.simulate(0.5, rtol=1e-9, **values).position(point.frame())[-1, 0]

    def built(mass):
        scene = fm.System()
        point = scene.add(fm.PointMass(mass), name="m")
        scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), point.frame())
        scene.add_force(fm.force.FrameForce(point.frame(), force=(3.0, 0.0, 0.0)))
        return scene, point

    scene, point = built(1.0)
    machine = scene.compile(parameters={"m": fm.parameter.Mass(point)})
    for mass in (1.0, 2.5):
        assert machine.simulate(0.5, m=mass, rtol=1e-9).position(point.frame())[-1, 0] == pytest.approx(0.375 / mass)
    assert last(scene, point) == pytest.approx(0.375)
    point.mass = 5.0
    assert last(scene, point) == pytest.approx(0.075)
    assert dataclasses.replace(point, mass=4.0).mass == 4.0


def test_a_scene_file_has_points(tmp_path):
    path = tmp_path / "points.toml"
    path.write_text(
        """
        gravity = [0.0, -9.81, 0.0]
        [[body]]
        name = "ball"
        point = true
        mass = 0.3
        [[body]]
        name = "puck"
        point = true
        mass = 0.2
        [[joint]]
        name = "flight"
        kind = "translation"
        child = "ball"
        velocity = [1.0, 2.0, 0.0]
        [[joint]]
        name = "table"
        kind = "planar_point"
        axis = "y"
        child = "puck"
        velocity = [0.5, 0.25]
        [simulate]
        t_end = 1.0
        """
    )
    built = build(read_scene(path))
    run = built.system.simulate(1.0, rtol=1e-8)
    np.testing.assert_allclose(run.position(built.bodies["ball"].frame())[-1], (1.0, 2.0 - 4.905, 0.0), atol=1e-7)
    np.testing.assert_allclose(run.position(built.bodies["puck"].frame())[-1], (0.25, 0.0, 0.5), atol=1e-9)


def test_the_drawing_holds_a_point_at_its_own_place():
    scene = fm.System()
    ball = scene.add(fm.PointMass(1.0), name="ball", p=(1.0, 2.0, 3.0))
    with pytest.raises(SceneError, match=r"ball.*its own place"):
        scene.connect(fm.joint.Spherical(), scene.ground, ball, at=(1.0, 2.0, 3.5))
    scene.connect(fm.joint.Prismatic(), scene.ground, ball, at=(1.0, 2.0, 3.0), axis="x").velocity = 2.0
    run = scene.simulate(0.5)
    np.testing.assert_allclose(run.position(ball.frame())[-1], (2.0, 2.0, 3.0), atol=1e-9)


def test_the_mass_of_a_solid_and_of_a_shape_stands_at_its_centre():
    box = fm.Shape.box((0.2, 0.4, 0.6), at=(1.0, 0.0, 0.0))
    assert fm.PointMass.from_solid(box.solid(density=10.0)).mass == pytest.approx(0.48)
    for point in (
        fm.PointMass.from_shape(box, density=10.0),
        fm.PointMass.from_solid(fm.Solid.box((0.2, 0.4, 0.6), density=10.0)),
    ):
        assert point.mass == pytest.approx(0.48)
        assert point.shape is not None
        np.testing.assert_allclose(np.ptp(point.shape.points, axis=0), (0.2, 0.4, 0.6))
        np.testing.assert_allclose(point.shape.points.max(axis=0), (0.1, 0.2, 0.3))


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize("anchor", [(0.0, 0.0, 0.0), (3.0, -4.0, 5.0)])
@pytest.mark.parametrize("beside", [0.0, 7.0])
def test_a_lone_point_takes_the_same_steps_in_all_units_and_wherever_it_is(unit, anchor, beside):
    """Thrown above a floor: its flight tells its size, not where frames lie, nor the unit of length."""
    steps = []
    for length, p, x in ((1.0, np.zeros(3), 0.0), (unit, np.array(anchor), beside)):
        scene = fm.System(gravity=(0.0, 0.0, -10.0 * length))
        point = scene.add(fm.PointMass(1.0), name="point")
        fly = scene.connect(fm.joint.Translation(), scene.ground.frame(tuple(length * p)), point.frame())
        fly.position, fly.velocity = (0.0, 0.0, 1e-6 * length), (2.0 * length, 0.0, 1.0 * length)
        floor = contact.HalfSpace(scene.ground.frame(tuple(length * (p + np.array([x, 0.0, 0.0])))))
        law = contact.PowerLaw(k=1e4, restitution=0.5, speed=0.1 * length)
        scene.touch(floor, contact.Vertex(point.frame()), law)
        run = scene.simulate(1.0, rtol=1e-6, integrator=fm.ExplicitRungeKutta())
        steps.append((run.stats.steps, scene.compile().scene.extent / length))
    assert steps[1][1] == pytest.approx(steps[0][1], rel=1e-12) == pytest.approx(0.5)
    assert steps[1][0] == pytest.approx(steps[0][0], rel=0.02)
    assert steps[0][0] < 600
